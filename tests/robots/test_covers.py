"""Covers of links: boxes, cylinders, plates and sheets, and what keeps them apart."""

import json
import math
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest

import medialis
from medialis.base.progress import Progress
from medialis.cli import main
from medialis.robots.clearances import segment_distances
from medialis.robots.urdf import ends_of, joints_of, link_shapes, rest_frames, robot_of

LINK = '<link name="{}"><collision><geometry>{}</geometry></collision></link>'
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{0}"/><origin xyz="{3}"/>'
    '<axis xyz="0 1 0"/><limit lower="-0.1" upper="0.1" effort="1" velocity="1"/></joint>'
)


def box(*size):
    return '<box size="{} {} {}"/>'.format(*size)


def robot(folder, links, joints=(), name="arm.urdf"):
    path = folder / name
    rows = [LINK.format(*one) for one in links] + [JOINT.format(*one) for one in joints]
    path.write_text(f'<robot name="arm">{"".join(rows)}</robot>')
    return path


def gripper(folder, gap, thickness=0.014):
    """Two fingers on a base."""
    finger, apart = box(0.06, thickness, 0.026), 0.5 * (gap + thickness)
    links = ("base", box(0.57, 0.53, 0.36)), ("left", finger), ("right", finger)
    joints = [
        ("left", "prismatic", "base", f"0.4 {apart} 0"),
        ("right", "prismatic", "base", f"0.4 {-apart} 0"),
    ]
    return robot(folder, links, joints)


def farthest_outside(path, name, cover):
    """How far points all over a link are outside of its cover, at most."""
    shape = link_shapes(path, robot_of(path), Progress.of(None))[name]
    rng, triangles = np.random.default_rng(0), shape.points[shape.faces]
    share = shape.face_areas / shape.face_areas.sum()
    weights = rng.dirichlet([1.0, 1.0, 1.0], 5000)
    chosen = triangles[rng.choice(len(triangles), 5000, p=share)]
    points = np.concatenate([np.einsum("pk,pkc->pc", weights, chosen), shape.points])
    best = np.full(len(points), np.inf)
    for part in ends_of(cover):
        along = part.end - part.start
        share = np.clip((points - part.start) @ along / max(along @ along, 1e-300), 0.0, 1.0)
        away = np.linalg.norm(points - part.start - share[:, None] * along, axis=1)
        best = np.minimum(best, away - part.radius)
    return best.max()


def row_of_balls(half, corner, length, count):
    """Protrusion of equal balls in a row along a rod; `corner` is the radius of its section."""
    each = 0.5 * length / count
    radius = math.hypot(corner, each)
    return max(radius - half, radius - each)


RODS = {
    "box": (lambda t: box(0.2, t, t), math.sqrt(2.0)),
    "cylinder": (lambda t: f'<cylinder radius="{t / 2}" length="0.2"/>', 1.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [5, 20, 50])
@pytest.mark.parametrize("kind", RODS)
def test_balls_along_a_rod_are_nearly_as_good_as_an_even_row(tmp_path, kind, ratio):
    """An even row is best of all rows; patches are 0.2 to 0.4 of the distance between balls."""
    geometry, corner = RODS[kind]
    half = 0.1 / ratio
    path = robot(tmp_path, [("rod", geometry(2 * half))])
    for count in (1, 4, 8):
        found = medialis.robot_balls(path, balls=count)
        even = min(row_of_balls(half, corner * half, 0.2, n) for n in range(1, count + 1))
        assert found.protrusions["rod"] <= 1.5 * even
        assert farthest_outside(path, "rod", found.links["rod"]) <= 0.0
        assert len(found.links["rod"]) <= count


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [5, 10, 20])
def test_one_capsule_holds_a_cylinder(tmp_path, ratio):
    """Ends one radius inside are best: corners are 2^0.5 radii away, and stick out by 0.414."""
    radius = 0.1 / ratio
    path = robot(tmp_path, [("rod", f'<cylinder radius="{radius}" length="0.2"/>')])
    found = medialis.robot_balls(path, balls=1, capsules=True)
    assert len(found.links["rod"]) == 1
    assert 0.40 * radius <= found.protrusions["rod"] <= 0.65 * radius
    assert farthest_outside(path, "rod", found.links["rod"]) <= 0.0


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [2, 5, 20])
def test_fewer_capsules_than_balls_stick_out_as_little(tmp_path, ratio):
    plate, rod = box(0.2, 0.16, 0.2 / ratio), box(0.2, 0.2 / ratio, 0.2 / ratio)
    for name, geometry in (("plate", plate), ("rod", rod)):
        path = robot(tmp_path, [(name, geometry)])
        balls = medialis.robot_balls(path, balls=8)
        capsules = medialis.robot_balls(path, balls=6, capsules=True)
        assert capsules.protrusions[name] <= balls.protrusions[name]
        assert farthest_outside(path, name, capsules.links[name]) <= 0.0


