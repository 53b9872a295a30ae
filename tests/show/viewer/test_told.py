"""What the page says in words, and that everything on it has a name; no browser is needed."""

import json
import re
from html.parser import HTMLParser
from importlib import resources

import numpy as np
import pytest

import medialis
import plates
from medialis.operations.result import Outcome
from medialis.show.viewer import page as viewer_page
from medialis.show.viewer.page import numbers_of, places_of

ORIGIN = np.zeros(3)


def scene(text: str) -> dict:
    return json.loads(re.search(r'id="scene">(.*?)</script>', text)[1])


@pytest.fixture
def library(monkeypatch):
    monkeypatch.setattr(viewer_page, "_library", lambda: "")


@pytest.fixture(scope="module")
def check():
    """A wall check in millimetres of steps of 4 and 6 that fails."""
    shape = medialis.make_shape(*plates.step(), unit="mm")
    return medialis.run("wall_check", shape, minimum="5mm", refine=0.05)


def test_places_have_numbers_words_and_units(check):
    places = places_of([check], ORIGIN)
    regions = [one for one in places if one["table"] == "regions"]
    assert [one["number"] for one in regions] == [*range(1, len(check.values["regions"]) + 1)]
    for one, row in zip(regions, check.values["regions"], strict=True):
        assert one["text"].startswith(f"{row['kind']}, ") and " mm, " in one["text"]
        assert one["text"].endswith(" mm² of one side") and one["onShape"]
        assert one["position"] == list(row["position"])


def test_numbers_are_those_of_the_screen(check):
    told = dict(numbers_of([check]))
    assert told["minimum"] == "5 mm" and told["passed"] == "no" and "spacing" not in told


def test_damaged_places_are_none(check):
    rows = [{"kind": "wall"}, 3, {"kind": "wall", "position": None, "value": 1.0}]
    damaged = Outcome(check.shape, values={"spots": rows, "regions": "none", "ribs": [{}]})
    assert places_of([damaged], ORIGIN) == []


def test_a_check_opens_on_its_kinds(check, library):
    """It was grey and see-through, with dots that meant nothing (fixed)."""
    found = scene(viewer_page.viewer_page([check], still=False))
    surface, *others = found["parts"]
    shown = surface["fields"][surface["colorBy"]]
    assert shown["name"] == "check" and shown["label"] and surface["opacity"] == 1
    assert [name.split(":")[0] for name in shown["classes"]][:3] == [
        "within",
        "too thin",
        "too thick",
    ]
    assert not any(part["visible"] for part in others)


def test_borders_of_labels_are_lines(default_run, library):
    """Where two labels met, triangles made saw-teeth; the count that is told stays that before."""
    result = default_run("parts")
    (part,) = viewer_page.scene_of([result])
    cut = viewer_page.with_borders(part)
    shown = next(one for one in cut.fields if one.name == cut.color_by)
    labels = np.asarray(shown.values)
    assert len(cut.points) > len(part.points) and all(
        len(one.values) == len(cut.points) for one in cut.fields
    )
    assert (labels[cut.faces] == labels[cut.faces[:, :1]]).all()
    before, after = (
        medialis.Shape(p.points, np.zeros_like(p.points), p.faces) for p in (part, cut)
    )
    assert after.area == pytest.approx(before.area, rel=1e-9)
    text = viewer_page.viewer_page([result], still=False)
    assert scene(text)["parts"][0]["told"] == len(part.faces)


def test_the_slider_starts_at_the_threshold(default_run, library):
    result = default_run("thickness")
    limit = 0.04 * result.shape.diagonal
    limited = medialis.run("thickness", result.shape, threshold=0.04, refine=0)
    for one, expected in ((result, None), (limited, limit)):
        surface = scene(viewer_page.viewer_page([one], still=False))["parts"][0]
        field = surface["fields"][surface["colorBy"]]
        end = field["low"] + field["to"] * (field["high"] - field["low"])
        assert end == pytest.approx(field["high"] if expected is None else expected, rel=1e-3)


def test_folders_remember_how_pictures_look(check, tmp_path, library):
    medialis.write_result(check, tmp_path / "there", pictures=medialis.Pictures(main=False))
    again = medialis.read_result(tmp_path / "there")
    assert again.shown[0].classes == check.shown[0].classes
    assert again.shown[0].color_by == "check"


@pytest.mark.slow
def test_a_medial_mesh_opens_on_itself(default_run, tmp_path, library):
    """Read from its folder, its envelope lay over it (fixed)."""
    medialis.write_result(
        default_run("medial_mesh"), tmp_path / "m", pictures=medialis.Pictures(main=False)
    )
    result = medialis.read_result(tmp_path / "m")
    parts = {part.title: part for part in viewer_page.scene_of([result])}
    assert parts["medial mesh"].visible and parts["medial mesh"].color_by == "radius"
    assert parts["medial mesh"].opacity == 1 and parts["medial mesh envelope"].opacity < 0.5
    assert not any("seam" in title for title in parts), "a word that the glossary does not have"


def test_balls_are_drawn_as_large_as_they_are(default_run):
    (balls,) = [p for p in viewer_page.scene_of([default_run("ball_reconstruction")]) if p.role]
    assert balls.role == "balls" and balls.kind == "points" and balls.visible


class Elements(HTMLParser):
    """Start tags with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


def test_everything_that_is_used_has_a_name():
    text = (resources.files("medialis.show.viewer") / "page.html").read_text("utf-8")
    for tag, about in Elements(text).found:
        if tag in ("button", "select", "canvas", "nav", "aside") and "aria-hidden" not in about:
            assert about.get("aria-label"), (tag, about)
        if tag == "input" and about["type"] == "range":
            assert about.get("aria-label"), about
        if tag == "img":
            assert "alt" in about
    ids = [about["id"] for _, about in Elements(text).found if "id" in about]
    assert len(ids) == len(set(ids))
    script = (resources.files("medialis.show.viewer") / "panel.js").read_text("utf-8")
    assert script.count('"range"') == 1 and "ariaLabel: `${title} of ${part.title}`" in script
    assert script.count('setAttribute("aria-valuetext"') == 3  # layers, colours, the cut


def contrast(one: str, other: str) -> float:
    """Contrast of two colours as WCAG 2 has it."""
    lights = []
    for color in (one, other):
        digits = color[1:7] if len(color) > 4 else "".join(2 * c for c in color[1:4])
        rgb = np.array([int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)])
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        lights.append(linear @ [0.2126, 0.7152, 0.0722])
    return (max(lights) + 0.05) / (min(lights) + 0.05)


def test_text_is_seen_in_light_and_dark():
    text = (resources.files("medialis.show.viewer") / "viewer.css").read_text("utf-8")
    schemes = [dict(re.findall(r"--([\w]+): (#\w+)", block)) for block in text.split("}")[:2]]
    for colors in schemes:
        for ink in ("ink", "soft"):
            for ground in ("back", "side", "card"):
                assert contrast(colors[ink], colors[ground]) >= 4.5, (ink, ground)
        assert contrast(colors["accent"], colors["back"]) >= 3
