"""Preparing shapes: diagnosis, repair, normals, refinement, generated examples (before thesis 3.2)."""
