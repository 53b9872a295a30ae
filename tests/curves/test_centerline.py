"""Centerlines of tubes whose axis is known: where they lie, how wide, where they part, as files."""

import csv
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.base.box_tree import NearestTree
from medialis.base.progress import Progress
from medialis.curves.centerline import Centerlines, joined, tracts
from medialis.curves.sections import sections
from tubes import FORK, arc, distance_to, segment, tube

ALONG = np.linspace(0.0, 1.0, 61)
LINE = np.stack([10.0 * ALONG, 0.0 * ALONG, 0.0 * ALONG], axis=1)
BENT = arc([0, 0, 0], 4.0, 0.0, 4.5, 100)
TURN = np.linspace(0.0, 4.0 * np.pi, 160)
HELIX = np.stack([3.0 * np.cos(TURN), 3.0 * np.sin(TURN), TURN], axis=1)


def swept(curve, radius, around=24, noise=0.0):
    """An open tube of rings round a curve: points and faces."""
    ahead = np.gradient(curve, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    turn = 2.0 * np.pi * np.arange(around)[:, None] / around
    aside, rings = np.cross(ahead[0], [0.3, 0.5, 0.8]), []
    for middle, one, wide in zip(curve, ahead, np.broadcast_to(radius, len(curve)), strict=True):
        aside = aside - (aside @ one) * one
        aside /= np.linalg.norm(aside)
        ring = np.cos(turn) * aside + np.sin(turn) * np.cross(one, aside)
        rings.append(middle + wide * ring)
    points = np.concatenate(rings)
    points += noise * np.random.default_rng(0).normal(size=points.shape)
    row, column = np.divmod(np.arange((len(curve) - 1) * around), around)
    a, b = row * around + column, row * around + (column + 1) % around
    faces = np.concatenate(
        [np.stack([a, b, a + around], 1), np.stack([b, b + around, a + around], 1)]
    )
    return points, faces


def line_of(points, faces, **options):
    return medialis.run("centerline", medialis.make_shape(points, faces, repair=True), **options)


def off_axis(result, curve, radius):
    """Median distance from the axis, in radii."""
    return np.median(distance_to(result.layers[0].points, [curve], radius / 200)) / radius


# A polygon of 24 corners has its sides 0.86 % of the radius inside the circle, one of 8 corners
# 7.6 %: no ball inside touches the circle, but their centers lie on the axis by symmetry.
@pytest.mark.parametrize(
    ("curve", "radius", "around"),
    [(LINE, 1.0, 24), (BENT, 1.0, 24), (HELIX, 0.8, 24), (LINE[::6], 1.0, 8), (BENT[::4], 1.0, 10)],
    ids=["straight", "arc", "helix", "coarse straight", "coarse arc"],
)
def test_lines_lie_on_the_axis_of_open_tubes(curve, radius, around):
    result = line_of(*swept(curve, radius, around))
    assert result.values["between"] == "open ends" and result.values["lines"] == 1
    assert off_axis(result, curve, radius) < 0.01
    layer = result.layers[0]
    flat = radius * np.cos(np.pi / around)
    assert np.median(layer.attributes["radius"]) == pytest.approx(flat, rel=0.02)
    polygon = 0.5 * around * np.sin(2 * np.pi / around) * radius**2
    inner = slice(3, -3)
    assert np.median(layer.attributes["section_area"][inner]) == pytest.approx(polygon, rel=0.02)
    assert np.isfinite(layer.attributes["least_diameter"][inner]).all()


def test_lines_reach_from_one_open_end_to_the_other():
    result = line_of(*swept(LINE, 1.0))
    points = result.layers[0].points
    assert sorted(points[[0, -1], 0]) == pytest.approx([0.0, 10.0], abs=1e-6)
    assert result.values["length_max"] == pytest.approx(10.0, rel=1e-3)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.ptp(steps) < 1e-6 * steps.mean()


def test_the_radius_follows_a_tube_that_varies():
    radius = 1.0 + 0.4 * np.sin(6.0 * ALONG)
    result = line_of(*swept(LINE, radius))
    assert off_axis(result, LINE, 1.0) < 0.01
    layer = result.layers[0]
    known = np.interp(layer.points[:, 0], LINE[:, 0], radius)
    # Where the wall leans by up to 13 degrees (slope 0.24) the ball is smaller by 1 - cos 13 = 3 %.
    assert (np.abs(layer.attributes["radius"] / known - 1.0) < 0.04).all()
    area = layer.attributes["section_area"][2:-2] / (np.pi * known[2:-2] ** 2)
    assert np.abs(area - 1.0).max() < 0.03


def test_a_noisy_tube_has_a_smooth_line():
    """Vertices are off by 1 % of the radius: the line is off by half of that.

    Balls that touch noise are too small and lie to the side that they touch; a bend has more of its
    surface outside.
    """
    result = line_of(*swept(BENT, 1.0, noise=0.01))
    assert off_axis(result, BENT, 1.0) < 0.005
    assert result.values["length_max"] == pytest.approx(4.0 * 4.5, rel=0.01)


def test_a_hole_in_the_wall_is_no_open_end():
    points, faces = swept(LINE, 1.0)
    middle = points[faces].mean(axis=1)
    hole = np.linalg.norm(middle - [5.0, 0.0, 0.0] - [0.0, 0.7, 0.7], axis=1) < 0.6
    assert hole.sum() > 10
    result = line_of(points, faces[~hole])
    assert result.values["lines"] == 1 and off_axis(result, LINE, 1.0) < 0.02


@pytest.fixture(scope="module")
def fork():
    """Three arms that meet, closed; lines begin at one arm."""
    shape = tube([segment([0, 0, 0], 3 * one) for one in FORK], 0.4, 0.12)
    return medialis.run("centerline", shape)


def test_a_fork_has_a_group_for_each_arm_and_one_for_itself(fork):
    values = fork.values
    assert (values["lines"], values["forks"], values["groups"]) == (2, 1, 4)
    layer = fork.layers[0]
    arms = [segment([0, 0, 0], 3 * one) for one in FORK]
    clear = layer.attributes["blanked"] == 0
    away = distance_to(layer.points[clear], arms) / 0.4
    assert np.median(away) < 0.01
    # The fork reaches from a radius before where lines part to where they have left each other.
    middle = np.linalg.norm(layer.points[~clear], axis=1)
    assert middle.max() < 4 * 0.4 and middle.min() < 0.4
    for group in np.unique(layer.attributes["group"][clear]):
        rows = layer.points[clear & (layer.attributes["group"] == group)]
        assert (np.argmax(rows @ FORK.T, axis=1) == np.argmax(rows[0] @ FORK.T)).all()


def test_lines_part_without_a_kink(fork):
    """Two lines part by 120 degrees over about a radius of 12 places."""
    layer, found, _ = fork.extras["lines"]
    for line in found.lines:
        along = np.diff(layer.points[line], axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        assert (along[1:] * along[:-1]).sum(axis=1).min() > np.cos(np.radians(15.0))


def test_a_line_without_a_length_is_joined():
    """It ends in the ball where another one begins: that was a division by zero (fixed)."""
    points, faces = swept(LINE, 1.0)
    tree = NearestTree.of_triangles(points, np.asarray(faces, np.int32))
    way = np.array([[2.0, 0, 0], [2.5, 0, 0], [3.0, 0, 0]])
    found = joined([way, way[[0, 0]]], tree)
    assert [len(line) for line in found.lines] == [3, 2]
    assert np.array_equal(found.points[found.lines[1]], way[[0, 0]])
    assert np.abs(found.radii - 0.99).max() < 0.01


def test_pieces_are_numbered_as_vmtk_does():
    """Two lines that part at point 4: trunk, fork and an arm each; trunk and fork are shared."""
    points = [[x, 0, 0] for x in range(5)]
    points += [[5 + x, 1 + x, 0] for x in range(6)] + [[5 + x, -1 - x, 0] for x in range(6)]
    lines = (np.r_[0:5, 5:11], np.r_[0:5, 11:17])
    found = Centerlines(np.array(points, float), np.full(17, 1.5), lines)
    pieces = [(p.line, p.first, p.last, p.group, p.blanked) for p in tracts(found)]
    # Point 5 is 1 from the axis of the other arm and 2 from its nearest point (1.41 from the fork).
    assert pieces == [
        (0, 0, 2, 0, False),
        (0, 3, 5, 1, True),
        (0, 6, 10, 2, False),
        (1, 0, 2, 0, False),
        (1, 3, 5, 1, True),
        (1, 6, 10, 3, False),
    ]


def arrays_of(path):
    """The arrays of a .vtp file by name, read by its own words: raw, appended."""
    data = path.read_bytes()
    head, _, rest = data.partition(b'<AppendedData encoding="raw">\n_')
    root = ElementTree.fromstring(head + b"</VTKFile>")
    types = {"Int32": np.int32, "Int64": np.int64, "Float64": np.float64, "Float32": np.float32}
    found = {}
    for one in root.iter("DataArray"):
        start = int(one.get("offset"))
        size = int(np.frombuffer(rest, "<u8", 1, start)[0])
        values = np.frombuffer(rest[start + 8 : start + 8 + size], types[one.get("type")])
        found[one.get("Name")] = values.reshape(
            -1, int(one.get("NumberOfComponents") or 1)
        ).squeeze()
    return found


def test_files_have_what_vmtk_names(fork, tmp_path):
    medialis.write_result(fork, tmp_path, pictures=medialis.Pictures(main=False))
    arrays = arrays_of(tmp_path / "centerline.lines.vtp")
    assert arrays["CenterlineIds"].tolist() == [0, 0, 0, 1, 1, 1]
    assert arrays["TractIds"].tolist() == [0, 1, 2, 0, 1, 2]
    assert arrays["Blanking"].tolist() == [0, 1, 0, 0, 1, 0]
    groups = arrays["GroupIds"].tolist()
    assert groups[:2] == groups[3:5] and groups[2] != groups[5]
    layer = fork.layers[0]
    radius = layer.attributes["radius"]
    np.testing.assert_array_equal(arrays["MaximumInscribedSphereRadius"], radius)
    np.testing.assert_array_equal(arrays["Points"], layer.points)
    assert arrays["offsets"][-1] == len(arrays["connectivity"])
    with (tmp_path / "centerline.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert {row["line"] for row in rows} == {"0", "1"}
    assert [float(row["radius"]) for row in rows[:3]] == radius[:3].tolist()


def test_vtk_reads_the_file(fork, tmp_path):
    vtk = pytest.importorskip("vtk", reason="vtk is not installed")
    medialis.write_result(fork, tmp_path, pictures=medialis.Pictures(main=False))
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "centerline.lines.vtp"))
    reader.Update()
    read = reader.GetOutput()
    assert read.GetNumberOfCells() == 6
    assert read.GetCellData().GetArray("Blanking").GetTuple1(1) == 1.0
    assert read.GetPointData().GetArray("MaximumInscribedSphereRadius") is not None


def test_places_are_vertices_or_coordinates(tmp_path):
    points, faces = swept(LINE, 1.0)
    shape = medialis.make_shape(points + 3e7, faces, repair=True)
    picked = tmp_path / "places.txt"
    x, y, z = shape.points[24 * 50]
    picked.write_text(
        f"240\n{x!r} {y!r} {z!r}  # on ring 50\n".replace("np.float64(", "").replace(")", "")
    )
    result = medialis.run("centerline", shape, places=str(picked))
    assert result.values["between"] == "places"
    ends = np.array([result.values["line_table"][0][name] for name in ("start", "end")]) - 3e7
    # Rings 10 and 50 of 60; a ball touches its sample within the tolerance, 0.03 % of the size.
    assert ends[:, 0] == pytest.approx([LINE[10, 0], LINE[50, 0]], abs=0.05)


def test_several_starts_share_the_ends(tmp_path, fork):
    shape = fork.shape
    tips = [int(np.argmax(shape.points @ one)) for one in FORK]
    picked = tmp_path / "places.txt"
    picked.write_text("\n".join(map(str, tips)))
    given = medialis.make_shape(shape.points, shape.faces)
    one = medialis.run("centerline", given, places=str(picked), starts=2)
    assert one.values["lines"] == 1
    with pytest.raises(medialis.InvalidShapeError, match="begin at 3 and end at others, but 3"):
        medialis.run("centerline", given, places=str(picked), starts=3)


def test_samples_without_a_ball_cut_no_line(tmp_path):
    """The tip of the tail has a ball, and all its neighbours have none: no path led there."""
    shape = medialis.organic_shape(56)
    picked = tmp_path / "places.txt"
    ends = [int(np.argmax(shape.points[:, 0])), int(np.argmin(shape.points[:, 0]))]
    picked.write_text("\n".join(map(str, ends)))
    result = medialis.run("centerline", shape, places=str(picked))
    assert result.values["length_max"] > np.ptp(shape.points[:, 0]) * 0.9


def test_what_has_no_line_says_why():
    with pytest.raises(medialis.InvalidShapeError, match="Give places"):
        medialis.run("centerline", forms.icosphere(3))
    with pytest.raises(medialis.InvalidShapeError, match="point cloud"):
        medialis.run(
            "centerline", medialis.Shape(forms.icosphere(2).points, forms.icosphere(2).points)
        )


def test_ends_in_two_parts_are_refused(tmp_path):
    ball = forms.icosphere(2)
    points = np.concatenate([ball.points + np.array([x, 0.0, 0.0]) for x in (0.0, 5.0)])
    faces = np.concatenate([ball.faces, ball.faces + len(ball.points)])
    picked = tmp_path / "places.txt"
    picked.write_text(f"0\n{len(ball.points)}\n")
    with pytest.raises(medialis.InvalidShapeError, match="another part of the shape"):
        line_of(points, faces, places=str(picked))


def test_sections_of_a_box_are_its_faces():
    """Through the middle of 4 x 2 x 1: area and least width exact, the diagonal within 1 degree."""
    box = medialis.Surface(
        np.array([[x, y, z] for x in (-2, 2) for y in (-1, 1) for z in (-0.5, 0.5)], float),
        np.array([(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7),
                  (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]),
    )  # fmt: skip
    found = sections(box, np.zeros((2, 3)), np.eye(3)[:2], Progress.of(None))
    assert found[:, 0] == pytest.approx([2.0, 4.0])
    assert found[:, 1] == pytest.approx([1.0, 1.0])
    assert found[:, 2] == pytest.approx(np.hypot([2.0, 4.0], 1.0), rel=2e-4)
    outside = sections(box, np.array([[0.0, 3.0, 0.0]]), np.eye(3)[:1], Progress.of(None))
    assert np.isnan(outside).all()


def test_the_innermost_outline_round_a_place_is_its_section():
    """A bubble in a ball in a shell, of radii 1, 2 and 3; a ball beside them counts for nothing."""
    balls = [(forms.icosphere(3), size, [0.0, 0.0, 0.0]) for size in (3.0, 2.0, 1.0)]
    balls.append((forms.icosphere(3), 1.0, [5.0, 0.0, 0.0]))
    points = np.concatenate([size * np.asarray(ball.points) + at for ball, size, at in balls])
    faces = np.concatenate(
        [ball.faces + k * ball.point_count for k, (ball, *_) in enumerate(balls)]
    )
    places = np.array([[0.0, 0.0, 0.1], [0.0, 1.5, 0.1], [0.0, 2.5, 0.1], [5.0, 0.2, 0.1]])
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    surface = medialis.Surface(points, faces)
    found = sections(surface, places, normals, Progress.of(None))
    # Round the bubble's own middle goes all; round places in the shells only what lies farther out.
    radii = np.sqrt(np.array([1.0, 2.0, 3.0, 1.0]) ** 2 - 0.1**2)
    # Chords of a sphere of 1,280 triangles: edges of .15 radii lie .15^2 / 8 inside.
    assert found[:, 0] == pytest.approx(np.pi * radii**2, rel=0.012)
    assert found[:, 1:] == pytest.approx(np.repeat(2.0 * radii[:, None], 2, axis=1), rel=0.006)


def test_one_and_two_threads_give_the_same():
    points, faces = swept(BENT, 1.0, 16)
    one, two = (line_of(points, faces, threads=count) for count in (1, 2))
    np.testing.assert_array_equal(one.layers[0].points, two.layers[0].points)
