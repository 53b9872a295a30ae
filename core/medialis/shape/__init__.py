"""Preparing shapes: diagnosis, repair, normals, refinement, generated examples (before 3.2)."""
