"""The report of a run: complete, self-contained, and its numbers are the measured ones."""

import base64
import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.cli.commands import main
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.formats.ply_attributes import write_ply
from medialis.operations.registry import OPERATIONS
from medialis.operations.result import Layer, Result
from medialis.show.reports import report
from medialis.show.reports.measures import along, histogram, measure
from medialis.show.reports.report import report_page, report_texts
from medialis.show.viewer import page as viewer_page

VOID = {"meta", "img", "rect", "path", "line"}


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


@pytest.mark.slow
@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_every_operation_has_a_report(chosen, default_run):
    result = default_run(chosen.name)
    texts = report_texts(result, source="a <b>.ply")
    page = parsed(texts["report.html"])
    assert page.images and all(src.startswith("data:image/png;base64,") for src in page.images)
    assert base64.b64decode(page.images[0].split(",")[1]).startswith(b"\x89PNG")
    assert not re.search(r'(src|href)="(?!data:)', texts["report.html"])
    assert "a <b>.ply" in "".join(page.text)
    assert not re.search(r"\b(nan|inf|None|True|False)\b", "".join(page.text))
    found = json.loads(texts["report.json"], parse_constant=pytest.fail)
    assert found["operation"] == chosen.name and found["input"]["as_computed"]["closed"]
    assert found["topology"]["genus"] == result.shape.diagnosis.genus


@pytest.mark.slow
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
    states = {line["about"]: line["state"] for line in found["verdict"]}
    assert states["Emptiness"] == "good" and states["Balls"] == "info"  # 10 have no normal
    assert found["balls"]["started"] - found["balls"]["maximal"] == 10
    assert found["versions"]["medialis"] and found["seconds"]["total"] > 0


@pytest.mark.slow
def test_a_ball_deeper_than_the_tolerance_is_seen(creature):
    """The balls of a larger tolerance, judged by a smaller one."""
    result = medialis.run("surface_skeleton", creature, tolerance=0.02)
    found = measure(replace(result, parameters={**result.parameters, "tolerance": 3e-4}))
    line = next(line for line in found["verdict"] if line["about"] == "Emptiness")
    assert line["state"] == "look" and "more than the tolerance of 0.03 %" in line["text"]


@pytest.mark.slow
def test_outer_balls_are_empty_but_give_back_no_surface(creature):
    found = measure(medialis.run("surface_skeleton", creature, side="outer"))
    assert found["reconstruction"] is None
    assert 0 < found["emptiness"]["deepest"] <= 3e-4 * 100
    both = measure(medialis.run("surface_skeleton", creature, side="both", fans=False))
    inner = measure(medialis.run("surface_skeleton", creature, fans=False))
    assert both["reconstruction"] == inner["reconstruction"]


@pytest.mark.slow
def test_loops_and_centredness_of_a_ring():
    """A torus has one handle, and its curve skeleton is the middle circle. The distance to a facet
    is smaller than the radius by the sagitta of a tube with 24 sides at most, and the nodes may
    leave the middle by a tenth of the radius."""
    result = medialis.run("curve_skeleton", forms.torus_mesh(96, 24, 1.0, 0.25))
    found = measure(result)
    assert (found["topology"]["expected_loops"], found["topology"]["loops"]) == (1, 1)
    lines = {line["about"]: line for line in found["verdict"]}
    assert lines["Loops"]["text"] == "1 expected (one for each handle), 1 found."
    assert lines["Loops"]["state"] == lines["Components"]["state"] == "good"
    assert found["centredness"]["median"] == pytest.approx(1, abs=0.1 + 1 - np.cos(np.pi / 24))
    cut = replace(
        result, extras={"graph": CurveSkeleton.of(result.extras["graph"].nodes[:9], [], np.ones(9))}
    )
    lines = {line["about"]: line for line in measure(cut)["verdict"]}
    assert lines["Loops"]["state"] == lines["Components"]["state"] == "look"


def test_balls_along_an_edge_are_a_step_apart_at_most():
    graph = CurveSkeleton.of([[0, 0, 0], [1, 0, 0], [1, 2, 0.0]], [[0, 1], [1, 2]], [1, 2, 4.0])
    centers, radii = along(graph, 0.5)
    assert len(radii) == 3 + 1 + 3
    # The radius runs linearly along each edge.
    x, y = centers[:, 0], centers[:, 1]
    assert np.allclose(radii, np.where(y == 0, 1 + x, 2 + y))
    assert along(graph, 0.0)[0] is graph.nodes


@pytest.mark.parametrize(
    ("values", "bins", "median"),
    [([], 0, None), ([np.nan, np.inf], 0, None), ([2.0, 2.0], 1, 2.0), ([0.0, 0.0], 1, 0.0)],
)
def test_histograms_without_a_range(values, bins, median):
    found = histogram(values)
    assert len(found["counts"]) == bins and found["median"] == median
    assert found["count"] + found["infinite"] + found["missing"] == len(values)


def test_a_histogram_of_values_that_differ_by_rounding():
    """A sphere: numpy refuses 40 bins between neighbouring numbers."""
    values = [1.0, np.nextafter(1.0, 2)]
    assert histogram(values)["counts"] == [2]


