"""Midsurfaces of walls: counts, places, areas and thickness against what is known of each part."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import medialis
import plates
from medialis.base.errors import InvalidShapeError

TURN = np.linalg.qr(np.array([[0.8, 0.3, -0.5], [0.2, 0.9, 0.4], [0.6, -0.4, 0.7]]))[0]


def middle_of(mesh, across, thickness, *, edge=None):
    """The midsurface of a part whose faces have `across` samples over a wall, or nearly."""
    shape = medialis.make_shape(*mesh)
    longest = min(1.5 * thickness / across, 0.05 * shape.diagonal)
    cloud = medialis.surface_skeleton(shape, refine=longest / shape.diagonal)
    return medialis.midsurface(cloud, edge=(edge or 1.5 * thickness) / shape.diagonal)


def smallest_angles(found):
    points, faces = found.points, found.faces
    result = []
    for j in range(3):
        u = points[faces[:, (j + 1) % 3]] - points[faces[:, j]]
        v = points[faces[:, (j + 2) % 3]] - points[faces[:, j]]
        sine = np.linalg.norm(np.cross(u, v), axis=1)
        result.append(np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", u, v))))
    return np.min(result, axis=0)


def areas(found):
    return [found.of_sheet(number)["area"] for number in range(found.sheets)]


def thicknesses(found):
    return [found.of_sheet(number)["thickness_mean"] for number in range(found.sheets)]


def planes(*given):
    """Distance to the nearest of some planes (axis, height)."""
    return lambda p: np.min([np.abs(p[:, axis] - height) for axis, height in given], axis=0)


BRACKET = [(2, 2.0), (1, 2.0), *[(0, x) for x in (15.0, 45.0, 75.0, 105.0)]]
BOX = [(2, 1.5), (0, 1.5), (0, 98.5), (1, 1.5), (1, 78.5)]

FLAT = {
    # part: mesh, thickness, sheets, welds, areas, thickness of each sheet, distance to the truth
    "i_beam": (plates.i_beam, 10.0, 3, 2, [24000, 24000, 21000], [10, 10, 15],
               planes((1, 35.0), (1, -35.0), (0, 0.0))),
    "tee": (plates.tee, 4.0, 2, 1, [3000, 2520], [4, 4], planes((1, 42.0), (0, 0.0))),
    "cross": (plates.cross, 4.0, 2, 1, [3600, 3600], [4, 4], planes((1, 0.0), (0, 0.0))),
    "angle": (plates.angle_plate, 4.0, 2, 1, [2880, 2280], [4, 4], planes((1, 2.0), (0, 2.0))),
    "bracket": (plates.bracket, 3.0, 6, 9, [8160, 6960, *4 * [43 * 48]], [4, 4, 3, 3, 3, 3],
                planes(*BRACKET)),
    "box": (plates.open_box, 3.0, 5, 8, [97 * 77, *2 * [97 * 48.5], *2 * [77 * 48.5]], 5 * [3],
            planes(*BOX)),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("across", [3, 6])
@pytest.mark.parametrize("name", FLAT)
def test_flat_walls_have_their_sheets_welds_areas_and_thickness(name, across):
    """Counts are exact; places within 0.5 % of the thickness, areas 1 %, thickness 0.5 %."""
    make, thickness, sheets, welds, area, thick, off = FLAT[name]
    found = middle_of(make(), across, thickness)
    assert (found.sheets, found.welds) == (sheets, welds)
    assert np.allclose(areas(found), area, rtol=0.01)
    assert np.allclose(thicknesses(found), thick, rtol=0.005)
    assert off(found.points).max() < 0.005 * thickness
    assert np.quantile(smallest_angles(found), 0.01) > 20
    assert found.lumps == ()


def off_sphere(p):
    return np.abs(np.linalg.norm(p, axis=1) - 12)


def off_cone(p):
    return np.abs(18 * (np.hypot(p[:, 0], p[:, 1]) - 10) - 6 * p[:, 2]) / np.hypot(6, 18)


def off_wave(p):
    line = plates.wave(np.linspace(0, 40, 40001))  # 0.001 apart
    return cKDTree(line).query(p[:, :2])[0]


WAVE = np.linalg.norm(np.diff(plates.wave(np.linspace(0, 40, 2001)), axis=0), axis=1).sum()

CURVED = {
    # part: mesh, thickness, area, distance to the smooth middle, how far facets are off that at
    # most: chords c of a circle of radius r by c * c / (8 r)
    "sphere shell": (lambda: plates.sphere_shell(14.0, 10.0), 4.0, 4 * np.pi * 144, off_sphere,
                     0.69**2 / (8 * 14)),
    "frustum": (lambda: plates.cone_shell(around=200, low=(10.0, 0.0), high=(16.0, 18.0)), 4.0,
                np.pi * 26 * np.hypot(6, 18), off_cone, 18 * (1 - np.cos(np.pi / 200))),
    "corrugated sheet": (lambda: plates.corrugated(waves=1, steps=100, width=16.0), 2.0,
                         16 * WAVE, off_wave, 0.4**2 * 6 * (2 * np.pi / 40) ** 2 / 8),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("across", [3, 6])
@pytest.mark.parametrize("name", CURVED)
def test_curved_walls_have_one_sheet_in_their_middle(name, across):
    """The true middle is that of the smooth body: facets are fine enough for the bound of 0.5 %."""
    make, thickness, area, off, facets = CURVED[name]
    assert facets < 0.0025 * thickness
    found = middle_of(make(), across, thickness, edge=thickness / 2)
    assert (found.sheets, found.welds) == (1, 0)
    assert off(found.points).max() < 0.005 * thickness
    assert found.thickness == pytest.approx(thickness, rel=0.005)
    assert found.of_sheet(0)["area"] == pytest.approx(area, rel=0.01)
    assert np.quantile(smallest_angles(found), 0.01) > 20
    assert found.lumps == ()


@pytest.mark.slow
@pytest.mark.parametrize("across", [3, 6])
def test_a_step_has_two_sheets_that_meet_in_a_weld(across):
    """Between 4 and 6 the middles are at 2 and 3; the weld lies between them."""
    found = middle_of(plates.step(), across, 4.0)
    assert (found.sheets, found.welds) == (2, 1)
    assert np.allclose(sorted(thicknesses(found)), [4, 6], rtol=0.005)
    ends = found.points[np.unique(found.weld_edges)]
    # At the rim it may be a sample beside.
    inner = (ends[:, 2] > 1e-6) & (ends[:, 2] < 60 - 1e-6)
    assert np.allclose(ends[inner, 0], 0.0, atol=1e-6)
    assert np.abs(ends[:, 0]).max() < 1.5 * 4.0 / across
    away = np.abs(found.points[:, 0]) > 8.0  # farther than an element
    height = np.where(found.points[:, 0] > 0, 3.0, 2.0)
    assert np.abs(found.points[:, 1] - height)[away].max() < 0.005 * 4.0


@pytest.mark.slow
def test_the_vertices_of_a_weld_are_shared_by_all_sheets():
    """Each edge of the welds of an I-beam has three faces, of two sheets; all other edges two."""
    found = middle_of(plates.i_beam(), 4, 10.0)
    edges = np.sort(found.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    threes = {tuple(edge) for edge in unique[count == 3].tolist()}
    assert threes == {tuple(edge) for edge in np.sort(found.weld_edges, axis=1).tolist()}
    assert count.max() == 3
    border = found.points[unique[count == 1]].mean(axis=1)
    on_end = (np.abs(border[:, 2]) < 1e-6) | (np.abs(border[:, 2] - 300) < 1e-6)
    assert (on_end | (np.abs(np.abs(border[:, 0]) - 40) < 1e-6)).all()


@pytest.mark.slow
def test_a_spherical_shell_is_one_closed_sheet():
    """Facets of five halvings lie up to 0.02 off the spheres of radius 50 and 46."""
    shape = medialis.make_shape(*plates.sphere_shell())
    found = medialis.midsurface(shape)
    assert (found.sheets, found.welds) == (1, 0)
    assert found.of_sheet(0)["area"] == pytest.approx(4 * np.pi * 48**2, rel=0.005)
    assert np.abs(np.linalg.norm(found.points, axis=1) - 48).max() < 0.005 * 4.0
    assert found.lumps == ()


@pytest.mark.slow
def test_a_bent_sheet_keeps_its_bend():
    """Two legs of 40 and a quarter of a circle of radius 20: length 80 + 10 pi, times 60."""
    found = medialis.midsurface(medialis.make_shape(*plates.bent_sheet()))
    assert (found.sheets, found.welds) == (1, 0)
    assert found.of_sheet(0)["area"] == pytest.approx(60 * (80 + 10 * np.pi), rel=0.002)
    x, y, _ = found.points.T
    arc = np.abs(np.hypot(x, y - 20) - 20)
    off = np.where(x < 0, np.abs(y), np.where(y > 20, np.abs(x - 20), arc))
    assert off.max() < 0.005 * 3.0
    assert found.thickness == pytest.approx(3.0, rel=0.005)


@pytest.mark.slow
def test_a_frustum_follows_its_facets():
    """400 facets of a cone lie up to 40 (1 - cos(pi / 400)) = 0.0012 off it."""
    found = medialis.midsurface(medialis.make_shape(*plates.cone_shell(around=400)))
    assert (found.sheets, found.welds) == (1, 0)
    x, y, z = found.points.T
    off = np.abs(60 * (np.hypot(x, y) - 30) - 20 * z) / np.hypot(60, 20)
    assert off.max() < 0.005 * 4.0
    assert found.of_sheet(0)["area"] == pytest.approx(np.pi * 80 * np.hypot(20, 60), rel=0.002)


@pytest.mark.slow
def test_a_thin_long_i_beam_needs_no_finer_samples():
    """The default samples are five walls apart: it had 79 welds (mended)."""
    mesh = plates.i_beam(length=1000, width=100, height=100, web=4, flange=4)
    result = medialis.run("midsurface", medialis.make_shape(*mesh))
    assert (result.values["sheets"], result.values["welds"]) == (3, 2)
    assert result.values["area"] == pytest.approx(1000 * (100 + 100 + 96), rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("cell", [1.3, 0.8])
def test_a_pipe_junction_has_two_sheets_and_one_closed_weld(cell):
    """Walls of 4 with 3 and 5 samples over them; edges are rounded by a cell, so rims are, too."""
    found = medialis.midsurface(medialis.make_shape(*plates.pipe_tee(cell)))
    assert (found.sheets, found.welds) == (2, 1)
    x, y, z = found.points.T
    main = np.abs(np.hypot(y, z) - 20)
    branch = np.where(z > 0, np.abs(np.hypot(x, y) - 12), np.inf)
    rim = (np.abs(x) > 50 - cell) | (z > 45 - cell)
    weld = found.points[np.unique(found.weld_edges)]
    beside = np.linalg.norm(found.points[:, None] - weld, axis=2).min(axis=1) < 4.0
    # A chord of a cell over a radius of 10 is off by its square / 80; twice that behind a ball.
    assert np.minimum(main, branch)[~rim & ~beside].max() < 0.005 * 4.0 + cell**2 / 40
    # The weld is the curve where the cylinders of radius 20 and 12 meet.
    t = np.linspace(0, 2 * np.pi, 4001)
    curve = np.column_stack([12 * np.cos(t), 12 * np.sin(t), np.sqrt(400 - 144 * np.sin(t) ** 2)])
    true = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    ends = found.points[found.weld_edges]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(true, rel=0.02)
    assert np.bincount(found.weld_edges.ravel()).max() == 2


@pytest.mark.slow
@pytest.mark.parametrize("across", [3, 6])
def test_a_small_pipe_junction_is_exact_with_few_and_many_samples(across):
    """Radii of 6 and 4, walls of 2; rims and what is next to the weld are left out."""
    cell = 2.0 / across
    mesh = plates.pipe_tee(cell, main=6.0, branch=4.0, thickness=2.0, half_length=11.0, height=12.0)
    shape = medialis.make_shape(*mesh)
    found = medialis.midsurface(shape, edge=1.0 / shape.diagonal)
    assert (found.sheets, found.welds) == (2, 1)
    x, y, z = found.points.T
    main = np.abs(np.hypot(y, z) - 6)
    branch = np.where(z > 0, np.abs(np.hypot(x, y) - 4), np.inf)
    rim = (np.abs(x) > 11 - 2 * cell) | (z > 12 - 2 * cell)  # which marching rounds
    beside = cKDTree(found.points[np.unique(found.weld_edges)]).query(found.points)[0] < 2.0
    # A chord of a cell over a radius of 3 is off by its square / 24; the same behind a ball.
    chords = cell**2 / 24 if across == 3 else 0.0
    assert np.minimum(main, branch)[~rim & ~beside].max() < 0.005 * 2.0 + chords


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tee", "angle", "bracket", "box"])
def test_slivers_beside_large_triangles_change_nothing(name):
    make, thickness, sheets, welds, area, _, off = FLAT[name]
    found = medialis.midsurface(medialis.make_shape(*plates.irregular(make(), 4.0)))
    assert (found.sheets, found.welds) == (sheets, welds)
    assert np.allclose(sorted(areas(found)), sorted(area), rtol=0.01)
    assert off(found.points).max() < 0.005 * thickness


@pytest.mark.slow
@pytest.mark.parametrize("name", ["i_beam", "cross", "bracket", "box"])
def test_a_turned_part_and_one_far_away_in_another_unit_have_the_same_sheets(name):
    make, _, sheets, welds, area, *_ = FLAT[name]
    points, faces = make()
    turned = medialis.run("midsurface", medialis.make_shape(1e-3 * points @ TURN.T, faces))
    far = medialis.run("midsurface", medialis.make_shape(points + 1e5, faces))
    for found, unit in ((turned, 1e-3), (far, 1.0)):
        assert (found.values["sheets"], found.values["welds"]) == (sheets, welds)
        assert found.values["area"] == pytest.approx(sum(area) * unit**2, rel=1e-3)


@pytest.mark.slow
def test_one_thread_gives_the_same_bits_as_two():
    shape = medialis.make_shape(*plates.tee())
    results = []
    for count in (1, 2):
        medialis.forget()
        with medialis.thread_limit(count):
            results.append(medialis.run("midsurface", shape).arrays)
    assert all(np.array_equal(results[0][key], results[1][key]) for key in results[0])


def test_a_cube_has_no_midsurface_and_says_so():
    cube = medialis.make_shape(*plates.boxes((0, 1, 0, 1, 0, 1)))
    with pytest.raises(InvalidShapeError, match="has no midsurface"):
        medialis.run("midsurface", cube)


@pytest.mark.slow
@pytest.mark.parametrize("width", [5.0, 12.0])
def test_a_bar_is_no_wall_and_a_plate_is_one(width):
    """Over a bar of 5 x 4 sides lie opposite to each other along 1 of 5, over one of 12 along 8."""
    bar = medialis.make_shape(*plates.boxes((0, 60, 0, width, 0, 4)))
    if width == 5.0:
        with pytest.raises(InvalidShapeError, match="no part of it is a wall of even thickness"):
            medialis.run("midsurface", bar)
    else:
        result = medialis.run("midsurface", bar)
        assert result.values["area"] == pytest.approx(60 * width, rel=1e-6)


@pytest.mark.slow
def test_limbs_are_no_walls():
    with pytest.raises(InvalidShapeError, match="no part of it is a wall of even thickness"):
        medialis.run("midsurface", medialis.organic_shape(80))


@pytest.mark.slow
def test_walls_with_blends_as_wide_as_themselves_have_smooth_sheets_and_welds():
    """The sample is rounded all over, with three holes: it had 36 pieces of welds (mended).

    Its blends bulge out opposite to what they join, and sheets follow them there: half of the base
    and of the wall are within 0.5 % of the thickness, half of the rib, nearly all blends, within 3.
    """
    result = medialis.run("midsurface", medialis.sample_shape("bracket"))
    assert (result.values["sheets"], result.values["welds"]) == (3, 3)
    assert [sheet["thickness_mean"] for sheet in result.values["sheet_list"]] == pytest.approx(
        [0.2, 0.2, 0.2], rel=0.06
    )
    points, sheet = result.arrays["midsurface_points"], result.arrays["midsurface_sheet"]
    for number, axis, height, off in ((0, 2, 0.1, 0.01), (1, 0, 0.1, 0.01), (2, 1, 0, 0.05)):
        middle = points[result.arrays["midsurface_faces"][sheet == number]].mean(axis=1)
        assert np.median(np.abs(middle[:, axis] - height)) < off * 0.2


@pytest.mark.slow
def test_a_block_on_a_plate_is_named_as_a_lump():
    """A block of 30 x 30 x 24 on a plate of 100 x 100 x 4, with the plate under it."""
    mesh = plates.boxes((0, 100, 0, 100, 0, 4), (35, 65, 35, 65, 4, 28))
    result = medialis.run("midsurface", medialis.make_shape(*mesh))
    lumps = result.values["lumps"]
    assert len(lumps) == 1
    assert lumps[0]["share"] == pytest.approx(30 * 30 * 28 / (4e4 + 30 * 30 * 24), abs=0.03)
    assert any("solid lump has no midsurface" in message for message in result.messages)


def test_a_cloud_is_refused():
    with pytest.raises(InvalidShapeError):
        medialis.midsurface(medialis.make_shape(np.random.default_rng(0).normal(size=(60, 3))))