@pytest.mark.slow
def test_fingers_get_several_balls_each_and_do_not_overlap(tmp_path):
    """42 of 44 balls went to the base, and fingers got one that stuck out by 26 mm (fixed)."""
    found = medialis.robot_balls(gripper(tmp_path, 0.046), balls=60)
    counts = {name: len(cover) for name, cover in found.links.items()}
    assert sum(counts.values()) == 60 and min(counts.values()) >= 8
    assert max(found.protrusions["left"], found.protrusions["right"]) < 0.007
    assert found.overlaps == () and found.figures["coverage"] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("gap", "balls"), [(0.02, 60), (0.01, 60), (0.008, 120)])
def test_links_that_do_not_touch_are_kept_apart(tmp_path, gap, balls):
    path = gripper(tmp_path, gap)
    found = medialis.robot_balls(path, balls=balls)
    assert found.overlaps == ()
    frames = rest_frames(robot_of(path))
    first, second = (
        found.links[name].centers @ frames[name][0].T + frames[name][1]
        for name in ("left", "right")
    )
    away = np.linalg.norm(first[:, None] - second, axis=2)
    radii = np.add.outer(found.links["left"].radii, found.links["right"].radii)
    assert (away >= radii - 1e-12).all()
    for name in ("base", "left", "right"):
        assert farthest_outside(path, name, found.links[name]) <= 0.0


def test_links_that_few_balls_cannot_keep_apart_are_reported(tmp_path):
    progress = Progress()
    found = medialis.robot_balls(gripper(tmp_path, 0.002), balls=3, progress=progress)
    (pair,) = found.overlaps
    assert {pair.first, pair.second} == {"left", "right"}
    (left,), (right,) = found.links["left"].radii, found.links["right"].radii
    assert 0.5 * (left + right) < pair.depth < left + right
    (message,) = [one for one in progress.messages if one.code == "links_overlap"]
    assert message.data == {"pairs": 1, "depth": pair.depth}


def test_links_with_a_joint_between_or_that_touch_are_not_kept_apart(tmp_path):
    links = [("a", box(0.1, 0.1, 0.1)), ("b", box(0.1, 0.1, 0.1)), ("c", box(0.1, 0.1, 0.1))]
    joints = [("b", "revolute", "a", "0.11 0 0"), ("c", "revolute", "b", "-0.05 0 0")]
    found = medialis.robot_balls(robot(tmp_path, links, joints), balls=3)
    assert found.overlaps == ()  # b has joints to both; c is inside a


