"""The report of a run: complete, self-contained, and its numbers are the measured ones."""

import base64
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.cli import main
from medialis.io.ply_attributes import write_ply
from medialis.operations.registry import OPERATIONS
from medialis.quality.measures import measure
from medialis.quality.report import report_page, report_texts

VOID = {"meta", "img", "rect", "br"}


class Balance(HTMLParser):
    """Check that every element is closed in order, and collect the sources of images."""

    def __init__(self):
        super().__init__()
        self.open, self.images, self.text = [], [], []

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.images.append(dict(attributes)["src"])
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def parsed(page):
    parser = Balance()
    parser.feed(page)
    parser.close()
    assert parser.open == []
    return parser


@pytest.fixture(scope="module")
def creature():
    shape = medialis.organic_shape(56)
    return medialis.make_shape(shape.points, shape.faces, repair=True)


@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_every_operation_has_a_report(chosen, creature):
    texts = report_texts(medialis.run(chosen.name, creature), source="a <b>.ply")
    page = parsed(texts["report.html"])
    assert page.images and all(src.startswith("data:image/png;base64,") for src in page.images)
    assert base64.b64decode(page.images[0].split(",")[1]).startswith(b"\x89PNG")
    assert not re.search(r'(src|href)="(?!data:)', texts["report.html"])
    assert "a <b>.ply" in "".join(page.text)
    found = json.loads(texts["report.json"])
    assert found["operation"] == chosen.name and found["input"]["as_computed"]["closed"]
    assert found["topology"]["genus"] == creature.diagnosis.genus


def test_the_numbers_are_those_of_the_shape(creature):
    """Emptiness by brute force; histograms count every point; the default tolerance is a bound."""
    result = medialis.run("surface_skeleton", creature)
    found = measure(result)
    layer, shape = result.layers[0], result.shape
    rows = slice(None, None, 50)
    gaps = np.linalg.norm(layer.points[rows, None] - shape.points, axis=2).min(axis=1)
    slow = (layer.attributes["radius"][rows] - gaps).max() / shape.diagonal * 100
    assert slow - 1e-9 <= found["emptiness"]["deepest"] <= 3e-4 * 100
    assert sum(found["histograms"]["radius"]["counts"]) == len(layer.points)
    assert found["reconstruction"]["surface_to_balls_max"] <= 3e-4 * 100 + 1e-9
    assert found["versions"]["medialis"] and found["seconds"]["total"] > 0


def test_values_that_are_not_numbers_have_a_place(creature):
    result = medialis.run("surface_skeleton", creature, subsample=0.05)
    found = {**measure(result), "values": {"a": None, "b": np.inf, "c": "<i>"}}
    text = "".join(parsed(report_page(found, [])).text)
    assert "inf" in text and "<i>" in text


@pytest.mark.parametrize("scale", [1e-29, 1.0, 1e29])
def test_clouds_and_equal_values_of_any_size_have_a_report(scale):
    """A cloud has no areas to show. Of equal radii of 1e29, numpy made no bins: half of 1 up and
    down is nothing there."""
    form = forms.sphere(300).shape
    cloud = medialis.Shape(scale * form.points, form.normals)
    texts = report_texts(medialis.run("thickness", cloud))
    found = json.loads(texts["report.json"])
    assert found["thin_spots"][0]["area"] is None and parsed(texts["report.html"]).images
    counts, edges = found["histograms"]["thickness"].values()
    assert sum(counts) == 300 and edges == sorted(edges)


def test_the_command_line_writes_it(creature, tmp_path, capsys):
    write_ply(tmp_path / "a.ply", creature.points, creature.faces)
    out = tmp_path / "out"
    assert main(["thickness", str(tmp_path / "a.ply"), "-o", str(out), "--report"]) == 0
    assert "report.html" in capsys.readouterr().out
    found = json.loads((out / "report.json").read_text("utf-8"))
    assert found["source"] == "a.ply" and len(found["thin_spots"]) == found["values"]["thin_spots"]
    files = json.loads((out / "manifest.json").read_text("utf-8"))["files"]
    assert {"report.html", "report.json"} <= {file.split("/")[-1] for file in files}
