"""What medial features are good for: soft edges, patches and parts of a surface (thesis 6.3)."""
