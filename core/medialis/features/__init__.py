"""Fields between surface and skeleton, thickness, and the thinnest places (thesis 3.5.1)."""
