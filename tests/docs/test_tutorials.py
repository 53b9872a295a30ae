"""Every code block of every tutorial runs, in the order of the page."""

import runpy
import shutil
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from code_blocks import blocks, run_bash, run_python
from website.pages import DOCS

import medialis
from medialis.io.ply_attributes import write_ply

TUTORIALS = sorted((DOCS / "tutorials").glob("*.md"))
LANGUAGES = {"python", "bash"}

pytestmark = pytest.mark.skipif(
    shutil.which("bash") is None, reason="needs bash to run the commands of the tutorials"
)


@pytest.fixture
def run_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(page) -> tuple[dict, str]:
        names, output = {"__name__": "__main__"}, ""
        found = blocks(page)
        assert found and {language for language, _ in found} <= LANGUAGES
        for language, code in found:
            if language == "python":
                run_python(code, page, names)
            else:
                output += run_bash(code, tmp_path)
        return names, output

    return run


def test_thickness_check(run_page, tmp_path):
    names, _ = run_page(DOCS / "tutorials" / "thickness_check.md")
    spots = names["result"].values["spots"]
    # The tips of the creature's ears have a radius of 0.03, pressed flat by 1.6, 50 times larger.
    assert names["too_thin"] and 0 < spots[0]["value"] < names["wanted"]
    assert max(spot["position"][2] for spot in spots) > 0.9 * names["shape"].points[:, 2].max()
    assert (tmp_path / "thickness" / "thickness.ply").is_file()


def test_batch_over_a_folder(run_page, tmp_path):
    names, output = run_page(DOCS / "tutorials" / "batch_over_a_folder.md")
    assert "4 results, 2 failed" in output
    status = {row.name: row.status for row in names["rows"]}
    assert sorted(status.values()) == ["done", "done", "failed"]
    assert (tmp_path / "results" / "results.html").is_file()


def test_noisy_scan(run_page):
    """What is left is nearer to the true skeleton than everything: the page says so."""
    names, _ = run_page(DOCS / "tutorials" / "noisy_scan.md")
    assert names["after"] < names["before"] / 2


def test_no_tutorial_is_left_out():
    tested = {"thickness_check", "batch_over_a_folder", "noisy_scan", "rigging"}
    tested |= {"denoising_a_scan", "teeth"}
    assert {page.stem for page in TUTORIALS} == tested


@pytest.mark.skipif(find_spec("pymeshlab") is None, reason="needs pymeshlab (extra meshlab)")
def test_batch_script_of_pymeshlab(tmp_path):
    """Two layers a shape; a broken file is named and stops nothing."""
    (tmp_path / "scans").mkdir()
    figure = medialis.organic_shape(56)
    write_ply(tmp_path / "scans" / "figure.ply", figure.points, figure.faces)
    (tmp_path / "scans" / "broken.ply").write_text("this is no mesh")
    done = subprocess.run(
        [sys.executable, DOCS / "examples" / "batch_to_meshlab.py", "scans", "out"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    assert "broken.ply Cannot read" in done.stdout and "2 layers" in done.stdout
    assert (tmp_path / "out" / "skeletons.mlp").is_file()


def test_rigging(run_page):
    """Four feet, two ears, nose and tail end; the root lies in the trunk."""
    names, _ = run_page(DOCS / "tutorials" / "rigging.md")
    curve = names["curve"]
    assert len(curve.end_points) == 8 and len(names["node"]) == names["shape"].point_count
    assert abs(curve.nodes[names["thickest"], 1]) < 0.05


@pytest.fixture(scope="module")
def rig():
    return runpy.run_path(str(DOCS / "examples" / "rig_from_curve_skeleton.py"))


def test_bones_are_a_tree_with_parents_first(rig):
    """A ring with two tails: the ring is cut once, every other edge is a bone."""
    edges = [[0, 1], [1, 2], [2, 3], [3, 0], [0, 4], [4, 5], [2, 6]]
    points = np.random.default_rng(1).normal(size=(7, 3))
    radii = [1, 1, 3, 1, 1, 1, 1]
    curve = medialis.CurveSkeleton.of(points, edges, radii, vertex_node=[2, 6, 5, 5, 0])
    bones = rig["bones_of"](curve)
    assert len(bones) == 6 and sorted(bone.tail for bone in bones) == [0, 1, 3, 4, 5, 6]
    for number, bone in enumerate(bones):
        assert bone.parent < number
        assert bone.head == (2 if bone.parent < 0 else bones[bone.parent].tail)
    owner = rig["bone_of_vertices"](curve, bones)
    assert bones[owner[0]].head == 2 and [bones[k].tail for k in owner[1:]] == [6, 5, 5, 0]


def test_bones_of_two_parts_have_two_roots(rig):
    curve = medialis.CurveSkeleton.of(np.eye(4, 3), [[0, 1], [2, 3]], [1, 2, 3, 4])
    assert [bone.parent for bone in rig["bones_of"](curve)] == [-1, -1]


@pytest.mark.skipif(find_spec("bpy") is None, reason="needs Blender as a module (extra blender)")
def test_rigging_script_in_blender(tmp_path):
    figure = medialis.organic_shape(56)
    write_ply(tmp_path / "figure.ply", figure.points, figure.faces)
    script = DOCS / "examples" / "rig_from_curve_skeleton.py"
    done = subprocess.run(
        [sys.executable, script, "figure.ply", "figure.blend"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    assert "bones" in done.stdout and (tmp_path / "figure.blend").is_file()


def test_denoising_a_scan(run_page, tmp_path):
    """The page of denoise promises: few good points go, about 5 % of the outliers stay.

    Outliers here fill the box, so those within a spacing of the surface cannot be told from it.
    """
    names, _ = run_page(DOCS / "tutorials" / "denoising_a_scan.md")
    assert 0 < names["lost"] < 0.1 and names["left"] < 0.1
    assert (tmp_path / "skeleton" / "surface_skeleton.ply").is_file()


def test_teeth(run_page):
    """One segment for each pick, and nearly all of the teeth in the segment of their pick."""
    names, _ = run_page(DOCS / "tutorials" / "teeth.md")
    assert names["segment"].max() + 1 == len(names["picks"]) == 14
    assert names["right"].mean() > 0.9
