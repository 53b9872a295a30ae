"""Soft edges, patches and parts (thesis 6.3), as functions and as operations."""

import importlib
import json
import math
from dataclasses import replace

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.base.arrays import Ragged
from medialis.base.threads import thread_limit
from medialis.cli.commands import main
from medialis.formats.ply_attributes import write_ply
from medialis.shape.graph import surface_graph
from medialis.shape.labels import merge_small, numbered_by_weight, piece_counts, without_islands

SIDES = (2.0, 1.5, 1.0)
OPERATIONS = ("point_types", "medial_sheets", "soft_edges", "patches", "parts")


def skeleton(shape, side="inner"):
    return medialis.shrink_balls(shape, side=side)


def box_face(shape):
    """The face of the box that each sample lies on, 0..5, and its distance to the next edge."""
    gaps = np.concatenate(
        [np.array(SIDES) / 2 - shape.points, np.array(SIDES) / 2 + shape.points], axis=1
    )
    return gaps.argmin(axis=1), np.sort(gaps, axis=1)[:, 1]


@pytest.mark.parametrize("longest", [0.2, 0.1, 0.05])
def test_soft_edges_of_a_box(longest):
    """A3 points reach one sample spacing h from an edge; their balls, of radius h, gather samples
    up to sqrt(0.2) h further. The faces at a sample on the edge have
    the mean normal (1, 1)/2; with others on one wall only, (1, 0), at least (3, 1)/4, 0.79 long:
    they turn by 75 degrees or more."""
    shape = forms.box_mesh(SIDES, longest)
    edges = medialis.soft_edges(skeleton(shape))
    distance = box_face(shape)[1]
    assert (edges.radius[distance < 1e-9] < longest).all()
    assert np.isinf(edges.radius[distance > 1.45 * longest]).all()
    assert (edges.angle[np.isinf(edges.radius)] == 0).all()
    on = distance < 1e-9
    assert edges.angle[on].min() > math.radians(70) and edges.sharpness[on].min() > 0.77
    assert edges.on_edge(70)[on].all() and not edges.on_edge(0.0).all()


def test_blunt_edges_have_their_radius():
    """The balls behind the two rounded edges have the radius of the fillet; the set of each is a
    quarter circle, whose normals have a mean of 0.9 (2 acos 0.9 = 52 degrees), and what is flat
    beside its ends, where they turn by 90: between the two."""
    shape = forms.rounded_cylinder(1.0, 1.6, 0.25, 0.04)
    edges = medialis.soft_edges(skeleton(shape))
    reach = np.hypot(shape.points[:, 0], shape.points[:, 1])
    fillet = (reach > 0.8) & (np.abs(shape.points[:, 2]) > 0.6)
    # Samples of a polygon of step h on a circle of radius r: the ball is off by h^2 / (2 r) or so.
    assert np.abs(edges.radius[fillet] - 0.25).max() < 0.02
    turn = np.degrees(edges.angle[fillet])
    assert turn.min() > 52 and turn.max() < 90
    assert np.isinf(edges.radius[(reach < 0.6) | (np.abs(shape.points[:, 2]) < 0.4)]).all()


@pytest.mark.parametrize("longest", [0.2, 0.1, 0.05])
def test_patches_of_a_box_are_its_faces(longest):
    shape = forms.box_mesh(SIDES, longest)
    found = medialis.patches(skeleton(shape, "both"))
    face, distance = box_face(shape)
    assert found.count == 6
    inside = distance > 1e-9  # a sample on an edge belongs to either face
    assert len(np.unique(np.stack([face, found.labels])[:, inside], axis=1).T) == 6
    a, b, c = SIDES
    around = 2 * (a + b)
    assert np.abs(found.areas - np.sort([a * b, a * c, b * c] * 2)[::-1]).max() < around * longest
    assert found.areas.sum() == pytest.approx(2 * (a * b + a * c + b * c))


@pytest.mark.slow
@pytest.mark.parametrize("longest", [0.12, 0.08, 0.05])
def test_patches_of_other_shapes(longest):
    """Prisms: two ends and a wall each side (concave edges need outer balls); cylinders: 3."""
    for outline, sides, inner in ((forms.L_OUTLINE, 6, 5), (forms.T_OUTLINE, 8, 6)):
        shape = forms.prism(outline, 0.8, longest)
        cloud = skeleton(shape, "both")
        assert medialis.patches(cloud).count == 2 + sides
        assert medialis.patches(cloud.subset(cloud.side > 0)).count == 2 + inner
    for fillet in (0.0, 0.25):
        shape = forms.rounded_cylinder(1.0, 1.6, fillet, longest)
        assert medialis.patches(skeleton(shape, "both")).count == 3


