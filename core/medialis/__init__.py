"""Medial descriptors of 3D shapes: surface and curve skeletons, thickness, sheets, parts.

    shape = medialis.read_shape("bunny.ply")
    cloud = medialis.surface_skeleton(shape)  # balls, the base of everything else
    curve = medialis.curve_skeleton(cloud)
    result = medialis.run("thickness", shape)  # as the command line and every host run it

Functions take one thing and options as keywords; lengths are fractions of the bounding-box
diagonal, angles are degrees. Importing loads no compiled code: that happens at the first
computation. All public names, by what they are for (docs/api.md says more):

Shapes:
    read_shape, make_shape, Shape, Surface, diagnose, Diagnosis, repair, Repair, refine,
    noise_level, smooth_noise, vertex_normals, organic_shape, dental_arch
Balls and skeletons:
    surface_skeleton, shrink_balls, MedialCloud, Balls, BallStatus, Ragged, uniform_subsample,
    huge_surface_skeleton, open_medial_cloud, skeleton_mesh, SkeletonMesh
Measures:
    geodesic_importance, Importance, connected_importance, important_points, local_measures,
    geodesic, Geodesic, geodesics, geodesic_lengths, GeodesicPaths, PathStatus, thickness,
    thin_spots, ThinSpot, feature_transform, field_on_skeleton, field_on_surface
Sheets and segments:
    extended_feature_transform, FeatureSets, point_types, PointType, medial_sheets, MedialSheets,
    y_network, YNetwork, sheet_meshes, SheetMeshes, medial_scaffold, MedialScaffold, soft_edges,
    SoftEdges, patches, parts, mean_shift, MeanShift, mean_shift_segments, Segmentation
Curves and rigging:
    curve_skeleton, CurveSkeleton, CurveEvidence, candidate_measure, CandidateMeasure,
    tangent_field, area_importance, simplify_branches, point_graph, Handles, view_curve_skeleton,
    view_source, View, ViewPoints, ViewSource, OrthographicCamera, rasterizer, Rasterizer,
    silhouette_skeleton, Crossings, bones, Bones, skin_weights, SkinWeights
Clouds:
    estimate_normals, surface_of_cloud, manifolds, ManifoldSet, PointClass, manifold_surfaces
Operations:
    run, operation, Operation, OPERATIONS, Options, Parameter, Kind, Result, Outcome, Layer,
    FilterUnit, batch, Row
Files and pictures:
    write_result, Pictures, draw_result, Camera, read_curve_skeleton, write_curve_skeleton,
    reconstruct_image, progressive, Comparison
Control:
    Progress, Message, Cancelled, thread_count, thread_limit, memory_limit, kept_bytes, forget,
    MedialisError, InvalidShapeError, InvalidOptionError, FileError
"""

