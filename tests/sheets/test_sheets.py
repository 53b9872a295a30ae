"""Medial sheets, Y-network, sheet meshes and scaffold (thesis 6.2.2)."""

import json
import math
from xml.etree import ElementTree

import networkx
import numpy as np
import pytest
from scipy.spatial import cKDTree

import closed_forms as forms
import medialis
from medialis.base.progress import Progress
from medialis.base.threads import thread_limit
from medialis.sheets.scaffold import smoothed_curves

SIDES = (2.0, 1.5, 1.0)


def separated(shape, **options):
    cloud = medialis.shrink_balls(shape)
    return cloud, medialis.medial_sheets(cloud, **{"smallest": 0.0, **options})


def box_sheet(cloud, sides):
    """The sheet that each ball of a box truly lies on: its two nearest faces; and the third gap."""
    half = np.array(sides) / 2
    gaps = np.concatenate([half - cloud.centers, half + cloud.centers], axis=1)
    nearest = np.sort(np.argsort(gaps, axis=1)[:, :2], axis=1)
    return 6 * nearest[:, 0] + nearest[:, 1], np.sort(gaps, axis=1)[:, 2] - cloud.radii


def rand_index(a, b):
    """Adjusted Rand index of two labellings: 1 where they are the same partition, 0 by chance."""
    table = np.unique(np.stack([a, b], axis=1), axis=0, return_counts=True)[1].astype(float)
    rows = np.unique(a, return_counts=True)[1].astype(float)
    columns = np.unique(b, return_counts=True)[1].astype(float)
    both, left, right = ((x * (x - 1) / 2).sum() for x in (table, rows, columns))
    chance = left * right / (len(a) * (len(a) - 1) / 2)
    return 1.0 if left == right == both else (both - chance) / ((left + right) / 2 - chance)


def flat_wedge(longest):
    return forms.prism(forms.TRIANGLE, 0.8, longest)


CASES = {
    "box": (lambda h: forms.box_mesh(SIDES, h), 13),
    "slab": (lambda h: forms.box_mesh((2.0, 2.0, 0.5), h), 13),
    "wedge": (flat_wedge, 10),
    "L": (lambda h: forms.prism(forms.L_OUTLINE, 0.8, h), 16),
    "T": (lambda h: forms.prism(forms.T_OUTLINE, 0.8, h), 19),
    "flat cylinder": (lambda h: forms.rounded_cylinder(1.0, 1.0, 0, h), 3),
    "tall cylinder": (lambda h: forms.rounded_cylinder(0.5, 2.0, 0, h), 3),
    "rounded cylinder": (lambda h: forms.rounded_cylinder(1.0, 1.6, 0.25, h), 3),
    "dumbbell": (lambda h: forms.dumbbell(step=h), 3),
}
"""Flat prisms: a middle sheet, one behind each convex side edge, and on top and bottom one behind
each edge, where those that meet at a concave corner are one. Cylinders: two cones and the axis, a
disc or a segment. Dumbbell: the middles of the balls and the axis."""


@pytest.mark.slow
@pytest.mark.parametrize("longest", [0.12, 0.08, 0.05])
@pytest.mark.parametrize("name", list(CASES))
def test_closed_forms_have_the_right_number_of_sheets(name, longest):
    """A splinter of 0.12 % in the sharpest corner of the finest wedge is merged."""
    make, count = CASES[name]
    cloud, sheets = separated(make(longest), smallest=0.002)
    assert sheets.count == count
    assert (sheets.labels[cloud.valid] >= 0).all() and sheets.sizes.sum() == cloud.valid.sum()


@pytest.mark.slow
@pytest.mark.parametrize("level", [3, 4, 5])
def test_smooth_closed_forms_have_one_sheet(level):
    ball = forms.icosphere(level)
    axes = np.array([1.0, 0.8, 0.5])
    ellipsoid = medialis.Shape(ball.points * axes, forms.unit(ball.points / axes), ball.faces)
    ring = forms.torus_mesh(12 * 2**level // 2, 6 * 2**level // 2)
    for shape in (ball, ellipsoid, ring):
        assert separated(shape)[1].count == 1


@pytest.mark.parametrize("longest", [0.16, 0.08, 0.04])
def test_every_ball_of_a_box_is_on_its_true_sheet(longest):
    """But for those within a sample spacing of a Y-curve and those that are attached on the rim,
    which take the sheet of the nearest sample and can be wrong only near the corners."""
    shape = forms.box_mesh(SIDES, longest)
    cloud, sheets = separated(shape)
    truth, third = box_sheet(cloud, SIDES)
    clear = sheets.linked & (third > longest)
    assert len(np.unique(truth[clear])) == 13
    pairs = np.unique(np.stack([truth[clear], sheets.labels[clear]], axis=1), axis=0)
    assert len(pairs) == 13  # a bijection
    inside = third > longest
    assert rand_index(truth[inside], sheets.labels[inside]) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "slab", "L", "T", "flat cylinder"])