def test_sheet_parts_of_a_dumbbell():
    """Two balls and the bar; within two spacings of the necks, where the sides blend, is free."""
    shape = forms.dumbbell(ball=1.0, bar=0.3, half=2.0, step=0.06)
    found = medialis.parts(skeleton(shape), method="sheets")
    z = shape.points[:, 2]
    neck = 2.0 - math.cos(math.asin(0.3))
    assert found.count == 3
    for rows in (z < -neck - 0.12, np.abs(z) < neck - 0.12, z > neck + 0.12):
        assert len(np.unique(found.labels[rows])) == 1
    assert len(np.unique(found.of_faces())) == 3


@pytest.mark.slow
def test_parts_ignore_outer_balls_and_threads():
    shape = forms.box_mesh(SIDES, 0.1)
    found = medialis.parts(skeleton(shape), method="sheets")
    both = medialis.parts(skeleton(shape, "both"), method="sheets")
    assert (found.labels == both.labels).all() and found.count == 13
    with thread_limit(1):
        assert (medialis.parts(skeleton(shape), method="sheets").labels == found.labels).all()
    rough = medialis.parts(skeleton(shape), method="sheets", smoothing=0)
    # Parts behind edges of one length are as large as each other: their order may change.
    pairs = np.unique(np.stack([rough.labels, found.labels]), axis=1, return_counts=True)[1]
    assert np.sort(pairs)[-13:].sum() > 0.9 * len(found.labels)


@pytest.mark.slow
def test_open_surfaces_have_labels_or_say_why():
    """A square has no ball; a box beside it has."""
    box = forms.box_mesh(SIDES, 0.2)
    n = box.point_count
    square = np.array([[5.0, 0, 0], [6, 0, 0], [6, 1, 0], [5, 1, 0]])
    shape = medialis.make_shape(
        np.concatenate([box.points, square]),
        np.concatenate([box.faces, n + np.array([[0, 1, 2], [0, 2, 3]])]),
    )
    result = medialis.run("parts", shape, refine=0)
    labels = result.layers[0].attributes["parts"]
    assert (labels[:n] >= 0).all()
    assert result.values["unlabelled"] == (labels < 0).sum()
    if (labels[n:] < 0).any():
        told = {m.code: m.data for m in result.messages}["samples_unlabelled"]
        assert told["unlabelled"] == result.values["unlabelled"]
    assert (medialis.patches(skeleton(shape)).labels >= 0).all()


@pytest.mark.slow
def test_noise_and_non_manifold_edges_do_not_stop_anything():
    shape = forms.box_mesh(SIDES, 0.1)
    rng = np.random.default_rng(0)
    noisy = medialis.make_shape(shape.points + 0.01 * rng.normal(size=(len(shape.points), 3)),
                                shape.faces)  # fmt: skip
    fan = np.concatenate([shape.faces, [[0, 1, 2], [0, 1, 3]]])
    for bad in (noisy, medialis.make_shape(shape.points, fan)):
        for name in OPERATIONS:
            result = medialis.run(name, bad)
            assert len(result.layers[0].points) > 0
        assert (medialis.parts(skeleton(bad)).labels >= 0).all()


def test_clouds_have_segments():
    form = forms.box_samples(SIDES, 0.05)
    assert medialis.patches(skeleton(form.shape)).labels.min() >= 0
    result = medialis.run("parts", form.shape)
    assert result.values["parts"] >= 13 and result.layers[0].face_attributes == {}


def test_labels_of_faces_are_the_majority_of_their_corners():
    shape = medialis.Shape(np.eye(3), np.eye(3), [[0, 1, 2], [1, 2, 0]])
    for labels, expected in (
        ([1, 1, 0], 1), ([0, 1, 1], 1), ([2, 1, 0], 0), ([-1, -1, 0], -1), ([-1, 1, 2], 1),
    ):  # fmt: skip
        found = medialis.Segmentation(labels, surface=shape)
        assert found.of_faces().tolist() == [expected] * 2 == found.of_input_faces().tolist()
    with pytest.raises(medialis.InvalidShapeError, match="one number for each"):
        medialis.Segmentation([0, 1], surface=shape)


