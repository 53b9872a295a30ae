"""What of a result the viewer shows, how large the page is, and where it is shown."""

import json
import re
import sys
import webbrowser
from types import SimpleNamespace

import numpy as np
import pytest

import medialis
from medialis.show.viewer import page as viewer_page
from medialis.show.viewer.page import places_of, scene_of


@pytest.fixture(scope="module")
def shape():
    return medialis.organic_shape(56)


@pytest.fixture(scope="module")
def results(default_run):
    return [default_run(name) for name in ("surface_skeleton", "thickness", "curve_skeleton")]


@pytest.fixture
def library(monkeypatch):
    """Make pages also where the library is not built: their text is what is looked at."""
    monkeypatch.setattr(viewer_page, "_library", lambda: "")


@pytest.mark.slow
def test_the_first_result_is_seen_inside_a_see_through_surface(results):
    shown = scene_of(results)
    parts = {part.title: part for part in shown}
    assert list(parts) == ["surface skeleton", "surface", "curve skeleton", "curve skeleton parts"]
    assert [part.visible for part in shown] == [True, True, False, False]
    surface = parts["surface"]
    assert 0 < surface.opacity < 0.5 and surface.color_by is None
    assert [field.name for field in surface.fields] == [
        "thickness",
        "wall_thickness",
        "thin_spot",
    ]
    assert len(places_of(results, np.zeros(3))) == results[1].values["thin_spots"]


def test_a_field_on_the_surface_is_seen_whole(results):
    (part,) = scene_of(results[1:2])
    assert part.kind == "surface" and part.opacity == 1 and part.color_by == "wall_thickness"
    assert part.points is results[1].shown[0].points, "the finer surface"


@pytest.mark.slow
def test_values_on_the_same_surface_are_one_part(shape):
    fine = {"refine": 0.02}
    both = [medialis.run("parts", shape, **fine), medialis.run("soft_edges", shape, **fine)]
    (part,) = scene_of(both)
    assert {"parts", "sharpness", "edge_angle"} <= {field.name for field in part.fields}


def test_a_skeleton_alone_gets_the_shape_around_it(results):
    parts = scene_of(results[:1])
    assert [part.kind for part in parts] == ["surface", "points"]
    assert parts[0].points is results[0].shape.points


@pytest.mark.slow
def test_triangles_inside_hide_the_points_that_they_are_made_of(default_run):
    parts = {p.title: p for p in scene_of([default_run("medial_sheets")])}
    assert not parts["medial sheets"].visible
    assert parts["sheet meshes"].visible and parts["sheet meshes"].opacity == 1
    assert parts["surface"].visible and parts["surface"].opacity < 0.5


def test_a_cloud_is_shown_as_points(shape):
    cloud = medialis.Shape(shape.points, shape.normals)
    kinds = [part.kind for part in scene_of([medialis.run("surface_skeleton", cloud)])]
    assert kinds == ["points", "points"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [o.name for o in medialis.OPERATIONS])
def test_every_operation_can_be_shown(name, default_run, library):
    text = viewer_page.viewer_page([default_run(name)], name)
    scene = json.loads(re.search(r'id="scene">(.*?)</script>', text)[1])
    assert any(part["visible"] for part in scene["parts"])
    for part in scene["parts"]:
        for field in part["fields"]:
            assert np.isfinite([field["low"], field["high"], *field["limits"]]).all()


def test_angles_are_degrees_and_thresholds_too(default_run):
    result = default_run("skeleton_mesh")
    part = next(part for part in scene_of([result]) if part.title == "skeleton mesh")
    angle = next(field for field in part.fields if field.name == "spoke_angle")
    assert angle.unit == "degrees"
    assert np.array_equal(angle.values, np.degrees(result.layers[0].attributes["spoke_angle"]))


def test_names_cannot_leave_the_data(results, library):
    title = "</script><script>alert(1)</script><!--"
    text = viewer_page.viewer_page(results[:1], title)
    assert "<script>alert" not in text
    assert json.loads(re.search(r'id="scene">(.*?)</script>', text)[1])["title"] == title


def test_nothing_is_loaded_from_elsewhere(results, library):
    text = viewer_page.viewer_page(results[:1])
    assert not re.search(r'(?:src|href)="(?!data:)|url\(|import\s*\(|@import', text)


def test_a_missing_library_is_a_sentence(results, tmp_path, monkeypatch):
    monkeypatch.setattr(viewer_page, "LIBRARY", "nowhere.js")
    viewer_page._library.cache_clear()
    with pytest.raises(medialis.FileError, match="make viewer"):
        results[0].viewer_html(tmp_path / "page.html")
    viewer_page._library.cache_clear()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_horse_with_its_skeleton_is_small(real_shapes, tmp_path):
    if not viewer_page.has_library():
        pytest.skip("the library of the viewer is not built (make viewer)")
    result = medialis.run("surface_skeleton", real_shapes / "horse.ply")
    result.viewer_html(tmp_path / "horse.html")
    assert (tmp_path / "horse.html").stat().st_size < 3e6


def test_scripts_get_a_page_in_the_browser(results, library, monkeypatch, tmp_path):
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    path = results[0].show()
    assert opened == [path.as_uri()] and "Surface skeleton" in path.read_text("utf-8")


def test_notebooks_get_a_frame(results, library, monkeypatch):
    """As data: `IPython.display.HTML` warned that a frame should be one without a page inside."""
    shown = []
    ipython = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=1))
    display = SimpleNamespace(display=lambda data, raw: shown.append(data["text/html"]))
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    assert results[0].show() is None
    (text,) = shown
    assert (
        text.startswith('<iframe title="')
        and ' srcdoc="' in text
        and "&lt;canvas" in text
        and "<canvas" not in text
    )