def test_labels_are_stable_from_half_to_double_density(name):
    """Compared at the samples of the coarser one of two meshes, which has at least four of them
    across its smallest side (fewer tell nothing about the sheets behind its edges)."""
    make, _ = CASES[name]
    steps = (0.12, 0.06, 0.03) if name == "slab" else (0.16, 0.08, 0.04)
    shapes = {longest: make(longest) for longest in steps}
    labels = {longest: separated(shape)[1].labels for longest, shape in shapes.items()}
    for coarse, fine in ((steps[0], steps[1]), (steps[1], steps[2])):
        same = cKDTree(shapes[fine].points).query(shapes[coarse].points)[1]
        assert rand_index(labels[coarse], labels[fine][same]) >= 0.9


def test_threads_order_rotation_and_scale():
    """Samples exactly on a border of two sheets have two second feature points: which one counts
    depends on their order and on rounding. All others, off the rim, have the same sheet."""
    shape = forms.box_mesh(SIDES, 0.1)
    cloud, sheets = separated(shape)
    with thread_limit(1):
        single = medialis.medial_sheets(cloud, smallest=0.0)
    assert (single.labels == sheets.labels).all() and (single.front == sheets.front).all()
    off = sheets.linked & (box_sheet(cloud, SIDES)[1] > 0.1)
    rng = np.random.default_rng(3)
    order = rng.permutation(shape.point_count)
    place = np.argsort(order)
    mixed = medialis.Shape(shape.points[order], shape.normals[order], place[shape.faces])
    assert rand_index(separated(mixed)[1].labels[place][off], sheets.labels[off]) == 1
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    turned = medialis.Shape(7.3 * shape.points @ turn.T + 40.0, shape.normals @ turn.T, shape.faces)
    again = separated(turned)[1]
    assert again.count == 13 and rand_index(again.labels[off], sheets.labels[off]) == 1


@pytest.mark.slow
def test_crossing_nested_and_separate_parts():
    """Two boxes apart are twice 13 sheets; a hollow box has sheets of each wall.

    A box inside another one, facing inwards, makes six walls: their sheets meet at the edges of the
    hole, so there is at least one sheet a wall and none that joins opposite walls.
    """
    one = forms.box_mesh(SIDES, 0.1)
    n = one.point_count
    apart = one.points + np.array([5.0, 0, 0])
    two = medialis.Shape(
        np.concatenate([one.points, apart]), np.tile(one.normals, (2, 1)),
        np.concatenate([one.faces, one.faces + n]),
    )  # fmt: skip
    cloud, sheets = separated(two)
    assert sheets.count == 26
    assert not set(sheets.labels[:n]) & set(sheets.labels[n:])
    hole = medialis.Shape(0.6 * one.points, -one.normals, one.faces[:, ::-1])
    hollow = medialis.Shape(
        np.concatenate([one.points, hole.points]), np.concatenate([one.normals, hole.normals]),
        np.concatenate([one.faces, hole.faces + n]),
    )  # fmt: skip
    cloud, sheets = separated(hollow)
    top = np.abs(one.points[:, :2]).max(axis=1) < 0.4
    up = set(sheets.labels[:n][top & (one.points[:, 2] > 0.49)])
    down = set(sheets.labels[:n][top & (one.points[:, 2] < -0.49)])
    assert len(up) == len(down) == 1 and up != down
    crossing = medialis.Shape(
        np.concatenate([one.points, one.points[:, [2, 0, 1]]]),
        np.concatenate([one.normals, one.normals[:, [2, 0, 1]]]),
        np.concatenate([one.faces, one.faces + n]),
    )
    cloud, sheets = separated(crossing)
    assert sheets.count > 13 and (sheets.labels[cloud.valid] >= 0).all()


