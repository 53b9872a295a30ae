"""The readers of numbers that are shown, on texts as they look, and on one shape."""

import json

import pytest
import shown_numbers
from shown_suite import surfaces
from shown_suite.shapes import Known, bracket

import medialis
from medialis.batches.batch import csv_text
from medialis.batches.jobs import DONE, Row
from medialis.cli.display import summary_lines
from medialis.show.writing import Pictures

SCREEN = """wall check of a.ply
  passed      no
  thickness   0.8 to 4 mm, median 2.004 mm
  area        1,040 mm²
  too thin    1
     regions   value   area, one side  position
  1  too thin  0.8 mm  496.2 mm²       30, 14, 12.5
note: Walls are to be 1 mm to 3.5 mm thick at (1, 2, 3).
2 files in a, 4.5 seconds:
  wall_check.png  picture
  and samples.ply
"""


def test_numbers_of_a_screen():
    told = {one.name: one for one in surfaces.on_screen(SCREEN) if one.where == "screen"}
    assert {name: (one.number, one.unit) for name, one in told.items()} == {
        "thickness_min": (0.8, "mm"),
        "thickness_max": (4.0, "mm"),
        "thickness_median": (2.004, "mm"),
        "area": (1040.0, "mm²"),
        "too_thin": (1.0, ""),
        "regions[0].value": (0.8, "mm"),
        "regions[0].area": (496.2, "mm²"),
    }
    assert told["thickness_median"].agrees(2.00449) and not told["thickness_median"].agrees(2.0046)
    notes = [one.number for one in surfaces.on_screen(SCREEN) if one.where == "note"]
    assert notes == [1.0, 3.5]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A wall check of the bracket, with few samples."""
    shape = bracket()
    result = medialis.run("wall_check", shape, minimum="1mm", maximum="3.5mm", refine=0.08)
    folder = tmp_path_factory.mktemp("run")
    medialis.write_mesh(folder / "bracket.ply", shape)
    medialis.write_result(result, folder / "result", pictures=Pictures(main=False))
    return folder / "result", json.loads((folder / "result" / "manifest.json").read_text("utf-8"))


def everything(folder, manifest):
    """All that the screen, the page and the table say of a result."""
    screen = "\n".join(summary_lines(manifest, width=200))
    yield from surfaces.on_screen(screen)
    row = Row("a", "a.ply", "wall_check", DONE, values=manifest["values"], unit="mm")
    yield from (one for _, one in surfaces.in_csv(csv_text([row]), "a") if one.name != "seconds")


def test_one_shape_agrees_with_itself_and_a_changed_number_does_not(run):
    folder, manifest = run
    told = list(everything(folder, manifest))
    assert len(told) > 30
    assert list(shown_numbers.held_against(iter(told), manifest)) == []
    known = Known("bracket", bracket, {}, {"wall_check": {"minimum": (1, 1e-9)}})
    assert list(shown_numbers._true(manifest, known)) == []
    changed = json.loads(json.dumps(manifest))
    changed["values"]["typical"] *= 1.01
    changed["values"]["regions"][0]["area"] *= 1.01
    changed["values"]["minimum"] = 1.1
    lines = list(shown_numbers.held_against(iter(told), changed))
    assert [line.split(" ")[:2] for line in lines] == [
        *(["screen:", name] for name in ("minimum", "typical", "regions[0].area")),
        *(["csv:", name] for name in ("minimum", "typical")),
    ]
    assert len(list(shown_numbers._true(changed, known))) == 1  # the limit
    unit = json.loads(json.dumps(manifest).replace(" mm", ""))
    without = "\n".join(summary_lines({**unit, "unit": None}, width=200))
    lines = list(shown_numbers.held_against(surfaces.on_screen(without), manifest))
    assert lines and all("has the unit ''" in line for line in lines)
