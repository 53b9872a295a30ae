"""Curve skeletons: from the surface skeleton (thesis 3.6), and from views of a shape (3.7)."""
