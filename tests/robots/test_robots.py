"""Balls for whole robots: links of known shapes, how balls are shared, and the files of others."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest

import medialis
from medialis.base.progress import Progress
from medialis.cli import main
from medialis.robots.balls import _above, write_robot_balls
from medialis.robots.covers import Cover
from medialis.robots.urdf import _rotation, link_shapes, rest_frames, robot_of

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

LINK = (
    '<link name="{}"><collision><origin xyz="{}" rpy="{}"/><geometry>{}</geometry></collision>'
    "</link>"
)


def robot(folder, *links):
    path = folder / "arm.urdf"
    rows = [LINK.format(*link) for link in links]
    path.write_text(f'<robot name="arm">{"".join(rows)}<link name="world"/></robot>')
    return path


def shapes_of(path):
    return link_shapes(path, robot_of(path), Progress.of(None))


BOX = ("base", "0 0 0", "0 0 0", '<box size="0.3 0.2 0.1"/>')
FINGER = ("finger", "0 0 0.03", "0 0 0", '<box size="0.01 0.02 0.06"/>')


def test_shapes_stand_where_the_file_has_them(tmp_path):
    turned = ("turned", "1 2 3", "0 0 1.5707963267948966", '<box size="0.4 0.2 0.1"/>')
    pipe = ("pipe", "0 0 0", "1.5707963267948966 0 0", '<cylinder radius="0.05" length="0.4"/>')
    ball = ("ball", "0 0 1", "0 0 0", '<sphere radius="0.1"/>')
    found = shapes_of(robot(tmp_path, turned, pipe, ball))
    assert list(found) == ["turned", "pipe", "ball"]  # the world has no shape
    low, high = found["turned"].bounds
    assert low == pytest.approx([0.9, 1.8, 2.95]) and high == pytest.approx([1.1, 2.2, 3.05])
    low, high = found["pipe"].bounds  # the polygon is round the circle: 0.5 % wider
    assert np.allclose(high, [0.05, 0.2, 0.05], rtol=0.006) and np.allclose(low, -high)
    away = np.linalg.norm(found["ball"].points - [0, 0, 1], axis=1)
    assert away == pytest.approx(0.1)
    assert all(shape.closed_components.all() for shape in found.values())
    assert all(np.einsum("ij,ij->", s.points[s.faces[:, 0]], s.face_vectors) > 0
               for s in found.values())  # outward  # fmt: skip


def test_origins_turn_about_fixed_axes():
    from scipy.spatial.transform import Rotation

    for angles in np.random.default_rng(0).uniform(-4.0, 4.0, (20, 3)):
        expected = Rotation.from_euler("xyz", angles).as_matrix()
        assert np.allclose(_rotation(angles), expected, rtol=0.0, atol=1e-14)


def test_meshes_are_found_beside_the_file_and_in_packages(tmp_path):
    folder = tmp_path / "arm_description"
    (folder / "urdf").mkdir(parents=True)
    (folder / "meshes").mkdir()
    box = shapes_of(robot(tmp_path, BOX))["base"]
    medialis.write_mesh(folder / "meshes" / "box.ply", box)
    names = ("../meshes/box.ply", "package://arm_description/meshes/box.ply")
    links = [
        (f"l{k}", "0 0 0", "0 0 0", f'<mesh filename="{name}" scale="2 1 1"/>')
        for k, name in enumerate(names)
    ]
    for shape in shapes_of(robot(folder / "urdf", *links)).values():
        assert shape.bounds[1] == pytest.approx([0.3, 0.1, 0.05])
    missing = ("l", "0 0 0", "0 0 0", '<mesh filename="none.stl"/>')
    with pytest.raises(medialis.FileError, match=r"no mesh none\.stl"):
        shapes_of(robot(tmp_path, missing))


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = robot(tmp_path_factory.mktemp("arm"), BOX, FINGER)
    return medialis.robot_balls(path, balls=10)


@pytest.mark.slow
def test_every_point_of_every_link_is_in_a_ball(arm):
    for name, size, middle in (
        ("base", [0.3, 0.2, 0.1], 0.0),
        ("finger", [0.01, 0.02, 0.06], 0.03),
    ):
        rng = np.random.default_rng(0)
        points = rng.uniform(-0.5, 0.5, (20_000, 3))
        points[np.arange(20_000), rng.integers(0, 3, 20_000)] = rng.choice([-0.5, 0.5], 20_000)
        points = points * size + [0.0, 0.0, middle]
        cover = arm.links[name]
        away = np.linalg.norm(points[:, None] - cover.centers, axis=2) - cover.radii
        assert away.min(axis=1).max() <= 0.0
    assert sum(map(len, arm.links.values())) <= 10
    assert arm.figures["coverage"] == 1.0 and arm.figures["largest_uncovered_gap"] == 0.0
    assert arm.figures["volume_ratio"] > 1.0
    assert 0.0 < arm.figures["protrusion_mean"] <= arm.figures["protrusion_p95"]


@pytest.mark.slow
def test_files_are_those_of_curobo_and_moveit(arm, tmp_path):
    for ending in ("yml", "srdf", "urdf", "json"):
        medialis.write_robot_balls(tmp_path / f"arm.{ending}", arm)
    spheres = yaml.safe_load((tmp_path / "arm.yml").read_text())["collision_spheres"]
    assert set(spheres) == {"base", "finger"}
    for name, cover in arm.links.items():
        rows = [[*ball["center"], ball["radius"]] for ball in spheres[name]]
        np.testing.assert_array_equal(rows, np.column_stack([cover.centers, cover.radii]))
    root = ElementTree.parse(tmp_path / "arm.srdf").getroot()
    links = {one.get("link"): one for one in root.findall("link_sphere_approximation")}
    assert len(links["finger"].findall("sphere")) == len(arm.links["finger"])
    again = ElementTree.parse(tmp_path / "arm.urdf").getroot()
    base = next(one for one in again.findall("link") if one.get("name") == "base")
    assert len(base.findall("collision/geometry/sphere")) == len(arm.links["base"])
    assert base.find("collision/geometry/box") is None
    content = json.loads((tmp_path / "arm.json").read_text())
    assert content["figures"] == arm.figures and content["unit"] == "m"
    with pytest.raises(medialis.InvalidOptionError, match="Balls end in"):
        write_robot_balls(tmp_path / "arm.txt", arm)


JOINT = (
    '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>'
    '<origin xyz="{}" rpy="{}"/></joint>'
)


def test_links_that_no_joint_moves_have_frames(tmp_path):
    path = robot(tmp_path, BOX, FINGER, ("moving", "0 0 0", "0 0 0", '<box size="1 1 1"/>'))
    joints = JOINT.format("a", "fixed", "base", "finger", "1 2 3", "0 0 1.5707963267948966")
    joints += JOINT.format("b", "revolute", "finger", "moving", "0 0 0", "0 0 0")
    path.write_text(path.read_text().replace("</robot>", f"{joints}</robot>"))
    frames = rest_frames(robot_of(path), fixed=True)
    assert set(frames) == {"base", "world", "finger"}
    turn, place = frames["finger"]
    assert turn @ [1, 0, 0] == pytest.approx([0, 1, 0]) and place.tolist() == [1, 2, 3]


@pytest.mark.parametrize("turn", ["0 0 0", "3.141592653589793 0 0"])
def test_no_ball_crosses_the_plane_of_a_table(tmp_path, turn):
    """It stands in the frame of the first link; a fixed joint turns the other one over."""
    path = robot(tmp_path, ("foot", "0 0 0.05", "0 0 0", '<sphere radius="0.1"/>'))
    joint = JOINT.format("a", "fixed", "world", "foot", "0 0 0", turn)
    path.write_text(path.read_text().replace("</robot>", f"{joint}</robot>"))
    found = medialis.robot_balls(path, balls=8, plane=(0.0, 0.0, 2.0, 0.0))  # of any length
    cover = found.links["foot"]
    up = 1.0 if turn == "0 0 0" else -1.0
    lowest = up * cover.centers[0, 2] - cover.radii[0]
    assert 0.0 <= lowest < 1e-9
    assert 2 * cover.radii[0] == pytest.approx(0.15 if up > 0 else 0.05)  # what is left above
    assert found.figures["coverage"] < 1.0 and found.figures["largest_uncovered_gap"] > 0.0


def test_capsules_that_cross_a_plane_become_smaller_within_themselves():
    axes = np.array([[0, 0, 0.2, 1, 0, 0.5], [0, 0, 2, 1, 0, 2], [0, 0, -0.5, 1, 0, 1]])
    radii = np.array([0.3, 0.3, 0.3])
    found = _above(Cover(axes, radii, radii), (np.array([0.0, 0, 1]), 0.0), Progress.of(None))
    assert len(found) == 2  # the last one ends below
    ends, before = found.axes.reshape(-1, 2, 3), axes[:2].reshape(-1, 2, 3)
    assert (ends[..., 2] >= found.radii[:, None]).all()
    assert found.radii == pytest.approx([0.25, 0.3]) and ends[0, 0, 2] == pytest.approx(0.25)
    moved = np.linalg.norm(ends - before, axis=2)
    assert (moved + found.radii[:, None] <= radii[:2, None] + 1e-12).all()


def test_capsules_keep_to_one_side_of_a_plane(tmp_path):
    """It was refused together with capsules (fixed)."""
    path = robot(tmp_path, ("rail", "0 0 0.05", "0 0 0", '<box size="0.6 0.1 0.1"/>'))
    found = medialis.robot_balls(path, balls=2, capsules=True, plane=(0, 0, 1, 0))
    cover = found.links["rail"]
    assert (np.minimum(cover.starts[:, 2], cover.ends[:, 2]) >= cover.radii).all()
    assert found.figures["coverage"] > 0.3


@pytest.mark.parametrize("plane", [(0, 0, 0, 1), (0, 0, 1), "z", (0, 0, 1, float("nan"))])
def test_a_plane_is_four_numbers(tmp_path, plane):
    with pytest.raises(medialis.InvalidOptionError, match="plane must be four numbers"):
        medialis.robot_balls(robot(tmp_path, BOX), plane=plane)


def test_the_command_writes_each_file_and_says_how_good(tmp_path, capsys):
    path = robot(tmp_path, ("ball", "0 0 0", "0 0 0", '<sphere radius="0.1"/>'))
    files = [str(tmp_path / f"arm.{ending}") for ending in ("yml", "srdf")]
    words = ["robot-balls", str(path), "-o", files[0], "-o", files[1], "--plane", "0", "0", "1"]
    assert main([*words, "-0.05"]) == 0
    told = capsys.readouterr().out
    assert "1 ball for 1 link" in told and "coverage: " in told and "surface gap: " in told
    spheres = yaml.safe_load((tmp_path / "arm.yml").read_text())["collision_spheres"]
    (ball,) = spheres["ball"]  # from -0.05 to 0.1
    assert ball["radius"] == pytest.approx(0.075) and ball["center"][2] == pytest.approx(0.025)
    assert main([*words, "0"]) == 2 and "already" in capsys.readouterr().err
    assert main([*words[:2], "-o", str(tmp_path / "arm.txt")]) == 2


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_yourdfpy_reads_the_balls(arm, tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed")
    medialis.write_robot_balls(tmp_path / "arm.urdf", arm)
    links = yourdfpy.URDF.load(str(tmp_path / "arm.urdf"), build_scene_graph=False).link_map
    for name, cover in arm.links.items():
        balls = [one.geometry.sphere.radius for one in links[name].collisions]
        places = [one.origin[:3, 3] for one in links[name].collisions]
        assert balls == cover.radii.tolist() and np.allclose(places, cover.centers, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "words"),
    [("<robot", "no XML"), ("<mujoco/>", "begins with <mujoco>"), ("<robot/>", "No link"),
     ('<!DOCTYPE r [<!ENTITY a "b">]><robot/>', "entities"),
     (f"<robot>{LINK.format('a', '0 0 0', '0 0 0', '<box/>')}</robot>", "3 numbers")],
)  # fmt: skip
def test_what_is_no_robot_is_refused(tmp_path, text, words):
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    with pytest.raises(medialis.InvalidShapeError, match=words):
        medialis.robot_balls(path)
