"""Curve skeletons: candidates, their importance, and the graph that joins them (thesis 3.6)."""
