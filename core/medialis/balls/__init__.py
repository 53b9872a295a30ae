"""Maximal balls: shrinking, thin walls, subsampling (thesis 3.2)."""