def test_infinite_importance_is_told(creature):
    """Parts that overlap: some pairs of feature points are joined by no path."""
    layer = Layer(
        "a", np.zeros((4, 3)), attributes={"importance": np.array([1, 2, np.inf, np.nan])}
    )
    result = Result(shape=creature, layers=(layer,), operation="skeleton_importance")
    found = measure(result)
    assert found["histograms"]["importance"]["infinite"] == 1
    text = "".join(parsed(report_page(found, [])).text)
    assert "1 infinite, not shown; 1 missing, not shown" in text


@pytest.mark.slow
def test_values_that_are_not_numbers_have_a_place(creature):
    result = medialis.run("surface_skeleton", creature, subsample=0.05)
    values = {
        "a": None,
        "b": np.inf,
        "c": "<i>",
        "radius_d": np.nan,
        "e": {"f": np.nan, "g": [{"h": np.nan}]},
        "i": [1, np.nan],
        "j": [{"k": [np.nan]}],
    }
    texts = report_texts(replace(result, values=values))
    json.loads(texts["report.json"], parse_constant=pytest.fail)
    text = "".join(parsed(texts["report.html"]).text)
    assert "–" in text and "<i>" in text and "nan" not in text


def test_a_result_without_anything(creature):
    """No layer, no ball, no value: the shape is still described."""
    point = medialis.Shape(np.zeros((1, 3)), np.zeros((1, 3)))
    texts = report_texts(Result(shape=point, operation="manifolds"))
    json.loads(texts["report.json"], parse_constant=pytest.fail)
    assert "A cloud of 1 point." in "".join(parsed(texts["report.html"]).text)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-29, 1.0, 1e29])
def test_clouds_and_equal_values_of_any_size_have_a_report(scale):
    """A cloud has no areas to show. Of equal radii of 1e29, numpy made no bins: half of 1 up and
    down is nothing there."""
    form = forms.sphere(300).shape
    cloud = medialis.Shape(scale * form.points, form.normals)
    texts = report_texts(medialis.run("thickness", cloud))
    found = json.loads(texts["report.json"])
    assert found["thin_spots"][0]["area"] is None and parsed(texts["report.html"]).images
    chart = found["histograms"]["thickness"]
    assert sum(chart["counts"]) == chart["count"] == 300
    assert chart["edges"] == sorted(chart["edges"])


@pytest.mark.slow
def test_the_command_line_writes_it(creature, tmp_path, capsys):
    write_ply(tmp_path / "a.ply", creature.points, creature.faces)
    out = tmp_path / "out"
    assert main(["thickness", str(tmp_path / "a.ply"), "-o", str(out), "--report"]) == 0
    assert "report.html" in capsys.readouterr().out
    found = json.loads((out / "report.json").read_text("utf-8"))
    assert found["source"] == "a.ply" and len(found["thin_spots"]) == found["values"]["thin_spots"]
    files = json.loads((out / "manifest.json").read_text("utf-8"))["files"]
    assert {"report.html", "report.json"} <= {file.split("/")[-1] for file in files}


@pytest.mark.slow
def test_the_report_can_be_turned(creature, monkeypatch):
    """Its frame holds the viewer as text, so that the report stays one file."""
    monkeypatch.setattr(report, "has_library", lambda: True)
    monkeypatch.setattr(viewer_page, "_library", lambda: "")
    result = medialis.run("thickness", creature)
    text = report_texts(result, source="a <b>.ply")["report.html"]
    frame = re.search(r'<section id="viewer"><iframe title="[^"]*" srcdoc="([^"]*)"', text)[1]
    assert "Thickness of a &lt;b&gt;.ply" in html.unescape(frame)
    monkeypatch.setattr(report, "has_library", lambda: False)
    assert "iframe" not in report_texts(result)["report.html"]


@pytest.mark.slow
def test_a_result_too_large_for_a_page_is_drawn_only(creature, monkeypatch):
    monkeypatch.setattr(report, "has_library", lambda: True)
    monkeypatch.setattr(report, "MOST_POINTS", 100)
    assert "iframe" not in report_texts(medialis.run("thickness", creature))["report.html"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "solid"),
    [
        (forms.torus_mesh(), "1 surface piece and 1 handle"),
        (forms.icosphere(2), "1 surface piece and 0 handles"),
    ],
    ids=["torus", "ball"],
)
def test_a_medial_mesh_is_held_against_the_solid(shape, solid):
    """Error, its place and the topology; a mesh that has lost its loop is told."""
    result = medialis.run("medial_mesh", shape, balls=12, quality="fast", cell=0.05)
    found = measure(result)
    envelope = found["envelope"]
    assert envelope["largest_error"] == pytest.approx(
        100 * result.values["largest_error"] / shape.diagonal
    )
    assert envelope["largest_error"] == max(
        envelope["surface_to_envelope"], envelope["envelope_to_surface"]
    )
    assert envelope["worst_place"] == result.values["position"]
    lines = {line["about"]: line for line in found["verdict"]}
    assert solid in lines["Topology"]["text"] and lines["Topology"]["state"] == "good"
    assert "the largest is at" in lines["Envelope"]["text"]
    torn = replace(result, values={**result.values, "loops": 5})
    (line,) = [line for line in measure(torn)["verdict"] if line["about"] == "Topology"]
    assert line["state"] == "look" and "has 1 surface piece and 5 handles" in line["text"]
    page = parsed(report_page(found, []))
    assert any("surface and the envelope" in text for text in page.text)
