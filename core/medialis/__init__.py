"""Medial descriptors of 3D shapes: surface and curve skeletons, thickness, sheets, parts.

    shape = medialis.read_shape("bunny.ply")
    cloud = medialis.surface_skeleton(shape)  # balls, the base of everything else
    curve = medialis.curve_skeleton(cloud)
    result = medialis.run("thickness", shape)  # as the command line and every host run it

Functions take one thing and options as keywords; what takes a shape, or balls, takes a path, a
(vertices, faces) pair or a mesh of trimesh, PyVista or Open3D as well. Lengths are fractions of
the bounding-box diagonal, or such as "1mm" and "0.5%"; angles are degrees. Importing loads no
compiled code: that happens at the first computation. All public names, by what they are for
(docs/api.md says more):

Shapes:
    read_shape, make_shape, Shape, Surface, diagnose, Diagnosis, repair, Repair, refine,
    noise_level, smooth_noise, vertex_normals, Cylinders, organic_shape, dental_arch,
    sample_shape, SAMPLES
Balls and skeletons:
    surface_skeleton, shrink_balls, MedialCloud, Balls, BallStatus, Ragged, uniform_subsample,
    huge_surface_skeleton, open_medial_cloud, skeleton_mesh, SkeletonMesh
Medial meshes:
    medial_mesh, MedialMesh, envelope_distance, EnvelopeDistance, envelope_surface,
    values_on_balls, important_mesh, read_ma, write_ma, ball_cover, BallCover, write_ball_cover,
    robot_balls, RobotBalls, CapsuleCover, LinkOverlap, write_robot_balls, convex_pieces,
    ConvexPieces
Measures:
    geodesic_importance, Importance, connected_importance, important_points, local_measures,
    geodesic, Geodesic, geodesics, geodesic_lengths, GeodesicPaths, PathStatus, thickness,
    wall_thickness, thin_spots, ThinSpot, midsurface, Midsurface, Lump, feature_transform,
    field_on_skeleton, field_on_surface
Sheets and segments:
    extended_feature_transform, FeatureSets, point_types, PointType, medial_sheets, MedialSheets,
    Unfolded, y_network, YNetwork, sheet_meshes, SheetMeshes, medial_scaffold, MedialScaffold,
    soft_edges, SoftEdges, patches, parts, mean_shift, MeanShift, mean_shift_segments, Segmentation
Curves and rigging:
    curve_skeleton, CurveSkeleton, CurveEvidence, candidate_measure, CandidateMeasure,
    tangent_field, area_importance, simplify_branches, point_graph, Handles, view_curve_skeleton,
    view_source, View, ViewPoints, ViewSource, OrthographicCamera, rasterizer, Rasterizer,
    silhouette_skeleton, Crossings, bones, Bones, skin_weights, SkinWeights, Armature,
    read_armature, bind_weights
Clouds:
    estimate_normals, surface_of_cloud, manifolds, ManifoldSet, PointClass, manifold_surfaces
Operations:
    run, operation, Operation, Selection, OPERATIONS, Options, Parameter, Kind, Result, Outcome,
    Layer, Format, FilterUnit, Length, mm, inch, percent, batch, Row
Files and pictures:
    write_result, read_result, write_mesh, Pictures, draw_result, Camera, Style,
    read_curve_skeleton, write_curve_skeleton, reconstruct_image, progressive, Comparison
Other libraries:
    to_trimesh, to_pyvista, to_open3d, to_meshio, to_networkx, to_navis, as_curve_skeleton,
    to_pandas, label_surfaces
Control:
    Progress, Message, Cancelled, thread_count, thread_limit, use_device, memory_limit, kept_bytes,
    forget, MedialisError, InvalidShapeError, InvalidOptionError, FileError, NotPassedError
"""

from medialis.base.version import package_version, public_names

__all__, __getattr__, __dir__ = public_names(__name__, __file__, __version__=package_version)
