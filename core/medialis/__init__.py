"""Medial descriptors of 3D shapes: surface and curve skeletons, thickness, sheets, parts.

    shape = medialis.read_shape("bunny.ply")
    cloud = medialis.surface_skeleton(shape)
    result = medialis.run("surface_skeleton", shape)

The public names; importing them loads no compiled code, that happens at the first computation.
"""

from medialis.applications.mean_shift import MeanShift, mean_shift
from medialis.applications.mean_shift_segments import mean_shift_segments
from medialis.applications.parts import parts
from medialis.applications.patches import patches
from medialis.applications.soft_edges import SoftEdges, soft_edges
from medialis.batches.batch import batch
from medialis.batches.huge import huge_surface_skeleton, open_medial_cloud
from medialis.curve_skeletons.area import area_importance
from medialis.curve_skeletons.bones import bones
from medialis.curve_skeletons.candidates import (
    CandidateMeasure,
    candidate_measure,
    tangent_field,
)
from medialis.curve_skeletons.curve_skeleton import curve_skeleton
from medialis.curve_skeletons.point_graph import point_graph
from medialis.curve_skeletons.silhouettes import silhouette_skeleton
from medialis.curve_skeletons.simplification import simplify_branches
from medialis.curve_skeletons.skinning import skin_weights
from medialis.curve_skeletons.views import view_curve_skeleton, view_source
from medialis.errors import (
    Cancelled,
    FileError,
    InvalidOptionError,
    InvalidShapeError,
    MedialisError,
)
from medialis.features.extended_features import extended_feature_transform
from medialis.features.feature_transform import (
    feature_transform,
    field_on_skeleton,
    field_on_surface,
)
from medialis.features.point_types import PointType, point_types
from medialis.features.scaffold import MedialScaffold, medial_scaffold
from medialis.features.sheet_meshes import SheetMeshes, sheet_meshes
from medialis.features.sheets import medial_sheets
from medialis.features.thickness import thickness
from medialis.features.thin_spots import ThinSpot, thin_spots
from medialis.features.y_network import y_network
from medialis.io.curve_graphs import read_curve_skeleton, write_curve_skeleton
from medialis.manifold_segmentation.segmentation import manifolds
from medialis.manifold_segmentation.surfaces import manifold_surfaces
from medialis.model.armature import Bones, SkinWeights
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.diagnosis import Diagnosis
from medialis.model.feature_sets import FeatureSets
from medialis.model.geodesic_paths import GeodesicPaths, PathStatus
from medialis.model.manifold_set import ManifoldSet, PointClass
from medialis.model.medial_cloud import BallStatus, MedialCloud
from medialis.model.medial_sheets import MedialSheets
from medialis.model.ragged import Ragged
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.model.view import OrthographicCamera, View, ViewSource
from medialis.model.y_network import YNetwork
from medialis.operations.pictures import draw_result
from medialis.operations.registry import OPERATIONS, operation, run
from medialis.operations.result import Layer, Result
from medialis.operations.writing import write_result
from medialis.progress import Progress
from medialis.regularization.connectivity import connected_importance
from medialis.regularization.geodesics import (
    Geodesic,
    geodesic,
    geodesic_lengths,
    geodesics,
)
from medialis.regularization.importance import (
    geodesic_importance,
    important_points,
    local_measures,
)
from medialis.render.depth_range import rasterizer
from medialis.render.reconstruction import progressive, reconstruct_image
from medialis.shape.cloud_normals import estimate_normals
from medialis.shape.cloud_surface import surface_of_cloud
from medialis.shape.diagnosis import diagnose
from medialis.shape.generate import organic_shape
from medialis.shape.generate_arch import dental_arch
from medialis.shape.noise import noise_level, smooth_noise
from medialis.shape.normals import vertex_normals
from medialis.shape.reading import make_shape, read_shape
from medialis.shape.refinement import refine
from medialis.shape.repair import Repair, repair
from medialis.surface_skeletons.ball_shrinking import surface_skeleton
from medialis.surface_skeletons.skeleton_mesh import skeleton_mesh
from medialis.surface_skeletons.subsampling import uniform_subsample
from medialis.threads import thread_count, thread_limit

__all__ = [
    "OPERATIONS",
    "BallStatus",
    "Bones",
    "Cancelled",
    "CandidateMeasure",
    "CurveSkeleton",
    "Diagnosis",
    "FeatureSets",
    "FileError",
    "Geodesic",
    "GeodesicPaths",
    "InvalidOptionError",
    "InvalidShapeError",
    "Layer",
    "ManifoldSet",
    "MeanShift",
    "MedialCloud",
    "MedialScaffold",
    "MedialSheets",
    "MedialisError",
    "OrthographicCamera",
    "PathStatus",
    "PointClass",
    "PointType",
    "Progress",
    "Ragged",
    "Repair",
    "Result",
    "Segmentation",
    "Shape",
    "SheetMeshes",
    "SkeletonMesh",
    "SkinWeights",
    "SoftEdges",
    "ThinSpot",
    "View",
    "ViewSource",
    "YNetwork",
    "area_importance",
    "batch",
    "bones",
    "candidate_measure",
    "connected_importance",
    "curve_skeleton",
    "dental_arch",
    "diagnose",
    "draw_result",
    "estimate_normals",
    "extended_feature_transform",
    "feature_transform",
    "field_on_skeleton",
    "field_on_surface",
    "geodesic",
    "geodesic_importance",
    "geodesic_lengths",
    "geodesics",
    "huge_surface_skeleton",
    "important_points",
    "local_measures",
    "make_shape",
    "manifold_surfaces",
    "manifolds",
    "mean_shift",
    "mean_shift_segments",
    "medial_scaffold",
    "medial_sheets",
    "noise_level",
    "open_medial_cloud",
    "operation",
    "organic_shape",
    "parts",
    "patches",
    "point_graph",
    "point_types",
    "progressive",
    "rasterizer",
    "read_curve_skeleton",
    "read_shape",
    "reconstruct_image",
    "refine",
    "repair",
    "run",
    "sheet_meshes",
    "silhouette_skeleton",
    "simplify_branches",
    "skeleton_mesh",
    "skin_weights",
    "smooth_noise",
    "soft_edges",
    "surface_of_cloud",
    "surface_skeleton",
    "tangent_field",
    "thickness",
    "thin_spots",
    "thread_count",
    "thread_limit",
    "uniform_subsample",
    "vertex_normals",
    "view_curve_skeleton",
    "view_source",
    "write_curve_skeleton",
    "write_result",
    "y_network",
]
