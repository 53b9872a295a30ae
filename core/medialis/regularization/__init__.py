"""Regularization: how important a skeleton point is, and simplification by it (thesis 3.3)."""
