"""Noisy clouds segmented into intersecting manifolds (thesis 4.2)."""