def test_faces_of_the_input_have_the_segment_that_covers_most_of_them():
    """Two triangles, split; (2 / 3)^2, less than half, of the upper one is a segment, or 0.69."""
    corners = [[0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0]]
    fine = medialis.refine(
        medialis.make_shape(corners, [[0, 1, 2], [0, 2, 3]]), longest_edge=0.0235
    )
    x, y, _ = fine.points.T
    for above, expected in ((1.0, [0, 0]), (0.5, [0, 1])):
        found = medialis.Segmentation(np.where(y > x + above, 1, 0), surface=fine)
        assert len(found.of_faces()) == fine.face_count > 1000
        assert found.of_input_faces().tolist() == expected
        assert found.areas[1] == pytest.approx((3 - above) ** 2 / 2, abs=3 * 0.1)


@pytest.mark.slow
def test_late_options_compute_nothing_early_again(monkeypatch):
    """Neither a ball nor a geodesic nor a feature set, by another object of the same shape."""
    box, creature = forms.box_mesh(SIDES, 0.1), medialis.organic_shape(56)
    late = (
        ("parts", creature, ({"smallest": 0.1}, {"smoothing": 0}, {"level": 0.7}, {"count": 3})),
        ("patches", box, ({"smallest": 0.0}, {"min_angle": 80.0})),
        ("mean_shift_segments", creature, ({"fill": False},)),
    )
    with medialis.memory_limit(1 << 30):
        for name, shape, _ in late:
            medialis.run(name, shape)

        def never(*_, **__):
            raise AssertionError

        for module, early in (
            ("skeleton.surface_skeleton", "maximal_balls"),
            ("skeleton.importance.importance", "trace"),
            ("sheets.feature_sets", "_find"),
            ("segments.parts", "share_together"),
            ("segments.mean_shift", "_paths"),
        ):
            monkeypatch.setattr(importlib.import_module(f"medialis.{module}"), early, never)
        with pytest.raises(AssertionError):
            medialis.run("parts", forms.box_mesh(SIDES, 0.3))
        for name, shape, changes in late:
            same = replace(shape, points=shape.points.copy())
            for change in changes:
                assert medialis.run(name, same, **change).layers[0].on_input


def chain(n):
    """A graph 0 - 1 - ... - n-1."""
    rows = [[j for j in (i - 1, i + 1) if 0 <= j < n] for i in range(n)]
    return Ragged(np.cumsum([0] + [len(r) for r in rows]), np.concatenate(rows))


def test_merging_numbering_and_smoothing():
    labels = np.array([0, 0, 0, 1, 2, 2, -1, 3], np.int32)
    weight = np.ones(8)
    merged = merge_small(labels, weight, chain(8), 1.5)  # 1 joins 0, the lower of its neighbours
    assert merged.tolist() == [0, 0, 0, 0, 2, 2, -1, 3]
    all_of_them = merge_small(labels, weight, chain(8), 100.0)
    assert all_of_them.tolist() == [0, 0, 0, 0, 0, 0, -1, 3]  # 3 has no neighbour with a label
    assert numbered_by_weight(merged, weight).tolist() == [0, 0, 0, 0, 1, 1, -1, 2]
    assert piece_counts(np.array([0, 0, 1, 0, -1], np.int32), chain(5)).tolist() == [2, 1]


def test_islands_join_what_is_round_them():
    """An island of 1 in 20 does, and so does not half a label; nor what has no neighbour."""
    labels = np.array([0] * 20 + [1] * 20 + [0] + [1] * 5 + [-1, 0], np.int32)
    points = np.column_stack([np.arange(48.0), np.zeros((48, 2))])
    joined = without_islands(points, labels, np.ones(48), chain(48))
    assert joined.tolist() == [0] * 20 + [1] * 26 + [-1, 0]
    assert piece_counts(labels, chain(48)).tolist() == [3, 2]
    assert (without_islands(points, joined, np.ones(48), chain(48)) == joined).all()


@pytest.mark.slow
@pytest.mark.parametrize("operation", ["parts", "patches", "mean_shift_segments"])
@pytest.mark.parametrize("name", ["slab", "creature"])
def test_segments_are_connected_or_told(name, operation):
    """The sheet in the middle of a slab has two walls, and no piece is an island."""
    shape = {
        "slab": lambda: forms.box_mesh((2.0, 1.5, 0.3), 0.08),
        "creature": lambda: medialis.organic_shape(56),
    }[name]()
    options = {"method": "sheets"} if operation == "parts" and name == "slab" else {}
    result = medialis.run(operation, shape, refine=0, **options)
    name_of = "segment" if operation == "mean_shift_segments" else operation
    labels, graph = result.arrays[name_of], surface_graph(result.shape)
    counts = piece_counts(labels, graph)
    apart = counts[counts > 1]
    told = {m.code: m.data for m in result.messages}.get("segments_not_connected")
    if operation == "parts":
        assert len(apart) == (name == "slab")  # the middle sheet
    if operation == "patches":
        assert len(apart) == 0
    assert (told is not None) == (len(apart) > 0)
    if told:
        assert told["count"] == len(apart) and told["pieces"] == apart.sum()
    area = result.shape.point_areas
    assert (without_islands(result.shape.points, labels, area, graph) == labels).all()


