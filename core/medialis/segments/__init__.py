"""Segmentations: mean shift (thesis 5.3), soft edges, patches, parts and limbs (6.3)."""
