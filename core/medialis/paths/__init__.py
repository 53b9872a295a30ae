"""Shortest paths on a surface and the importance that they give (thesis 3.3)."""
