"""Shapes before balls: diagnosis, repair, normals, noise, refinement, graphs and labels."""
