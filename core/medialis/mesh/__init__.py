"""The surface skeleton as triangles (thesis 3.4.1)."""
