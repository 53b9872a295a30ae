"""Fields on the surface from its balls: feature transform, thickness, thin spots (thesis 3.5)."""
