"""A function and the operation of the same name compute the same: one algorithm a name.

`medialis.curve_skeleton(gear)` had 1 branch where the operation had 24: the operation refined limbs
and handles, the function did not.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import medialis
from closed_forms import mesh, torus_mesh
from medialis import OPERATIONS
from plates import bent_sheet, extruded, revolved, shape_of

QUICK = {
    "view_curve_skeleton": {"pairs": 20, "size": 96},
    "medial_mesh": {"samples": 500, "balls": 30, "quality": "fast"},
    "convex_pieces": {"error": 0.1, "pieces": 8},
}
"""Options of both, where the defaults take long."""


def gear(teeth=12):
    """Disc with teeth: 24 long thin faces a ring, no vertices inside."""
    turn = np.linspace(0.0, 2.0 * np.pi, 4 * teeth, endpoint=False)
    radius = np.where(np.arange(4 * teeth) % 4 < 2, 1.3, 1.0)
    outline = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    return mesh(*extruded(outline, 0.4))


def vase():
    """Closed body of revolution with a hollow that is open at the top."""
    outside = [(0.0, 0.0), (0.5, 0.0), (0.9, 0.7), (0.4, 1.6), (0.6, 2.0)]
    inside = [(0.5, 2.0), (0.3, 1.6), (0.75, 0.7), (0.4, 0.15), (0.0, 0.15)]
    return medialis.make_shape(*revolved(np.array(outside + inside), 12), repair=True)


MAKERS = {
    "creature": lambda: medialis.organic_shape(56),
    "gear": gear,
    "vase": vase,
    "thin ring": lambda: torus_mesh(16, 5, 1.0, 0.06),
    "bent plate": lambda: shape_of(bent_sheet(steps=8, layers=4)),
}


@cache
def shape(name):
    return MAKERS[name]()


def _cloud(cloud):
    return cloud.centers, cloud.radii, cloud.features


def _graph(graph):
    return graph.nodes, graph.edges, graph.radii, graph.vertex_node


def _labels(found):
    return found.labels, found.surface.points


def _importance(given, **options):
    return (medialis.connected_importance(medialis.geodesic_importance(given, **options)).length,)


def _sheets(found):
    return found.labels, found.unfolded.cloud.centers


def arrays(*names):
    return lambda result: [np.asarray(result.arrays[name]) for name in names]


CLOUD = arrays("centers", "radii", "features")

COMPARED = {
    # The operation shows the balls of sharp edges besides, which `fans` of the function gives.
    "surface_skeleton": (lambda s: _cloud(medialis.surface_skeleton(s, fans=True)), CLOUD),
    "skeleton_importance": (_importance, arrays("importance")),
    "skeleton_mesh": (
        lambda s: (lambda m: (m.rows, m.faces, m.face_origin))(medialis.skeleton_mesh(s)),
        arrays("mesh_rows", "mesh_faces", "mesh_face_origin"),
    ),
    "medial_mesh": (
        lambda s, **o: (lambda m: (m.centers, m.radii, m.edges))(medialis.medial_mesh(s, **o)),
        arrays("centers", "mesh_radii", "mesh_edges"),
    ),
    "midsurface": (
        lambda s: (lambda m: (m.points, m.faces))(medialis.midsurface(s)),
        arrays("midsurface_points", "midsurface_faces"),
    ),
    "convex_pieces": (
        lambda s, **o: (lambda p: (p.points, p.faces))(medialis.convex_pieces(s, **o)),
        lambda r: (r.layers[0].points, r.layers[0].faces),
    ),
    "curve_skeleton": (
        lambda s: _graph(medialis.curve_skeleton(s)),
        lambda r: _graph(r.extras["graph"]),
    ),
    "view_curve_skeleton": (
        lambda s, **o: _graph(medialis.view_curve_skeleton(s, **o))[:3],
        lambda r: _graph(r.extras["graph"])[:3],
    ),
    "geodesic_path": (
        lambda s: ([medialis.geodesics(s, [[0, 1]])[0].length],),
        arrays("length"),
    ),
    "point_types": (lambda s: (medialis.point_types(s),), arrays("type")),
    "medial_sheets": (lambda s: _sheets(medialis.medial_sheets(s)), arrays("sheet", "centers")),
    "soft_edges": (
        lambda s: (lambda e: (e.radius, e.angle))(medialis.soft_edges(s)),
        arrays("edge_radius", "edge_angle"),
    ),
    "patches": (lambda s: _labels(medialis.patches(s)), arrays("patches", "points")),
    "parts": (lambda s: _labels(medialis.parts(s)), arrays("parts", "points")),
    "manifolds": (
        lambda s: (lambda m: (m.labels(), m.point_class))(medialis.manifolds(s)),
        arrays("manifold", "point_class"),
    ),
    "mean_shift_segments": (
        lambda s: _labels(medialis.mean_shift_segments(s)),
        arrays("segment", "points"),
    ),
    "thickness": (
        lambda s: (medialis.thickness(s), medialis.wall_thickness(s)),
        arrays("thickness", "wall_thickness"),
    ),
}
"""What the function gives, and the same of a result of the operation."""

WITHOUT_FUNCTION = {
    *("ball_reconstruction", "wall_check", "centerline", "remove_outliers", "smooth"),
    *("armature", "bind", "tree_cylinders"),
}
"""Operations that no public function stands for."""


def test_every_operation_is_compared_or_has_no_function():
    assert {o.name for o in OPERATIONS} == set(COMPARED) | WITHOUT_FUNCTION
    assert not any(hasattr(medialis, name) for name in WITHOUT_FUNCTION)


def _outcome(compute, *given, **options):
    """Return what was computed, or the class and the text of the error."""
    try:
        return [np.asarray(one) for one in compute(*given, **options)]
    except medialis.InvalidShapeError as error:
        return str(error)


@pytest.mark.slow
@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("operation", COMPARED)
def test_function_and_operation_agree(operation, name):
    function, of_result = COMPARED[operation]
    options, given = QUICK.get(operation, {}), shape(name)
    with medialis.memory_limit(1 << 28):  # equal steps of both are computed once
        by_function = _outcome(function, given, **options)
        by_operation = _outcome(lambda: of_result(medialis.run(operation, given, **options)))
    if isinstance(by_operation, str) or isinstance(by_function, str):
        assert isinstance(by_operation, str)  # an operation has to show something
        return
    assert len(by_function) == len(by_operation)
    for one, other in zip(by_function, by_operation, strict=True):
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


@pytest.mark.slow
@pytest.mark.parametrize("operation", ["armature", "tree_cylinders"])
def test_what_rests_on_curve_skeletons_has_that_of_the_function(operation):
    given = shape("creature")
    with medialis.memory_limit(1 << 28):
        curve = medialis.curve_skeleton(given)
        result = medialis.run(operation, given)
    assert np.array_equal(result.extras["graph"].nodes, curve.nodes)


@pytest.mark.slow
def test_bones_of_an_operation_bind_as_by_the_function():
    given = shape("creature")
    result = medialis.run("bind", given)
    skin = medialis.bind_weights(given, armature=result.extras["bones"])
    assert np.array_equal(result.arrays["skin_bones"], skin.bones)
    assert np.array_equal(result.arrays["skin_weights"], skin.weights)


def test_limbs_are_sampled_by_the_function():
    """Balls that are given have the samples that they have; a shape gets more on its limbs."""
    given = shape("thin ring")
    cloud = medialis.surface_skeleton(given)
    curve = medialis.curve_skeleton(given)
    assert curve.surface.point_count > cloud.surface.point_count and curve.loops == 1


def test_balls_that_are_given_stay_as_they_are():
    cloud = medialis.surface_skeleton(shape("creature"), refine=0.0)
    curve = medialis.curve_skeleton(cloud)
    assert curve.cloud is cloud
    for function in (medialis.curve_skeleton, medialis.parts, medialis.point_types):
        with pytest.raises(medialis.InvalidOptionError, match="refine"):
            function(cloud, refine=0.01)
