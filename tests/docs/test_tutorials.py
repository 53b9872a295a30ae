"""Every code block of every tutorial runs, in the order of the page."""

import shutil
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from code_blocks import blocks, run_bash, run_python
from website.pages import DOCS

import medialis
from medialis.formats.ply_attributes import write_ply

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


@pytest.mark.slow
def test_thickness_check(run_page, tmp_path, capsys):
    """The check that fails a build passes a part that is fine (it raised IndexError)."""
    names, _ = run_page(DOCS / "tutorials" / "thickness_check.md")
    spots = names["result"].values["spots"]
    # The tips of the creature's ears have a radius of 0.03, pressed flat by 1.6, 50 times larger.
    assert 0 < spots[0]["value"] < names["wanted"]
    assert max(spot["position"][2] for spot in spots) > 0.9 * names["shape"].points[:, 2].max()
    assert (tmp_path / "thickness" / "thickness.ply").is_file()
    assert capsys.readouterr().out.endswith("fine: nothing is thinner than 0.5 mm\n")
    with pytest.raises(SystemExit, match=rf"^too thin: {spots[0]['value']:.2f} mm, 5.0 mm are"):
        names["check"](names["shape"], names["wanted"])


@pytest.mark.slow
def test_rigging(run_page, tmp_path, capsys):
    names, _ = run_page(DOCS / "tutorials" / "rigging.md")
    moved = np.linalg.norm(names["posed"] - names["figure"].points, axis=1)
    share = names["share"][:, 0]
    assert (moved[share == 0] == 0).all() and moved[share > 0.99].max() > 0.05
    assert "bone 003.L below bone 002" in capsys.readouterr().out
    assert (tmp_path / "rigged" / "armature.ply").is_file()


@pytest.mark.slow
def test_batch_over_a_folder(run_page, tmp_path):
    names, output = run_page(DOCS / "tutorials" / "batch_over_a_folder.md")
    assert "4 results were computed" in output and "2 results failed" in output
    status = {row.name: row.status for row in names["rows"]}
    assert sorted(status.values()) == ["done", "done", "failed"]
    assert (tmp_path / "results" / "results.html").is_file()


@pytest.mark.slow
def test_noisy_scan(run_page):
    """What is left is nearer to the true skeleton than everything: the page says so."""
    names, _ = run_page(DOCS / "tutorials" / "noisy_scan.md")
    assert names["after"] < names["before"] / 2


@pytest.mark.slow
def test_solid_to_shells(run_page, tmp_path):
    """The model has the deflection that the page tells, where CalculiX is there to solve it."""
    names, output = run_page(DOCS / "tutorials" / "solid_to_shells.md")
    assert "All walls, ribs and gaps that were checked are within the limits" in output
    assert "shell elements" in output
    assert names["expected"] == pytest.approx(9.5238, abs=1e-3)
    if shutil.which("ccx"):
        subprocess.run(["ccx", "job"], cwd=tmp_path, check=True, capture_output=True, timeout=300)
        rows = [line.split() for line in (tmp_path / "job.dat").read_text().splitlines()]
        found = [float(row[3]) for row in rows if len(row) == 4]
        assert len(found) == len(names["loaded"])
        assert sum(found) / len(found) == pytest.approx(names["expected"], rel=0.03)


def test_no_tutorial_is_left_out():
    tested = {"solid_to_shells", "thickness_check", "batch_over_a_folder", "noisy_scan"}
    tested |= {"denoising_a_scan", "teeth", "rigging"}
    tested |= {"first_skeleton_in_blender"}  # by tests/blender/test_first_skeleton_tutorial.py
    assert {page.stem for page in TUTORIALS} == tested


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "host", "said", "made"),
    [
        ("batch_to_meshlab.py", "pymeshlab", "2 layers", "skeletons.mlp"),
        ("batch_to_blender.py", "bpy", "1 objects", "skeletons.blend"),
    ],
)
def test_batch_scripts(script, host, said, made, tmp_path):
    """Each good shape is in the host's file; a broken one is named and stops nothing."""
    if find_spec(host) is None:
        pytest.skip(f"needs {host}")
    (tmp_path / "scans").mkdir()
    figure = medialis.organic_shape(56)
    write_ply(tmp_path / "scans" / "figure.ply", figure.points, figure.faces)
    (tmp_path / "scans" / "broken.ply").write_text("this is no mesh")
    done = subprocess.run(
        [sys.executable, DOCS / "examples" / script, "scans", "out"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    assert "broken.ply Cannot read" in done.stdout and said in done.stdout
    assert (tmp_path / "out" / made).is_file()


@pytest.mark.slow
def test_denoising_a_scan(run_page, tmp_path):
    """The page of denoise promises: few good points go, about 5 % of the outliers stay.

    Outliers here fill the box, so those within a spacing of the surface cannot be told from it.
    """
    names, _ = run_page(DOCS / "tutorials" / "denoising_a_scan.md")
    assert 0 < names["lost"] < 0.1 and names["left"] < 0.1
    assert (tmp_path / "skeleton" / "surface_skeleton.ply").is_file()


@pytest.mark.slow
def test_teeth(run_page):
    """One segment for each pick, and nearly all of the teeth in the segment of their pick."""
    names, _ = run_page(DOCS / "tutorials" / "teeth.md")
    assert names["segment"].max() + 1 == len(names["picks"]) == 14
    assert names["right"].mean() > 0.9
