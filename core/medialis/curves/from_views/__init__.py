"""Curve skeletons from views (thesis 3.7)."""
