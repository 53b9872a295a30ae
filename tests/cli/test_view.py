"""The command `view`: files, folders, layers, graphs."""

import json
import re

import pytest

import medialis
import rounded
from medialis.cli.commands import main
from medialis.show.viewer import page as viewer_page


@pytest.fixture(autouse=True)
def library(monkeypatch):
    monkeypatch.setattr(viewer_page, "_library", lambda: "")


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    medialis.write_mesh(tmp_path / "a & b.ply", medialis.organic_shape(56))
    return "a & b.ply"


@pytest.mark.slow
def test_a_file_with_what_is_computed(file, tmp_path, capsys):
    assert main(["view", file, "--show", "thickness,curve-skeleton"]) == 0
    text = (tmp_path / "a & b-view.html").read_text("utf-8")
    assert "<title>a &amp; b.ply</title>" in text and '"title": "curve skeleton"' in text
    assert "a & b-view.html" in capsys.readouterr().out


def test_the_shape_alone(file, tmp_path):
    assert main(["view", file, "--show", "", "-o", "page.html"]) == 0
    assert '"kind": "surface"' in (tmp_path / "page.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("output", "name"),
    [("page", "page.html"), ("v1.2", "v1.2.html"), ("a.HTM", "a.HTM"), ("b.html", "b.html")],
)
def test_the_page_ends_in_html(file, tmp_path, output, name):
    """`-o name` wrote a page without .html, which browsers show as text (fixed)."""
    assert main(["view", file, "--show", "", "-o", output]) == 0
    assert [path.name for path in tmp_path.iterdir() if path.name != file] == [name]


@pytest.mark.slow
def test_folders_layers_and_graphs(file, tmp_path):
    for name, more in (("thickness", []), ("curve-skeleton", ["--formats", "swc"])):
        assert main([name, file, "--no-picture", *more]) == 0
    folder = next(path for path in tmp_path.iterdir() if path.is_dir())
    for source, expected in (
        (folder, '"thickness"'),
        (folder / "curve_skeleton", '"kind": "curves"'),
        (folder / "thickness" / "thickness.ply", '"thickness"'),
        (folder / "curve_skeleton" / "curve_skeleton.swc", '"kind": "curves"'),
    ):
        assert main(["view", str(source), "-o", "page.html"]) == 0
        assert expected in (tmp_path / "page.html").read_text("utf-8")


def test_what_cannot_be_computed_is_left_out(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shape = medialis.organic_shape(56)
    medialis.write_mesh("cloud.ply", shape.points, attributes={"normal": shape.normals})
    assert main(["view", "cloud.ply", "--show", "skeleton_mesh,surface_skeleton"]) == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["view", "nowhere.ply"], "nowhere.ply"),
        (["view", "."], "holds no results"),
        (["view", "a & b.ply", "--show", "thicknes"], "thicknes"),
    ],
)
def test_one_line_says_what_is_wrong(file, arguments, said, capsys, tmp_path):
    assert main(arguments) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.glob("*.html"))


@pytest.mark.slow
def test_results_of_one_coarse_part_are_shown_together(tmp_path, monkeypatch, capsys):
    """Refined and repaired, it differs by more than two shapes may (fixed)."""
    monkeypatch.chdir(tmp_path)
    shape = medialis.make_shape(*rounded.tee(3.0, 2.0, 40.0, 30.0, 2.0, 50.0, 3))
    medialis.write_mesh("tee.ply", shape)
    for operation in ("thickness", "midsurface", "ball-reconstruction"):
        assert main([operation, "tee.ply", "--unit", "mm", "--no-picture"]) == 0
    assert main(["view", "tee-medialis"]) == 0
    assert "tee-medialis-view.html" in capsys.readouterr().out


@pytest.mark.slow
def test_a_threshold_and_a_unit_are_those_of_what_is_seen_first(file, tmp_path, capsys):
    assert main(["view", file, "--unit", "mm", "--threshold", "0.2mm", "--show", "thickness"]) == 0
    page = next(tmp_path.glob("*.html")).read_text(encoding="utf-8")
    assert '"mm"' in page or " mm" in page
    assert main(["view", file, "--threshold", "0.2mm"]) == 2  # nobody knows what a millimetre is
    assert main(["view", file, "--threshold", "1%", "--show", "parts"]) == 2
    assert "--show thickness" in capsys.readouterr().err


@pytest.mark.slow
def test_results_that_are_read_take_a_threshold_and_a_unit(file, tmp_path, capsys):
    """They were ignored without a word (fixed)."""
    for name in ("thickness", "surface-skeleton", "parts"):
        assert main([name, file, "--no-picture", "--refine", "0", "-o", name]) == 0
    for name, end in (("thickness", "to"), ("surface-skeleton", "from")):
        assert main(["view", name, "--unit", "mm", "--threshold", "0.1mm", "-o", "a.html"]) == 0
        scene = json.loads(
            re.search(r'id="scene">(.*?)</script>', (tmp_path / "a.html").read_text("utf-8"))[1]
        )
        fields = [field for part in scene["parts"] for field in part["fields"]]
        ends = [f["low"] + f[end] * (f["high"] - f["low"]) for f in fields if 0 < f[end] < 1]
        assert ends == [pytest.approx(0.1, rel=1e-3)] and scene["unit"] == "mm"
    assert main(["view", "thickness", "--threshold", "1mm"]) == 2
    assert main(["view", "parts", "--threshold", "1%"]) == 2
    assert "--threshold is for" in capsys.readouterr().err


@pytest.mark.slow
def test_folders_of_several_shapes_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, size in (("one", 56), ("two", 80)):
        shape = medialis.organic_shape(size)
        scaled = medialis.make_shape(size * shape.points, shape.faces)
        medialis.write_mesh(f"{name}.ply", scaled)
        assert main(["thickness", f"{name}.ply", "--no-picture", "-o", f"all/{name}"]) == 0
    assert main(["view", "all"]) == 2
    assert "several shapes" in capsys.readouterr().err
