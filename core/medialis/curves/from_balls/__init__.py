"""Curve skeletons from the surface skeleton (thesis 3.6)."""
