"""Rules by process: the usual ones, a company's own, and walls that are not whole lines."""

import json
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import medialis
import plates
from medialis.walls.rules import NONE, PROCESSES, USUAL, read_rules, rules_of

DOCS = Path(__file__).resolve().parents[2] / "docs"
QUIET = {"refine": 0.03}


@pytest.fixture(scope="module")
def ribbed():
    """A plate of 2 mm, five lines of 0.4 mm with walls of 1.2 (three) and of 1 mm (2.5)."""
    points, faces = plates.boxes(
        (0, 60, 0, 40, 0, 2), (0, 60, 19, 20.2, 2, 12), (10, 11, 0, 19, 2, 12)
    )
    return medialis.make_shape(points, faces, unit="mm")


def check(shape, **options):
    return medialis.run("wall_check", shape, **QUIET, **options).values


def test_walls_that_are_not_whole_lines_are_told_and_fail_nothing(ribbed):
    values = check(ribbed, process="FDM")
    assert values["passed"] and values["part_lines"] == 1 and values["thick_ribs"] == 0
    (region,) = values["regions"]
    assert region["kind"] == "part lines" and region["lines"] == pytest.approx(2.5, rel=1e-6)
    assert 10 <= region["position"][0] <= 11
    finer = check(ribbed, process="FDM", line_width="0.5mm")  # 1 mm is two, 2 is four, 1.2 is 2.4
    lines = [row["lines"] for row in finer["regions"]]  # on both sides of the other wall
    assert lines == pytest.approx([2.4, 2.4], rel=1e-6)
    assert check(ribbed, line_width="0.2mm")["part_lines"] == 0  # 5, 6 and 10


@pytest.mark.parametrize("factor", [1e-3, 40.0])
def test_lines_scale_with_the_part(ribbed, factor):
    shape = medialis.make_shape(factor * ribbed.points, ribbed.faces, unit="mm")
    assert check(shape, line_width=f"{0.4 * factor}mm")["part_lines"] == 1


def test_a_process_says_what_is_not_given(ribbed):
    moulded = check(ribbed, process="moulding")
    assert (moulded["minimum"], moulded["maximum"]) == pytest.approx((0.8, 4.0))
    assert moulded["thick_ribs"] == 1 and moulded["part_lines"] is None  # 1 of 1.2 mm
    assert check(ribbed, process="moulding", rib_ratio=0.9)["thick_ribs"] == 0
    mixed = check(ribbed, process="SLS", minimum="1.1mm", material="ABS")
    assert (mixed["minimum"], mixed["maximum"]) == pytest.approx((1.1, 3.56))
    assert mixed["narrow_gaps"] == 0  # SLS says a gap
    bare = medialis.make_shape(ribbed.points, ribbed.faces)
    with pytest.raises(medialis.InvalidOptionError, match="the unit of the shape is not known"):
        check(bare, process="FDM")


def test_a_company_edits_a_copy(tmp_path, ribbed):
    path = tmp_path / "ours.toml"
    path.write_text(USUAL.read_text("utf-8").replace("minimum = 0.8", "minimum = '0.06in'", 1))
    values = check(ribbed, rules=str(path), process="FDM")
    assert values["minimum"] == pytest.approx(1.524) and values["too_thin"] == 1  # walls, joined
    path.write_text("[ours]\nminimum = 1.1\n")
    assert check(ribbed, rules=str(path))["too_thin"] == 1  # one process: no name is needed
    path.write_text("[ours]\nminimum = '1.1units'\n")  # where nobody knows the unit, as in MeshLab
    bare = medialis.make_shape(ribbed.points, ribbed.faces)
    assert check(bare, rules=str(path))["minimum"] == pytest.approx(1.1)
    assert rules_of("", NONE) is None and read_rules(USUAL) == PROCESSES


@pytest.mark.parametrize(
    ("text", "process", "said"),
    [("[FDM", "FDM", "TOML"), ("minimum = 1", "FDM", "below a process"),
     ("# x", "FDM", "no process"), ("[FDM]\nminimun = 1", "FDM", "did you mean minimum"),
     ("[FDM]\ngap = -1", "FDM", "from 0 up"), ("[FDM]\ngap = 'wide'", "FDM", "must be a length"),
     ("[FDM]\nabout = 1", "FDM", "must be text"),
     ("[a]\n[b]", "FDM", "rules for a, b, and FDM"), ("[a]\n[b]", NONE, "no process is chosen"),
     ("[FDM]\nmost_lines = true", "FDM", "must be a number")],
)  # fmt: skip
def test_a_file_that_is_no_rules_is_refused_in_a_sentence(tmp_path, text, process, said):
    path = tmp_path / "rules.toml"
    path.write_text(text)
    with pytest.raises(medialis.InvalidOptionError, match=said):
        rules_of(str(path), process)
    with pytest.raises(medialis.FileError, match="no such file"):
        rules_of(str(tmp_path / "none.toml"), process)


@pytest.mark.slow
def test_the_macro_for_freecad_checks_a_body_and_writes_page_and_json(
    tmp_path, monkeypatch, ribbed
):
    """With stand-ins for what it asks of FreeCAD: the mesh of a body, its name, a line of text.

    Pictures are left out, and fewer samples taken: other tests draw and measure them.
    """
    monkeypatch.setattr("medialis.show.reports.report.stills", lambda *_: [])
    run = medialis.run
    monkeypatch.setattr(medialis, "run", lambda *given, **more: run(*given, **more, **QUIET))
    points = [SimpleNamespace(x=x, y=y, z=z) for x, y, z in ribbed.points.tolist()]
    mesh = SimpleNamespace(Topology=(points, [tuple(face) for face in ribbed.faces.tolist()]))
    said, opened = [], []
    console = SimpleNamespace(PrintMessage=said.append)
    monkeypatch.setitem(sys.modules, "FreeCAD", SimpleNamespace(GuiUp=False, Console=console))
    made = SimpleNamespace(meshFromShape=lambda **_: mesh)
    monkeypatch.setitem(sys.modules, "MeshPart", made)
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    macro = runpy.run_path(str(DOCS / "examples/wall_check.FCMacro"))
    macro["main"]([SimpleNamespace(Label="Bracket", Shape=None)])
    assert said == ["Bracket: All walls, ribs and gaps that were checked are within the limits.\n"]
    (page,) = opened
    page = Path(page.removeprefix("file://"))
    text, content = (
        page.read_text("utf-8"),
        json.loads(page.with_suffix(".json").read_text("utf-8")),
    )
    assert "Wall check of Bracket" in text and "1 wall is not whole lines" in text
    assert content["values"]["part_lines"] == 1 and content["parameters"]["process"] == "FDM"
    (region,) = content["tables"]["regions"]
    assert region["lines"] == pytest.approx(2.5, rel=1e-6)


def test_the_page_shows_the_file_as_it_is():
    assert USUAL.read_text("utf-8") in (DOCS / "wall_check.md").read_text("utf-8")