from medialis.balls.ball_shrinking import shrink_balls
from medialis.balls.subsampling import uniform_subsample
from medialis.balls.surface_skeleton import surface_skeleton
from medialis.batches.batch import batch
from medialis.batches.huge import huge_surface_skeleton, open_medial_cloud
from medialis.batches.jobs import Row
from medialis.clouds.manifolds import manifolds
from medialis.clouds.surfaces import manifold_surfaces
from medialis.curves.from_balls.candidates import (
    CandidateMeasure,
    area_importance,
    candidate_measure,
    tangent_field,
)
from medialis.curves.from_balls.curve_skeleton import curve_skeleton
from medialis.curves.from_views.silhouettes import Crossings, silhouette_skeleton
from medialis.curves.from_views.views import view_curve_skeleton, view_source
from medialis.curves.graph.ground import Handles
from medialis.curves.graph.point_graph import point_graph
from medialis.curves.graph.simplification import simplify_branches
from medialis.errors import (
    Cancelled,
    FileError,
    InvalidOptionError,
    InvalidShapeError,
    MedialisError,
)
from medialis.fields.feature_transform import (
    feature_transform,
    field_on_skeleton,
    field_on_surface,
)
from medialis.fields.thickness import thickness
from medialis.fields.thin_spots import ThinSpot, thin_spots
from medialis.files.curve_graphs import read_curve_skeleton, write_curve_skeleton
from medialis.geodesics.connectivity import connected_importance
from medialis.geodesics.geodesics import geodesic_lengths
from medialis.geodesics.importance import (
    geodesic_importance,
    important_points,
    local_measures,
)
from medialis.geodesics.paths import Geodesic, geodesic, geodesics
from medialis.kept import forget, kept_bytes, memory_limit
from medialis.mesh.skeleton_mesh import skeleton_mesh
from medialis.model.armature import Bones, SkinWeights
from medialis.model.curve_skeleton import CurveEvidence, CurveSkeleton, ViewPoints
from medialis.model.diagnosis import Diagnosis
from medialis.model.feature_sets import FeatureSets
from medialis.model.geodesic_paths import GeodesicPaths, Importance, PathStatus
from medialis.model.manifold_set import ManifoldSet, PointClass
from medialis.model.medial_cloud import Balls, BallStatus, MedialCloud
from medialis.model.medial_sheets import MedialSheets
from medialis.model.ragged import Ragged
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.model.surface import Surface
from medialis.model.view import OrthographicCamera, View, ViewSource
from medialis.model.y_network import YNetwork
from medialis.operations.declaration import Operation
from medialis.operations.pictures import draw_result
from medialis.operations.registry import OPERATIONS, operation, run
from medialis.operations.result import FilterUnit, Layer, Outcome, Result
from medialis.operations.writing import Pictures, write_result
from medialis.options import Kind, Options, Parameter
from medialis.progress import Message, Progress
from medialis.render.camera import Camera
from medialis.render.depth_range import Rasterizer, rasterizer
from medialis.render.reconstruction import Comparison, progressive, reconstruct_image
from medialis.rigging.bones import bones
from medialis.rigging.skinning import skin_weights
from medialis.segments.mean_shift import MeanShift, mean_shift
from medialis.segments.mean_shift_segments import mean_shift_segments
from medialis.segments.parts import parts
from medialis.segments.patches import patches
from medialis.segments.soft_edges import SoftEdges, soft_edges
from medialis.sheets.extended_features import extended_feature_transform
from medialis.sheets.point_types import PointType, point_types
from medialis.sheets.scaffold import MedialScaffold, medial_scaffold
from medialis.sheets.sheet_meshes import SheetMeshes, sheet_meshes
from medialis.sheets.sheets import medial_sheets
from medialis.sheets.y_network import y_network
from medialis.surface.cloud_normals import estimate_normals
from medialis.surface.cloud_surface import surface_of_cloud
from medialis.surface.diagnosis import diagnose
from medialis.surface.generate import organic_shape
from medialis.surface.generate_arch import dental_arch
from medialis.surface.noise import noise_level, smooth_noise
from medialis.surface.normals import vertex_normals
from medialis.surface.reading import make_shape, read_shape
from medialis.surface.refinement import refine
from medialis.surface.repair import Repair, repair
from medialis.threads import thread_count, thread_limit
from medialis.version import package_version

__all__ = [
    "OPERATIONS",
    "BallStatus",
    "Balls",
    "Bones",
    "Camera",
    "Cancelled",
    "CandidateMeasure",
    "Comparison",
    "Crossings",
    "CurveEvidence",
    "CurveSkeleton",
    "Diagnosis",
    "FeatureSets",
    "FileError",
    "FilterUnit",
    "Geodesic",
    "GeodesicPaths",
    "Handles",
    "Importance",
    "InvalidOptionError",
    "InvalidShapeError",
    "Kind",
    "Layer",
    "ManifoldSet",
    "MeanShift",
    "MedialCloud",
    "MedialScaffold",
    "MedialSheets",
    "MedialisError",
    "Message",
    "Operation",
    "Options",
    "OrthographicCamera",
    "Outcome",
    "Parameter",
    "PathStatus",
    "Pictures",
    "PointClass",
    "PointType",
    "Progress",
    "Ragged",
    "Rasterizer",
    "Repair",
    "Result",
    "Row",
    "Segmentation",
    "Shape",
    "SheetMeshes",
    "SkeletonMesh",
    "SkinWeights",
    "SoftEdges",
    "Surface",
    "ThinSpot",
    "View",
    "ViewPoints",
    "ViewSource",
    "YNetwork",
    "__version__",
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
    "forget",
    "geodesic",
    "geodesic_importance",
    "geodesic_lengths",
    "geodesics",
    "huge_surface_skeleton",
    "important_points",
    "kept_bytes",
    "local_measures",
    "make_shape",
    "manifold_surfaces",
    "manifolds",
    "mean_shift",
    "mean_shift_segments",
    "medial_scaffold",
    "medial_sheets",
    "memory_limit",
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
    "shrink_balls",
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

__version__ = package_version()
