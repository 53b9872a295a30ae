"""Fields on surface and skeleton, thickness (thesis 3.5.1), point types and sheets (6.2)."""