@pytest.mark.parametrize("links", [[], [[0, 1]]])
def test_curves_without_length_stay(links):
    points = np.zeros((2, 3))
    curves = smoothed_curves(points, np.array(links, np.int64).reshape(-1, 2))
    assert np.array_equal(curves, points)


def test_thin_walls_are_one_sheet():
    """A plate a third of a sample spacing thick."""
    plate = forms.box_mesh((2.0, 1.5, 0.03), 0.1)
    cloud, sheets = separated(plate)
    assert sheets.sizes[0] > 0.8 * len(cloud)


@pytest.mark.parametrize("longest", [0.16, 0.08, 0.04])
def test_y_network_of_a_box(longest):
    """8 segments from the corners to the middle rectangle, sqrt(3)/2 of its height c each, and its
    sides a - c and b - c, twice each. Every end of the 12 curves is a sample spacing short at most,
    and smoothing takes at most another half.
    """
    a, b, c = SIDES
    shape = forms.box_mesh(SIDES, longest)
    cloud, sheets = separated(shape)
    network = medialis.y_network(sheets)
    exact = 8 * math.sqrt(3) / 2 * c + 2 * (a - c) + 2 * (b - c)
    assert len(network.lengths) == 12
    assert abs(network.lengths.sum() - exact) < 12 * longest * 1.5
    assert (network.meeting >= 0).all()  # three sheets meet along each
    half = np.array(SIDES) / 2
    gaps = np.sort(half - np.abs(network.points), axis=1)
    # Nodes are the middles of two balls that lie beside the curve.
    assert (gaps[:, 2] - gaps[:, 0] >= 0).all()
    from_curve = np.where(
        np.abs(network.points[:, 2]) < 1e-9, gaps[:, 1] - c / 2, gaps[:, 1] - gaps[:, 0]
    )
    assert np.median(np.abs(from_curve)) < longest
    third = box_sheet(cloud, SIDES)[1]
    assert (third[network.near & sheets.linked] < 3 * longest).mean() > 0.95


@pytest.mark.slow
def test_y_networks_of_wedge_and_cylinder():
    """Flat wedge: the outline of the middle triangle, which lies 0.4 inside, and from each of its
    corners (angle t) two segments over 0.4 / sin(t/2) and down 0.4. Flat cylinder: a circle.
    """
    outline = np.array(forms.TRIANGLE)
    sides = np.linalg.norm(outline - np.roll(outline, -1, axis=0), axis=1)
    perimeter, area = sides.sum(), 0.5 * 3.0 * 2.4
    inner = perimeter * (1 - 0.4 / (2 * area / perimeter))
    angles = [math.pi / 2, math.atan2(2.4, 3.0), math.atan2(3.0, 2.4)]
    exact = inner + 2 * sum(math.hypot(0.4 / math.sin(t / 2), 0.4) for t in angles)
    shape = flat_wedge(0.08)
    network = medialis.y_network(separated(shape)[1])
    assert len(network.lengths) == 9 and abs(network.lengths.sum() / exact - 1) < 0.05
    shape = forms.rounded_cylinder(1.0, 1.0, 0, 0.05)
    network = medialis.y_network(separated(shape)[1])
    # The nodes lie beside the circle by less than a spacing: 2 pi 0.05 at most.
    assert len(network.lengths) == 1
    assert abs(network.lengths[0] - math.pi) < 2 * math.pi * 0.05


