"""Noisy clouds into manifolds that may cross, and their surfaces (thesis 4.2)."""
