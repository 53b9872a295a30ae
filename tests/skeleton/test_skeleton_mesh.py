"""The surface-skeleton mesh against closed forms, its two criteria, and invariances."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from closed_forms import elliptic_torus, spheroid
from medialis.base.errors import Cancelled, InvalidOptionError, InvalidShapeError
from medialis.base.threads import thread_limit
from medialis.shape.shape import Shape
from medialis.skeleton._ball_kernels import in_balls
from medialis.skeleton.medial_cloud import shrink_balls as surface_skeleton
from medialis.skeleton.skeleton_mesh import RADIUS_SLACK, SkeletonMesh

ALL = {"min_spoke_angle": 0.0, "smallest_piece": 0.0, "clean_rims": False}
GRID = np.linspace(0, 1, 6)
SAMPLES = [(u, v, 1 - u - v) for u in GRID for v in GRID if u + v <= 1]


def skeleton_mesh(cloud, **options):
    """The mesh of all balls and pieces."""
    return medialis.skeleton_mesh(cloud, **{**ALL, **options})


def longest_edge(shape):
    return np.linalg.norm(np.diff(shape.points[shape.edges], axis=1), axis=2).max()


def inside_points(mesh):
    """21 points of every triangle, corners included, (21 t, 3)."""
    return np.einsum("sj,tjk->stk", SAMPLES, mesh.points[mesh.faces]).reshape(-1, 3)


def check_mesh(shape, cloud, mesh, thinned=False):
    """Check all that is promised of every mesh."""
    assert mesh.selected[mesh.rows].all() and (mesh.selected == cloud.valid).all()
    assert cloud.valid[mesh.rows].all() and (np.diff(mesh.rows) > 0).all()
    assert np.array_equal(mesh.points, cloud.centers[mesh.rows])
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.points)))
    corners = np.sort(mesh.faces, axis=1)
    assert (np.diff(corners, axis=1) > 0).all()
    assert len(np.unique(corners, axis=0)) == len(corners)
    assert (mesh.face_origin >= 0).all() and (mesh.face_origin < shape.face_count).all()
    # Criterion 2: the balls, larger by the longest side of the face, cover the triangle. A face
    # whose gaps are bridged is at most 2 bridge + 1 = 5 edges wide.
    row = mesh.rows[mesh.faces]
    origin = shape.points[shape.faces[mesh.face_origin]]
    reach = np.linalg.norm(origin - np.roll(origin, 1, axis=1), axis=2).max(axis=1)
    reach = 5 * longest_edge(shape) + 0 * reach if thinned else reach
    at = np.einsum("sj,tjk->stk", SAMPLES, mesh.points[mesh.faces])
    gap = np.linalg.norm(at[:, :, None] - mesh.points[mesh.faces][None], axis=3)
    assert ((gap - cloud.radii[row]).min(axis=2) <= reach + 1e-9 * shape.diagonal).all()


@pytest.mark.slow
def test_flat_box():
    """A plate 4 x 3 x 1: in the middle a rectangle 3 x 2, around it bisectors of the edges.

    Triangles that reach from the rectangle to a bisector are counted with neither, and where the
    sheets meet a strip can be doubled: both within an edge h of the border of length 10. A point is
    on the skeleton when its two smallest wall distances agree: as for the cube (tests/operations)
    within h^2/(2 r) and twice the tolerance, for balls of more than two spacings.
    """
    shape = forms.box_mesh((4.0, 3.0, 1.0), 0.07)
    h = longest_edge(shape)
    cloud = surface_skeleton(shape, tolerance=0.0)
    mesh = skeleton_mesh(cloud)
    check_mesh(shape, cloud, mesh)
    flat = (np.abs(mesh.points[:, 2]) < 1e-9)[mesh.faces].all(axis=1)
    assert abs(mesh.face_areas[flat].sum() - 6) <= 10 * h
    r = cloud.radii[mesh.rows]
    half = np.array([2, 1.5, 0.5])
    walls = np.hstack([half - mesh.points, half + mesh.points])
    walls = np.sort(walls, axis=1)[r > 2 * h]
    assert ((walls[:, 1] - walls[:, 0]) <= h**2 / (2 * r[r > 2 * h])).all()
    # All sheets: 8 trapezoids and 4 triangles at 45 degrees. Near the edges of the box balls are
    # smaller than the spacing; a strip sqrt(2) 2h wide along all 32 of edge length may be missing,
    # and one h wide be doubled along all curves where sheets meet (10 + 8 sqrt(3)/2).
    whole = 6 + np.sqrt(0.5) * (4 * 3.5 + 4 * 2.5) + 4 * np.sqrt(0.5) / 2
    meets = 10 + 8 * np.sqrt(3) / 2
    assert whole - 32 * np.sqrt(2) * 2 * h <= mesh.area <= whole + meets * h
    assert mesh.part_count == 1


@pytest.mark.parametrize("tolerance", [0.0, 3e-4])
def test_oblate_spheroid_is_a_disc(tolerance):
    """All of the disc is there, once, and nothing else.

    A sample (x, y, z) has the center 3/4 (x, y), so lifted edges are at most h long. At the rim the
    last triangles span z = 0 and are flat, so the disc is complete up to a strip of h; the tubes of
    error of `ClosedForm.excess` are far thinner. A seam can double a strip of h along a diameter.
    """
    shape = spheroid()
    h = 0.75 * longest_edge(shape) + 2 * tolerance * shape.diagonal
    cloud = surface_skeleton(shape, tolerance=tolerance)
    mesh = skeleton_mesh(cloud)
    check_mesh(shape, cloud, mesh)
    disc = np.pi * 0.75**2
    assert disc - 2 * np.pi * 0.75 * h <= mesh.area <= disc + (2 * np.pi * 0.75 + 2 * 0.75) * h
    assert mesh.part_count == 1
    at = inside_points(mesh)
    assert np.hypot(at[:, 0], at[:, 1]).max() <= 0.75 + h
    assert (at**2 / np.array([1, 1, 0.25])).sum(axis=1).max() < 1
    # Of the two sides one is left: half of the samples.
    assert 0.4 <= len(mesh.points) / shape.point_count <= 0.6


def test_elliptic_torus_is_a_ring():
    """The ring of width 2 (p^2 - q^2)/p, area 4 pi R (p^2 - q^2)/p, in one piece with its hole.

    A lifted edge is stretched like the plane ellipse at most: the center moves by (1 - q^2/p^2) of
    the edge across, by all of it along. Strips of an edge at both rims, the two seams besides.
    """
    shape = elliptic_torus()
    h, f = longest_edge(shape), (0.3**2 - 0.12**2) / 0.3
    cloud = surface_skeleton(shape)
    mesh = skeleton_mesh(cloud)
    check_mesh(shape, cloud, mesh)
    assert mesh.part_count == 1
    assert abs(mesh.area - 4 * np.pi * f) <= 4 * np.pi * h
    at = inside_points(mesh)
    ring = np.hypot(at[:, 0], at[:, 1]) - 1
    assert np.abs(ring).max() <= f + h
    assert ((ring / 0.3) ** 2 + (at[:, 2] / 0.12) ** 2).max() < 1


def test_round_tube_stays_on_its_circle():
    """The skeleton of a torus is a curve: slivers within the error of the balls.

    The mirror of each sample is a sample (24 across), so a ball is right up to the tolerance: it
    grows by at most T (1 + (1 - cos a)/...) < 2 T where a second sample within 15 degrees of the
    opposite one is found instead.
    """
    shape = forms.torus_mesh()
    cloud = surface_skeleton(shape)
    mesh = skeleton_mesh(cloud)
    check_mesh(shape, cloud, mesh)
    t = 2 * 3e-4 * shape.diagonal
    at = inside_points(mesh)
    h = 2 * np.pi / 48  # chords of the circle
    assert np.hypot(np.hypot(at[:, 0], at[:, 1]) - 1, at[:, 2]).max() <= t + h**2 / 8 * 4
    assert mesh.area <= 2 * np.pi * 24 * (t + h**2 / 8)


def test_walls_thinner_than_the_spacing_have_no_holes():
    """Balls of a thin wall do not meet (fixed: a scapula's blade was in tatters).

    Only at the rim, where the side of the plate is no higher than a fifth of an edge, the strip of
    two edges from both sides and the side itself can lie on each other.
    """
    shape = forms.box_mesh((4.0, 3.0, 0.02), 0.12)
    h = longest_edge(shape)
    mesh = skeleton_mesh(surface_skeleton(shape))
    assert abs(mesh.area - 12) <= 14 * 2 * h


def test_sphere_has_no_sheet():
    """All centers are the center: what remains is a speck within the tolerance."""
    shape = forms.icosphere(3)
    mesh = skeleton_mesh(surface_skeleton(shape))
    assert mesh.area <= 4 * np.pi * (2 * 3e-4 * shape.diagonal) ** 2 * 20
    assert len(skeleton_mesh(surface_skeleton(shape), smallest_piece=0.01).faces) == 0


def test_radius_rises_no_steeper_than_on_a_sheet(monkeypatch):
    """Criterion 1, by plain numpy, of the triangles that stand for themselves; every face is
    either kept, replaced, or breaks a criterion."""
    shape = medialis.organic_shape(64)
    cloud = surface_skeleton(shape)
    mesh = skeleton_mesh(cloud, bridge=0)
    check_mesh(shape, cloud, mesh)
    row = mesh.rows[mesh.faces]
    own = (row == shape.faces[mesh.face_origin]).all(axis=1)
    assert 0.5 < own.mean() < 1
    for j in range(3):
        a, b = row[own, j], row[own, (j + 1) % 3]
        run = np.linalg.norm(cloud.centers[a] - cloud.centers[b], axis=1)
        step = np.linalg.norm(shape.points[a] - shape.points[b], axis=1)
        slope = (np.cos(cloud.spoke_angles[a] / 2) + np.cos(cloud.spoke_angles[b] / 2)) / 2
        rise = np.abs(cloud.radii[a] - cloud.radii[b])
        assert (rise <= slope * run + RADIUS_SLACK * step + 1e-12).all()
    monkeypatch.setattr("medialis.skeleton.skeleton_mesh.RADIUS_SLACK", 1000.0)
    more = skeleton_mesh(cloud, bridge=0)
    assert len(more.faces) >= len(mesh.faces)


def test_a_ball_out_of_line_is_cut_out():
    """A jump along the spokes (here: balls halved by hand) is no sheet; its neighbours stay."""
    shape = forms.box_mesh((4.0, 3.0, 1.0), 0.1)
    cloud = surface_skeleton(shape)
    middle = np.flatnonzero((np.abs(shape.points[:, :2]) < 0.5).all(1) & (cloud.radii > 0.49))
    odd = middle[len(middle) // 4]
    centers, radii = cloud.centers.copy(), cloud.radii.copy()
    radii[odd] = 0.2
    centers[odd] = shape.points[odd] - 0.2 * shape.normals[odd]
    bad = medialis.MedialCloud(
        centers, radii, cloud.features, cloud.source, cloud.status, cloud.spoke_angles, cloud.side,
        surface=shape,
    )  # fmt: skip
    assert odd not in skeleton_mesh(bad).rows
    assert skeleton_mesh(bad).area > 0.97 * skeleton_mesh(cloud).area


@pytest.mark.slow
def test_three_balls_cover_a_triangle():
    """`in_balls` against 20000 points of each of 400 random triangles.

    It never claims too much; where the balls meet in pairs it misses nothing but the slits that
    the points miss.
    """
    rng = np.random.default_rng(3)
    weights = rng.dirichlet((0.7, 0.7, 0.7), 20000)
    met = agree = 0
    for _ in range(400):
        corners, r = rng.normal(size=(3, 2)), rng.uniform(0.2, 2.0, 3)
        sides = [np.linalg.norm(corners[(j + 1) % 3] - corners[(j + 2) % 3]) for j in range(3)]
        at = weights @ corners
        covered = (np.linalg.norm(at[:, None] - corners, axis=2) <= r).any(axis=1).all()
        claimed = in_balls(*sides, *r)
        assert covered or not claimed
        meets = all(sides[j] <= r[j - 1] + r[j - 2] for j in range(3))
        met += meets
        agree += meets and covered == claimed
    assert met > 150 and agree >= 0.99 * met
    assert in_balls(0.0, 0.0, 0.0, 1.0, 1.0, 1.0) and in_balls(1.0, 1.0, 0.0, 0.5, 0.5, 0.5)


def test_gaps_of_left_out_points_are_bridged():
    """Every third point is dropped: without bridges the disc is in tatters, with them whole."""
    shape = spheroid()
    cloud = surface_skeleton(shape)
    thin = cloud.subset(np.random.default_rng(0).random(len(cloud)) < 0.67)
    whole = skeleton_mesh(cloud)
    torn = skeleton_mesh(thin, bridge=0)
    mended = skeleton_mesh(thin, bridge=2)
    check_mesh(shape, thin, torn, thinned=True)
    check_mesh(shape, thin, mended, thinned=True)
    # A face has all its corners with probability 0.3 from either side of the sheet.
    assert torn.area < 0.8 * whole.area
    h = 0.75 * 3 * longest_edge(shape)  # two edges from either side and one between
    assert abs(mended.area - whole.area) <= 2 * np.pi * 0.75 * h
    assert skeleton_mesh(cloud.subset([])).faces.shape == (0, 3)
    assert np.array_equal(skeleton_mesh(cloud.subset(cloud.valid)).faces, whole.faces)


@pytest.mark.slow
def test_points_are_chosen_by_angle_and_importance():
    """The points left out are as if the cloud had none of them; what is kept is the same mesh."""
    cloud = surface_skeleton(medialis.organic_shape(64))
    mesh = medialis.skeleton_mesh(
        cloud, min_spoke_angle=60.0, importance=0.05, smallest_piece=0.0, clean_rims=False
    )
    connected = medialis.connected_importance(medialis.geodesic_importance(cloud)).length
    enough = cloud.valid & (np.degrees(cloud.spoke_angles) >= 60.0)
    enough &= connected >= 0.05 * cloud.surface.diagonal
    assert 0 < enough.sum() < cloud.valid.sum() and np.array_equal(mesh.selected, enough)
    by_hand = skeleton_mesh(cloud.subset(enough))
    assert np.array_equal(mesh.faces, by_hand.faces)
    assert np.array_equal(mesh.rows, np.flatnonzero(enough)[by_hand.rows])


def test_another_smallest_piece_takes_the_same_triangles(monkeypatch):
    cloud = surface_skeleton(spheroid(3))
    fresh = skeleton_mesh(cloud, smallest_piece=0.01)
    with medialis.memory_limit(1 << 30):
        skeleton_mesh(cloud)
        monkeypatch.setattr("medialis.skeleton.skeleton_mesh._lift_side", None)  # not called again
        again = skeleton_mesh(cloud, smallest_piece=0.01)
    assert np.array_equal(again.faces, fresh.faces) and np.array_equal(again.rows, fresh.rows)


def test_small_pieces_are_left_out():
    big, small = spheroid(3), spheroid(2)
    points = np.concatenate([big.points, 0.1 * small.points + [3, 0, 0]])
    faces = np.concatenate([big.faces, small.faces + len(big.points)])
    shape = Shape(points, np.concatenate([big.normals, small.normals]), faces)
    cloud = surface_skeleton(shape)
    assert skeleton_mesh(cloud).part_count == 2
    mesh = skeleton_mesh(cloud, smallest_piece=0.08 / shape.diagonal)
    check_mesh(shape, cloud, mesh)
    assert mesh.part_count == 1 and mesh.points[:, 0].max() < 1
    pieces = skeleton_mesh(cloud, smallest_piece=0.05 / shape.diagonal)
    assert pieces.part_count == 2


def test_both_sides_are_meshed_apart():
    shape = elliptic_torus(80, 24)
    both = surface_skeleton(shape, side="both")
    mesh = skeleton_mesh(both)
    inner = skeleton_mesh(surface_skeleton(shape))
    outer = skeleton_mesh(surface_skeleton(shape, side="outer"))
    assert len(mesh.faces) == len(inner.faces) + len(outer.faces)
    assert np.array_equal(mesh.points[: len(inner.points)], inner.points)
    side = both.side[mesh.rows[mesh.faces]]
    assert (side == side[:, :1]).all()


def test_scale_rotation_order_and_threads():
    shape = medialis.organic_shape(64)
    cloud = surface_skeleton(shape)
    mesh = skeleton_mesh(cloud)
    with thread_limit(1):
        single = skeleton_mesh(cloud)
    for name in ("points", "faces", "rows", "face_origin"):
        assert np.array_equal(getattr(mesh, name), getattr(single, name))
    # A power of two changes no digit, at any size.
    for scale in (2.0**-60, 2.0**60):
        moved = Shape(shape.points * scale, shape.normals, shape.faces)
        scaled = skeleton_mesh(surface_skeleton(moved))
        assert np.array_equal(scaled.faces, mesh.faces)
        assert np.array_equal(scaled.points, mesh.points * scale)
    # Rounding flips only comparisons that are ties to 1e-12: on a shape without symmetry none.
    q = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    q *= np.sign(np.linalg.det(q))
    turned = Shape(shape.points @ q.T, shape.normals @ q.T, shape.faces)
    turned_cloud = medialis.MedialCloud(
        cloud.centers @ q.T, cloud.radii, cloud.features, cloud.source, cloud.status,
        cloud.spoke_angles, cloud.side, surface=turned,
    )  # fmt: skip
    rotated = skeleton_mesh(turned_cloud)
    assert rotated.area == pytest.approx(mesh.area, rel=1e-3)
    # Another order of the samples may choose the other side of a sheet and put seams elsewhere.
    order = np.random.default_rng(2).permutation(shape.point_count)
    place = np.argsort(order)
    shuffled = Shape(shape.points[order], shape.normals[order], place[shape.faces])
    other = skeleton_mesh(surface_skeleton(shuffled))
    assert other.area == pytest.approx(mesh.area, rel=0.05)


def test_bad_input_is_refused():
    shape = spheroid(2)
    cloud = surface_skeleton(shape)
    bare = surface_skeleton(Shape(shape.points, shape.normals))
    with pytest.raises(InvalidShapeError, match="needs a surface with faces"):
        skeleton_mesh(bare)
    with pytest.raises(InvalidShapeError, match="several balls"):
        skeleton_mesh(cloud.subset(np.r_[0, np.arange(len(cloud))]))
    for options in (
        {"min_spoke_angle": 181}, {"importance": -1}, {"bridge": -1}, {"bridge": 1.5},
        {"smallest_piece": 2},
    ):  # fmt: skip
        with pytest.raises(InvalidOptionError, match=next(iter(options))):
            skeleton_mesh(cloud, **options)
    with pytest.raises(Cancelled):
        skeleton_mesh(cloud, progress=lambda fraction, text: False)
    with pytest.raises(InvalidShapeError, match="rows must have shape"):
        SkeletonMesh(np.zeros((3, 3)), [[0, 1, 2]], [0], [0], cloud=cloud, selected=cloud.valid)


def test_operation_tells_when_nothing_is_left():
    sphere = forms.icosphere(2)
    with pytest.raises(InvalidShapeError, match="No triangle is left"):
        medialis.run("skeleton_mesh", sphere)
    with pytest.raises(InvalidShapeError, match="got a point cloud"):
        medialis.run("skeleton_mesh", Shape(sphere.points, sphere.normals))
    result = medialis.run("skeleton_mesh", spheroid(4), min_spoke_angle=0, refine=0)
    layer = result.layers[0]
    assert result.values["pieces"] == 1 and result.values["faces"] == len(layer.faces)
    radii = result.arrays["radii"][result.arrays["mesh_rows"]]
    inside = np.setdiff1d(np.arange(len(radii)), result.arrays["rim_points"])
    assert len(inside) > 0.9 * len(radii)
    assert np.array_equal(layer.attributes["radius"][inside], radii[inside])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scapula", "spider", "gears", "counter", "face", "cow"])
def test_real_shapes(name, real_shapes):
    """Open, non-manifold and coarse meshes: finite, valid, no stray triangle.

    A triangle wider than a fifth of the size would cross the shape; sheets have none at these
    resolutions (fewer than one sample in five along a limb).
    """
    shape = medialis.read_shape(real_shapes / f"{name}.ply")
    result = medialis.run("skeleton_mesh", shape, min_spoke_angle=30.0)
    layer = result.layers[0]
    corners = layer.points[layer.faces]
    assert np.isfinite(layer.points).all()
    assert (
        np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() < 0.2 * shape.diagonal
    )


def test_operation_does_not_advise_to_lower_what_removed_nothing():
    """Where all balls were kept and samples were too few, the angle was blamed."""
    box = forms.cube()
    parts = [box.points * 0.005 + [x, 0, 0] for x in np.linspace(0, 1, 9)]
    faces = np.concatenate([box.faces + 8 * at for at in range(9)])
    with pytest.raises(InvalidShapeError, match="Lower smallest_piece, or refine"):
        medialis.run("skeleton_mesh", medialis.make_shape(np.concatenate(parts), faces))
