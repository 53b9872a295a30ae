"""Files in and out: meshes and point clouds in, lossless results out."""

from medialis.files.curve_graphs import read_curve_skeleton, write_curve_skeleton
from medialis.files.meshes import MeshData, read_mesh
from medialis.files.output_folder import OutputFolder
from medialis.files.ply_attributes import PlyData, read_ply_attributes, write_ply
from medialis.files.results import json_text, read_npz, write_json, write_npz

__all__ = [
    "MeshData",
    "OutputFolder",
    "PlyData",
    "json_text",
    "read_curve_skeleton",
    "read_mesh",
    "read_npz",
    "read_ply_attributes",
    "write_curve_skeleton",
    "write_json",
    "write_npz",
    "write_ply",
]