@pytest.fixture(scope="module")
def plain_box():
    """8 vertices, 12 faces."""
    return forms.box_mesh(SIDES, 10.0)


@pytest.mark.parametrize("name", OPERATIONS)
def test_operations_refine_and_tell_counts(plain_box, name):
    options = {"method": "sheets"} if name == "parts" else {}
    result = medialis.run(name, plain_box, refine=0.03, **options)
    values = result.values
    expected = {
        "point_types": {"skeleton_points": len(result.shape.points)},
        "medial_sheets": {"sheets": 13, "y_curves": 12},
        "soft_edges": {},
        "patches": {"patches": 6, "unlabelled": 0},
        "parts": {"parts": 13, "unlabelled": 0},
    }[name]
    assert expected.items() <= values.items()
    if name in ("soft_edges", "patches", "parts"):
        assert result.layers[0].on_input and len(result.layers[0].points) == 8
    if name in ("patches", "parts"):
        assert result.layers[0].labels == (name,)
        assert len(result.layers[0].face_attributes[f"face_{name}"]) == 12
    if name == "patches":  # each face of 2 triangles has a number of its own
        pairs = result.layers[0].face_attributes[f"face_{name}"].reshape(6, 2)
        assert (pairs[:, 0] == pairs[:, 1]).all() and len(set(pairs[:, 0])) == 6
    for layer in result.layers:  # Blender has one list of names for both
        assert not set(layer.attributes) & set(layer.face_attributes)
    assert medialis.draw_result(result, width=200, height=150).shape == (150, 200, 3)
    json.dumps({k: v for k, v in values.items() if k != "scaffold"}, allow_nan=False)


def test_point_types_can_leave_out_the_rim(plain_box):
    every = medialis.run("point_types", plain_box, refine=0.03)
    some = medialis.run("point_types", plain_box, refine=0.03, filter_rim=True)
    left = every.values["skeleton_points"] - every.values["a3_points"]
    assert some.values["skeleton_points"] == left
    assert some.layers[0].attributes["type"].min() == 2


def test_sheet_layers_fit_together(plain_box):
    result = medialis.run("medial_sheets", plain_box, refine=0.03)
    layers = {layer.name: layer for layer in result.layers}
    assert set(layers) == {"medial_sheets", "sheet_meshes", "y_network", "samples"}
    mesh = layers["sheet_meshes"]
    of_corners = mesh.attributes["sheet"][mesh.faces]
    assert (of_corners == mesh.face_attributes["face_sheet"][:, None]).all()
    assert len(result.values["scaffold"]["sheets"]) == 13


@pytest.mark.slow
def test_command_line(plain_box, tmp_path, capsys):
    file = tmp_path / "box.ply"
    write_ply(file, plain_box.points, faces=plain_box.faces)
    for name in OPERATIONS:
        out = tmp_path / name
        assert main([name.replace("_", "-"), str(file), "-o", str(out), "--json"]) == 0
        manifest = json.loads(capsys.readouterr().out)
        assert manifest["operation"] == name and (out / f"{name}.png").exists()


def test_bad_input():
    shape = forms.box_mesh(SIDES, 0.3)
    cloud = skeleton(shape)
    for function in (medialis.patches, medialis.parts):
        with pytest.raises(medialis.InvalidOptionError, match="smallest"):
            function(cloud, smallest=-1)
    with pytest.raises(medialis.InvalidOptionError, match="smoothing"):
        medialis.parts(cloud, smoothing=0.5)
    with pytest.raises(medialis.InvalidOptionError, match="min_angle"):
        medialis.patches(cloud, min_angle=181)
    with pytest.raises(medialis.InvalidShapeError, match="angle must have"):
        rim = np.zeros(len(cloud), bool)
        medialis.SoftEdges(np.zeros(shape.point_count), np.zeros(2), rim, cloud=cloud)
    for function in (medialis.soft_edges, medialis.patches, medialis.parts):
        with pytest.raises(medialis.Cancelled):
            function(cloud, progress=lambda *_: False)
