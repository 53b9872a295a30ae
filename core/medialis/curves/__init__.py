"""Curve skeletons (thesis 3.6, 3.7)."""
