"""Files in and out: meshes and point clouds in, lossless results out."""

from medialis.io.meshes import MeshData, read_mesh

__all__ = ["MeshData", "read_mesh"]
