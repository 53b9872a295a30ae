"""Surface skeletons (medial axes) by ball shrinking, thesis 3.2."""