@pytest.mark.parametrize("longest", [0.16, 0.08, 0.04])
def test_sheet_meshes_of_a_box(longest):
    """Behind an edge of length l: a trapezoid (l and l - c, or a triangle), c/sqrt(2) high.

    A border may be off by a sample spacing in the sheet, which is 1.4 on the surface.
    """
    a, b, c = SIDES
    shape = forms.box_mesh(SIDES, longest)
    cloud, sheets = separated(shape)
    meshes = medialis.sheet_meshes(sheets)
    truth = box_sheet(cloud, SIDES)[0]
    slope = c / math.sqrt(2)
    rim = 2 * math.sqrt(3) / 2 * c
    for number in range(13):
        rows = np.flatnonzero((sheets.labels == number) & sheets.linked)
        key = np.bincount(truth[rows]).argmax()
        axes = {key // 6 % 3, key % 6 % 3}
        if len(axes) == 1:
            area, around = (a - c) * (b - c), 2 * (a - c) + 2 * (b - c)
        else:
            length = SIDES[({0, 1, 2} - axes).pop()]
            area, around = (2 * length - c) / 2 * slope, 2 * length - c + rim
        assert abs(meshes.areas[number] - area) < around * longest
        assert abs(meshes.boundaries[number] - around) < 12 * longest
        single = meshes.sheet(number)
        assert single.area == pytest.approx(meshes.areas[number]) and single.part_count == 1
        edges = np.sort(single.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        assert np.unique(edges, axis=0, return_counts=True)[1].max() <= 2  # each covered once
    assert abs(meshes.mean_radii.max() - c / 2) < longest


def rim_of(mesh):
    """Edges of one triangle."""
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    return edges[count == 1]


def test_a_sheet_with_a_soft_rim_ends_on_it():
    """The skeleton of a spheroid is a disc of radius 3/4 (area 1.767): nothing of it is fringe.

    The last samples lie up to an edge of 0.07 from the equator, their centers 3/4 of that from the
    rim; at a round edge both contacts are close, and the center moves by its square.
    """
    shape = forms.spheroid()
    mesh = medialis.sheet_meshes(separated(shape)[1]).mesh
    radii = np.hypot(*mesh.points[np.unique(rim_of(mesh))].T[:2])
    outer = radii[radii > 0.5]
    assert outer.min() > 0.75 - 0.02 and outer.max() <= 0.75 + 1e-3
    assert outer.std() < 0.05 * 0.07
    assert abs(mesh.area - math.pi * 0.75**2) < 2 * math.pi * 0.75 * 0.02


def test_fringes_of_spikes_are_left_out(monkeypatch):
    """Fixed: rims at soft edges were rows of spikes. Linked balls keep all their triangles."""
    _, sheets = separated(medialis.organic_shape(64))
    clean = medialis.sheet_meshes(sheets)
    monkeypatch.setattr("medialis.sheets.scaffold.LOOSE", 1.0)
    with medialis.memory_limit(0):
        frayed = medialis.sheet_meshes(sheets)
    lengths = []
    for meshes in (frayed, clean):
        mesh = meshes.mesh
        rim = rim_of(mesh)
        lengths.append(np.linalg.norm(mesh.points[rim[:, 0]] - mesh.points[rim[:, 1]], axis=1))
        assert len(meshes.radii) == len(mesh.points) == len(meshes.point_sheet)
        assert (meshes.point_sheet[mesh.faces] == meshes.face_sheet[:, None]).all()
    assert lengths[1].sum() < 0.9 * lengths[0].sum()
    linked = sheets.cloud.centers[sheets.linked]
    gap = cKDTree(clean.mesh.points).query(linked)[0] - cKDTree(frayed.mesh.points).query(linked)[0]
    assert np.quantile(gap, 0.99) < 2 * sheets.cloud.surface.spacing


def test_scaffold_tells_which_sheets_meet():
    shape = forms.box_mesh(SIDES, 0.08)
    _, sheets = separated(shape)
    scaffold = medialis.medial_scaffold(sheets)
    plain = json.loads(json.dumps(scaffold.as_dict(), allow_nan=False))
    assert len(plain["sheets"]) == 13 and len(plain["curves"]) == 12
    # The middle sheet ends on 4 curves; one behind an edge on 2 at its ends, and on one there.
    count = np.bincount(scaffold.links[:, 1], minlength=13)
    assert sorted(count) == [2] * 4 + [3] * 8 + [4]
    graph = networkx.parse_graphml(scaffold.graphml())
    assert graph.number_of_nodes() == 25 and graph.number_of_edges() == 36
    assert graph.nodes["s0"]["kind"] == "sheet" and graph.nodes["c0"]["length"] > 0


@pytest.mark.slow
def test_small_sheets_are_merged_into_neighbours():
    shape = forms.box_mesh(SIDES, 0.08)
    # Behind the edges along c: two triangles of height c/2, 4 % of the surface each.
    counts = [separated(shape, smallest=s)[1].count for s in (0.0, 0.02, 0.06, 1.0)]
    assert counts == [13, 13, 9, 1]


def test_both_sides_share_no_sheet():
    shape = forms.torus_mesh()
    cloud = medialis.shrink_balls(shape, side="both")
    sheets = medialis.medial_sheets(cloud, smallest=0.0)
    inner, outer = (set(sheets.labels[cloud.valid & (cloud.side == s)]) for s in (1, -1))
    assert inner and outer and not inner & outer
    network = medialis.y_network(sheets)
    assert len(network.near) == len(cloud)


def test_clouds_have_sheets_and_points_but_no_curves():
    form = forms.box_samples(SIDES, 0.05)
    cloud, sheets = separated(form.shape)
    assert sheets.count >= 13 and sheets.sizes[:13].sum() > 0.95 * cloud.valid.sum()
    network = medialis.y_network(sheets)
    assert network.near.any() and len(network.points) == len(network.lengths) == 0
    bare = medialis.medial_scaffold(sheets)
    assert bare.meshes is None and bare.as_dict()["sheets"][0]["area"] is None
    assert "area" not in {
        data.get("key") for data in ElementTree.fromstring(bare.graphml()).iter() if data.text
    }
    with pytest.raises(medialis.InvalidShapeError, match="point cloud"):
        medialis.sheet_meshes(sheets)


def test_masked_balls_have_no_sheet():
    square = medialis.make_shape(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
    )
    _, sheets = separated(square)
    assert (sheets.labels == -1).all() and sheets.count == 0
    network = medialis.y_network(sheets)
    meshes = medialis.sheet_meshes(sheets)
    assert not network.near.any() and len(meshes.mesh.faces) == 0
    assert medialis.medial_scaffold(sheets).as_dict() == {
        "sheets": [], "curves": [],
    }  # fmt: skip


def test_a_coarse_shape_is_one_sheet():
    """No ball of a cube of 8 vertices can be linked."""
    cloud, sheets = separated(forms.cube())
    assert set(sheets.labels[cloud.valid]) <= {0}


def test_bad_input():
    shape = forms.box_mesh(SIDES, 0.3)
    cloud, sheets = separated(shape)
    twice = cloud.subset(np.r_[0 : len(cloud), 0 : len(cloud)])
    with pytest.raises(medialis.InvalidShapeError, match="several balls"):
        medialis.medial_sheets(twice)
    with pytest.raises(medialis.InvalidOptionError, match="sheet_threshold"):
        medialis.medial_sheets(cloud, sheet_threshold=1)
    with pytest.raises(medialis.InvalidOptionError, match="smallest"):
        medialis.medial_sheets(cloud, smallest=1.1)
    with pytest.raises(medialis.InvalidOptionError, match="neighbours"):
        medialis.y_network(sheets, neighbours=0)
    nine = np.zeros(9, bool)
    with pytest.raises(medialis.InvalidShapeError, match="labels must have shape"):
        medialis.MedialSheets(
            np.full(9, -1), nine, nine, sheets.node_labels, sheets.node_front,
            unfolded=sheets.unfolded,
        )  # fmt: skip
    with pytest.raises(medialis.InvalidShapeError, match="There are sheets"):
        medialis.sheet_meshes(sheets).sheet(999)
    for function, data in (
        (medialis.medial_sheets, cloud), (medialis.y_network, sheets),
        (medialis.sheet_meshes, sheets), (medialis.medial_scaffold, sheets),
    ):  # fmt: skip
        with pytest.raises(medialis.Cancelled):
            function(data, progress=lambda *_: False)


def test_other_small_sheets_are_merged_without_linking_again():
    """The feature sets and the links are kept; results are those of a computation from scratch."""
    cloud = medialis.shrink_balls(forms.box_mesh(SIDES, 0.08))
    fresh = [medialis.medial_sheets(cloud, smallest=s) for s in (0.0, 0.06)]
    with medialis.memory_limit(1 << 30):
        medialis.medial_sheets(cloud, smallest=0.02)
        stages = Progress()
        again = [medialis.medial_sheets(cloud, smallest=s, progress=stages) for s in (0.0, 0.06)]
    assert "feature sets" not in stages.seconds
    for one, other in zip(fresh, again, strict=True):
        for name in ("labels", "linked", "front"):
            assert np.array_equal(getattr(one, name), getattr(other, name))
