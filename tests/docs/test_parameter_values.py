"""What is drawn of a parameter follows from its declaration, also of one that is added later."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from website import strips
from website.generated_pages import gallery, parameter_page, reference
from website.parameter_values import BASE, EXAMPLES, SHAPES, example_of, values_of

import medialis
from medialis.base.options import Options, file, length
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.registry import OPERATIONS
from medialis.operations.result import Layer, Outcome

ALL = [(o, p) for o in OPERATIONS for p in o.parameters]


@pytest.mark.slow
@pytest.mark.parametrize(("chosen", "parameter"), ALL, ids=lambda x: x.name)
def test_values_are_allowed_and_rise(chosen, parameter):
    for values in (values_of(parameter), example_of(chosen, parameter).values):
        assert [parameter.check(value) for value in values] == list(values)
        assert len(values) <= 4 and len(set(values)) == len(values)
        if parameter.kind is Kind.FILE:
            assert values == ()
        elif parameter.kind not in (Kind.CHOICE, Kind.BOOL):
            assert len(values) >= 2 and (
                chosen.name == "geodesic_path" or list(values) == sorted(values)
            )
    if parameter.kind is not Kind.FILE:
        start = parameter.default if parameter.auto is None else parameter.auto
        assert start in values_of(parameter)


def test_examples_name_what_there_is():
    known = {name for o, p in ALL for name in (p.name, f"{o.name}.{p.name}")}
    assert set(EXAMPLES) <= known
    assert {*BASE, *SHAPES} <= {o.name for o in OPERATIONS}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"kind": Kind.LENGTH, "default": 0.02}, (0.005, 0.02, 0.08)),
        ({"kind": Kind.LENGTH, "default": 0.5}, (0.125, 0.5, 1.0)),
        ({"kind": Kind.LENGTH, "default": 0.0}, (0.0, 0.005, 0.02, 0.05)),
        ({"kind": Kind.INT, "default": 8, "low": 3, "high": 12}, (3, 4, 8, 12)),
        ({"kind": Kind.ANGLE, "default": 60.0, "high": 180.0}, (0.0, 30.0, 60.0, 120.0)),
        ({"kind": Kind.BOOL, "default": True}, (False, True)),
        ({"kind": Kind.CHOICE, "default": "d", "choices": tuple("abcde")}, tuple("abcd")),
        ({"kind": Kind.FILE, "default": ""}, ()),
    ],
)
def test_values_by_kind(given, expected):
    parameter = Parameter(name="x", label="X", help="X.", **given)
    assert values_of(parameter) == pytest.approx(expected) if expected else not values_of(parameter)


@dataclass(frozen=True, kw_only=True)
class LaterRun(Options):
    height: float = length(0.2, "Height (of all)", "How far up.", high=1.0)
    path: str = file("File", "A file.")


def _operation(run) -> Operation:
    return Operation(
        "later", "generate_later", "Later", "New group", "Do it.\n\nAt length.",
        LaterRun, run, "thesis 9",
    )  # fmt: skip


def test_an_operation_of_tomorrow_has_its_page(tmp_path):
    """It is not in the registry, has no example, and refuses one of the values."""

    def run(shape, options, progress):
        if options.height > 0.5:
            raise medialis.InvalidOptionError("height is too far | for *this* shape.")
        low = shape.points[:, 2] <= options.height * shape.diagonal
        layer = Layer("later", shape.points[low], attributes={"height": shape.points[low, 2]})
        return Outcome(shape, (layer,), values={"samples": 7, "points": int(low.sum())})

    chosen = _operation(run)
    text = _page(chosen, tmp_path)
    assert "`medialis later FILE`" in text and "`bpy.ops.medialis.later()`" in text
    assert "[Height (of all)](#height-of-all)" in text
    counts = [json.loads(p.read_text())["values"].get("points") for p in tmp_path.glob("*.json")]
    counts = sorted(filter(None, counts))
    assert len(counts) == 2 and counts[0] < counts[1]
    for count in counts:
        assert f"points: {count}" in text
    assert "height is too far" in text and "samples:" not in text


def test_what_changes_nothing_is_said(tmp_path):
    def run(shape, options, progress):
        return Outcome(shape, (Layer("later", shape.points[:100]),), values={"points": 100})

    text = _page(_operation(run), tmp_path)
    assert "it changes nothing." in text and "container} strip" not in text


def test_pictures_that_look_alike_become_a_table(tmp_path):
    """A reader who sees four equal pictures learns less than from four numbers."""

    def run(shape, options, progress):
        layer = Layer("later", shape.points[:100])
        return Outcome(shape, (layer,), values={"twice": 2 * options.height})

    text = _page(_operation(run), tmp_path)
    assert "look the same" in text and "container} strip" not in text
    assert "| 0.2| 0.4|" in text and "| 0.8| 1.6|" in text


def test_strips_share_their_runs():
    """The run at the defaults is in most strips, and is made once."""
    thickness = next(o for o in OPERATIONS if o.name == "thickness")
    found = {
        p.name: {tile.file for tile in strips.tiles(thickness, p)} for p in thickness.parameters
    }
    assert found["kind"] & found["spots"] & found["min_spoke_angle"]
    assert not found["refine"] & found["kind"]


def test_another_layer_and_attribute_are_drawn_on_request():
    shape = medialis.organic_shape(56)
    part = Layer("part", shape.points[:50])
    whole = Layer("whole", shape.points, attributes={"height": shape.points[:, 2]})
    result = medialis.Result(shape, (part, whole))
    first, other = (strips.picture_of(result, layer=name) for name in ("part", "whole"))
    coloured = strips.picture_of(result, layer="whole", color_by="height")
    assert (first != other).any() and (other != coloured).any()
    assert (strips.picture_of(result, layer="missing") != other).any()


def _page(chosen, folder) -> str:
    """The page of an operation that is run without being registered."""

    def run(name, shape, **given):
        outcome = chosen.run(shape, chosen.resolve(given), medialis.Progress())
        return medialis.Result(shape, outcome.layers, outcome.values)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strips.medialis, "run", run)
        return parameter_page(chosen, [], folder)


def test_pictures_that_are_results_are_made_small():
    image = np.zeros((300, 2000, 3), np.uint8)
    image[:, :1000] = 200
    shape = medialis.organic_shape(56)
    small = strips.picture_of(medialis.Result(shape, images={"wide": image}))
    assert small.shape[1] <= 2.5 * strips.SIZE[0] and (small[0, 0] == 200).all()
    assert (small[-1, -1] == 0).all()


@pytest.mark.slow
def test_the_gallery_has_every_operation_once(tmp_path, monkeypatch):
    """Pages in three dimensions that are there stay; that of one operation is made here."""
    monkeypatch.setattr("website.generated_pages.default_picture", lambda o, f: f"{o.name}.png")
    (tmp_path / "viewers").mkdir()
    for chosen in OPERATIONS:
        if chosen.name != "thickness":
            (tmp_path / "viewers" / f"{chosen.name}.html").write_text("there")
    text = gallery(["thickness"], tmp_path)
    if strips.has_library():
        assert "</html>" in (tmp_path / "viewers" / "thickness.html").read_text()
        assert text.count("Turn it.") == len(OPERATIONS)
    for chosen in OPERATIONS:
        assert text.count(f"/{chosen.name}.png") == 1
    assert "[Thickness](thickness.md)" in text
    assert "(parameters/geodesic_path.md)" in text


def test_the_reference_has_every_public_name_once():
    text = "\n".join(reference().values())
    for name in medialis.__all__:
        if callable(getattr(medialis, name)):
            assert text.count(f":: {name}\n") + text.count(f":: {name}\n   :members:") >= 1, name