@pytest.mark.slow
def test_covers_follow_the_scale_of_a_mesh(tmp_path):
    """Everything is computed at diagonal 1, so that a factor of two changes no digit."""
    medialis.write_mesh(tmp_path / "part.ply", medialis.sample_shape("bracket"))
    links = [
        (name, f'<mesh filename="part.ply" scale="{scale} {scale} {scale}"/>')
        for name, scale in (("one", 0.25), ("two", 0.5))
    ]
    found = [
        medialis.robot_balls(robot(tmp_path, [link], name=f"{link[0]}.urdf"), balls=12)
        for link in links
    ]
    small, large = (robot.links[name] for robot, (name, _) in zip(found, links, strict=True))
    np.testing.assert_allclose(2.0 * small.radii, large.radii, rtol=1e-9)
    np.testing.assert_allclose(2.0 * small.centers, large.centers, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("capsules", [False, True])
def test_an_open_sheet_is_held(tmp_path, capsules):
    """A link that encloses nothing was refused (fixed)."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.05, 0.05, 5))
    points = np.stack([x, y, 0.3 * x * x], axis=2).reshape(-1, 3)
    row = np.arange(45).reshape(5, 9)
    a, b, c, d = (one.ravel() for one in (row[:-1, :-1], row[:-1, 1:], row[1:, 1:], row[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    medialis.write_mesh(tmp_path / "sheet.ply", medialis.make_shape(points, faces))
    path = robot(tmp_path, [("sheet", '<mesh filename="sheet.ply"/>')])
    found = medialis.robot_balls(path, balls=8, capsules=capsules)
    assert farthest_outside(path, "sheet", found.links["sheet"]) <= 0.0
    # Eight squares of 50 mm have circles of 35 mm.
    assert found.protrusions["sheet"] <= 0.045


@pytest.mark.slow
def test_a_bowl_is_not_taken_as_full(tmp_path):
    """One ball seemed to fit a bowl and stuck out through its opening by the radius (fixed)."""
    up, turn = np.linspace(0.0, 0.5 * np.pi, 9)[1:], 2 * np.pi * np.arange(24) / 24
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    rings = np.sin(up)[:, None, None] * ring - np.cos(up)[:, None, None] * [0.0, 0.0, 1.0]
    points = 0.1 * np.concatenate([rings.reshape(-1, 3), [[0.0, 0.0, -1.0]]])
    row = np.arange(192).reshape(8, 24)
    after = np.roll(row, -1, axis=1)
    faces = [np.stack([after[0], row[0], np.full(24, 192)], axis=1)]
    faces += [np.stack([row[:-1], after[:-1], after[1:]], axis=2).reshape(-1, 3)]
    faces += [np.stack([row[:-1], after[1:], row[1:]], axis=2).reshape(-1, 3)]
    medialis.write_mesh(tmp_path / "bowl.ply", medialis.make_shape(points, np.concatenate(faces)))
    path = robot(tmp_path, [("bowl", '<mesh filename="bowl.ply"/>')])
    found = medialis.robot_balls(path, balls=16)
    assert farthest_outside(path, "bowl", found.links["bowl"]) <= 0.0
    # Sixteen even caps of a half sphere of 100 mm have radii of 39 mm; 1.5 times that is allowed.
    assert found.protrusions["bowl"] <= 0.06


@pytest.mark.slow
def test_balls_that_do_not_cover_are_off_by_half_on_either_side(tmp_path):
    path = robot(tmp_path, [("rod", box(0.2, 0.02, 0.02))])
    covers = medialis.robot_balls(path, balls=6)
    fits = medialis.robot_balls(path, balls=6, cover=False)
    assert fits.protrusions["rod"] <= 0.5 * covers.protrusions["rod"] + 1e-3
    assert 0.0 < fits.figures["largest_uncovered_gap"] <= 0.5 * covers.protrusions["rod"] + 1e-3


@pytest.mark.slow
def test_one_thread_gives_the_same_balls_as_two(tmp_path):
    path, found = gripper(tmp_path, 0.02), []
    for threads in (1, 2):
        with medialis.thread_limit(threads):
            found.append(medialis.robot_balls(path, balls=20))
    for name, cover in found[0].links.items():
        np.testing.assert_array_equal(cover.centers, found[1].links[name].centers)
        np.testing.assert_array_equal(cover.radii, found[1].links[name].radii)


def test_capsules_are_written_for_mujoco_and_urdf(tmp_path, capsys):
    path = gripper(tmp_path, 0.046)
    files = [tmp_path / f"arm.{ending}" for ending in ("xml", "json")] + [tmp_path / "caps.urdf"]
    words = ["robot-balls", str(path), "--capsules", "--balls", "6"]
    for file in files:
        words += ["-o", str(file)]
    assert main(words) == 0
    assert "6 capsules for 3 links" in capsys.readouterr().out
    content = json.loads(files[1].read_text())
    assert content["overlaps"] == [] and set(content["protrusions"]) == {"base", "left", "right"}
    capsules = [one for rows in content["links"].values() for one in rows if "start" in one]
    assert 0 < len(capsules) <= 6
    model = ElementTree.parse(files[0]).getroot()
    assert len(model.findall(".//geom[@type='capsule']")) == len(capsules)
    slides = model.findall("worldbody/body/body/joint[@type='slide']")
    assert [one.get("name") for one in slides] == ["left", "right"]
    geometry = [one[0].tag for one in ElementTree.parse(files[2]).getroot().iter("geometry")]
    assert geometry.count("cylinder") == len(capsules)
    assert geometry.count("sphere") == sum(map(len, content["links"].values())) + len(capsules)
    assert main([*words[:5], "-o", str(tmp_path / "arm.yml")]) == 2
    assert "Capsules end in .urdf, .xml, .json" in capsys.readouterr().err


def test_cylinders_of_a_urdf_are_where_the_capsules_are(tmp_path):
    start, end = np.array([0.1, 0.2, -0.1]), np.array([0.3, -0.1, 0.2])
    cover = medialis.CapsuleCover([start], [end], np.array([0.05]), 0.0)
    text = f'<robot name="arm">{LINK.format("a", box(1, 1, 1))}</robot>'
    found = medialis.RobotBalls("arm", {"a": cover}, {}, text)
    path = tmp_path / "arm.urdf"
    medialis.write_robot_balls(path, found)
    element = next(
        one for one in ElementTree.parse(path).getroot().iter("collision")
        if one.find("geometry/cylinder") is not None
    )  # fmt: skip
    root = ElementTree.Element("robot")
    link = ElementTree.SubElement(root, "link", {"name": "a"})
    link.append(element)
    points = link_shapes(path, root, Progress.of(None))["a"].points
    unit = (end - start) / np.linalg.norm(end - start)
    along = (points - start) @ unit
    assert np.ptp(along) == pytest.approx(np.linalg.norm(end - start))
    away = np.linalg.norm(points - start - along[:, None] * unit, axis=1)
    assert away.max() == pytest.approx(0.05, rel=0.006)


def test_distances_of_segments_are_those_of_their_points():
    """Compared with 201 points of each: off by half of their spacing, at most."""
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=(6, 2, 3)), rng.normal(size=(5, 2, 3))
    second[0, 1] = second[0, 0]  # a point
    second[1] = first[1] + [0.0, 0.0, 0.3]  # parallel
    found, share = segment_distances(first, second), np.linspace(0, 1, 201)[:, None]
    for i, j in [*combinations(range(5), 2), *((k, k) for k in range(5))]:
        a, b = (one[0] + share * (one[1] - one[0]) for one in (first[i], second[j]))
        apart = np.linalg.norm(a[:, None] - b, axis=2).min()
        assert apart - 0.03 <= found[i, j] <= apart + 1e-12


def test_joints_rest_within_their_limits(tmp_path):
    links = ("a", box(1, 1, 1)), ("b", box(1, 1, 1))
    path = robot(tmp_path, links, [("b", "prismatic", "a", "1 0 0")])
    path.write_text(path.read_text().replace('lower="-0.1"', 'lower="0.05"'))
    (joint,) = joints_of(robot_of(path))
    assert joint.limits == (0.05, 0.1)
    assert rest_frames(robot_of(path))["b"][1].tolist() == [1.0, 0.05, 0.0]
    assert set(rest_frames(robot_of(path), fixed=True)) == {"a"}


@pytest.mark.slow
def test_mujoco_reads_capsules(tmp_path):
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    found = medialis.robot_balls(gripper(tmp_path, 0.046), balls=6, capsules=True)
    medialis.write_robot_balls(tmp_path / "arm.xml", found)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    assert (model.ngeom, model.njnt) == (6, 2)
