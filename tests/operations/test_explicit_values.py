"""Values that users type are used as written, also those that equal a default.

Values that equalled their default were rescaled: `refine=0.02` gave 2.86 %, 0.02001 gave 2 %.
"""

from __future__ import annotations

import numpy as np
import pytest

import medialis
from medialis import OPERATIONS
from medialis.base.options import AUTO, NUMBERS, Kind, Options
from medialis.base.progress import Progress

AUTOMATIC = [o.name for o in OPERATIONS if any(p.auto is not None for p in o.parameters)]
AUTOMATIC.remove("medial_mesh")  # below, where it takes a tenth of the time
CHANGE = 1e-9
"""Relative change of a value that must change a result by as little."""


def numbers_of(operation):
    """Return the numbers of an operation: what automatic ones start from, else the default."""
    numbers = [p for p in operation.parameters if p.kind in NUMBERS]
    return {p.name: p.default if p.auto is None else p.auto for p in numbers}


def same_layers(one, other):
    """Tell whether two results have the same layers, bit by bit."""
    assert [layer.name for layer in one.layers] == [layer.name for layer in other.layers]
    return all(
        np.array_equal(a.points, b.points, equal_nan=True)
        and all(np.array_equal(v, b.attributes[n], equal_nan=True) for n, v in a.attributes.items())
        for a, b in zip(one.layers, other.layers, strict=True)
    )


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda one: one.name)
def test_automatic_options_say_so_and_take_numbers(operation):
    for parameter in operation.parameters:
        if parameter.auto is None:
            assert parameter.default != AUTO or parameter.kind is Kind.CHOICE
            continue
        assert parameter.default == AUTO and parameter.kind in NUMBERS
        assert parameter.low <= parameter.auto <= parameter.high
        assert AUTO in parameter.help
        assert parameter.check(" Auto ") == AUTO
        assert parameter.check(parameter.auto) == parameter.auto
    other = [p for p in operation.parameters if p.auto is None and p.kind in NUMBERS]
    for parameter in other:
        with pytest.raises(medialis.InvalidOptionError):
            parameter.check(AUTO)


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda one: one.name)
def test_typed_numbers_are_never_changed(operation, small_shape, monkeypatch):
    """Nothing is chosen for options that were typed, whatever they equal."""
    monkeypatch.delattr(Options, "with_auto_values")
    numbers = numbers_of(operation)
    options = operation.resolve(numbers)
    shape = small_shape(operation.name)
    settled = options.measured(shape, Progress()).with_auto_resolved(shape, Progress())
    assert {name: settled.values()[name] for name in numbers} == numbers


@pytest.mark.slow
@pytest.mark.parametrize("name", AUTOMATIC)
def test_results_report_what_was_chosen_and_use_what_was_typed(name, small_shape, monkeypatch):
    shape, operation = small_shape(name), medialis.operation(name)
    automatic = {p.name for p in operation.parameters if p.auto is not None}
    numbers = numbers_of(operation)
    with medialis.memory_limit(1 << 28):
        chosen = medialis.run(name, shape)
        assert set(chosen.automatic) == automatic
        values = [m.data["values"] for m in chosen.messages if m.code == "automatic"]
        told = {key: value for one in reversed(values) for key, value in one.items()}
        assert {key: chosen.parameters[key] for key in automatic}.items() <= told.items()
        again = medialis.run(name, shape, **{n: chosen.parameters[n] for n in numbers})
        assert again.automatic == () and dict(again.parameters) == dict(chosen.parameters)
        assert same_layers(chosen, again)
        with monkeypatch.context() as patch:
            patch.setattr(Options, "with_auto_values", None)  # called for nothing
            if name == "centerline":  # the curve skeleton that finds its ends has other options
                patch.undo()
            typed = medialis.run(name, shape, **numbers)
    assert typed.automatic == ()
    assert {n: typed.parameters[n] for n in numbers} == numbers
    refined = [m.data["longest_edge"] for m in typed.messages if m.code == "refined"]
    assert refined == [numbers["refine"]] * len(refined)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["curve_skeleton", "parts", "thickness"])
def test_a_value_that_equals_a_default_has_no_other_meaning(name, small_shape):
    """Beside one that differs in the ninth digit; these rescaled what equalled the default."""
    ranges = {p.name: p.kind for p in medialis.operation(name).parameters}
    exact = numbers_of(medialis.operation(name))
    beside = {
        n: v if ranges[n] is Kind.INT else v * (1.0 - CHANGE) for n, v in exact.items()
    }  # all of these may be smaller
    one, other = (medialis.run(name, small_shape(name), **given) for given in (exact, beside))
    assert one.shape.point_count == other.shape.point_count
    moved = np.linalg.norm(one.shape.points - other.shape.points, axis=1)
    assert moved.max() < 1e-6 * one.shape.diagonal
    radii = [np.nan_to_num(result.arrays["radii"]) for result in (one, other)]
    assert np.isclose(*radii, rtol=1e-5).mean() > 0.999


@pytest.mark.parametrize("refine", [0.02, 0.0200001, 0.05])
def test_no_edge_is_longer_than_was_asked(refine):
    """A mesh with many faces had its samples bounded, whatever was typed."""
    rng = np.random.default_rng(3)
    corners = rng.random((400, 3, 3))
    soup = medialis.make_shape(corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3))
    cloud = medialis.surface_skeleton(soup, refine=0.05)
    assert cloud.surface.edge_lengths.max() <= 0.05 * soup.diagonal * (1 + 1e-12)
    box = medialis.make_shape(*_box((1.0, 0.2, 0.2)))
    fine = medialis.surface_skeleton(box, refine=refine).surface
    assert fine.edge_lengths.max() <= refine * box.diagonal * (1 + 1e-12)


def test_a_dense_mesh_is_refined_where_a_value_is_typed(small_shape):
    """Few edges that are a little too long stay as they are only where nothing was typed."""
    shape = small_shape("surface_skeleton")
    longest = shape.edge_lengths.max() / shape.diagonal
    typed = medialis.surface_skeleton(shape, refine=0.999 * longest)
    assert typed.surface.point_count > shape.point_count


def test_the_tolerance_that_was_typed_is_not_raised_by_noise():
    made = medialis.organic_shape(56)
    rng = np.random.default_rng(0)
    noisy = made.points + 0.1 * made.spacing * rng.standard_normal(made.points.shape)
    shape = medialis.make_shape(noisy, made.faces)
    typed = medialis.run("surface_skeleton", shape, tolerance=0.0003, importance=False)
    chosen = medialis.run("surface_skeleton", shape, importance=False)
    assert any(m.code == "denoised" for m in chosen.messages)
    assert typed.parameters["tolerance"] == 0.0003
    assert chosen.parameters["tolerance"] > 0.0003 and "tolerance" in chosen.automatic


def test_the_ratio_of_ribs_that_was_typed_goes_before_that_of_the_process(small_shape):
    shape = small_shape("wall_check")
    shape = medialis.make_shape(shape.points, shape.faces, unit="mm")
    by_process = medialis.run("wall_check", shape, process="moulding")
    typed = medialis.run("wall_check", shape, process="moulding", rib_ratio=0.6)
    assert "rib_ratio" in by_process.automatic and typed.parameters["rib_ratio"] == 0.6
    assert "rib_ratio" not in typed.automatic


@pytest.mark.slow
@pytest.mark.parametrize(("balls", "chosen"), [(20, 5000), (1300, 16_000)])
def test_samples_of_medial_meshes_are_those_that_were_typed(balls, chosen, small_shape):
    """They were raised to four a ball, and to 16,000 for many balls, whatever was typed."""
    options = {"balls": balls, "quality": "fast"}
    for samples, automatic in ((AUTO, ("samples",)), (1000, ()), (5000, ())):
        if samples == 5000 and balls > 600:
            continue
        result = medialis.run("medial_mesh", small_shape("medial_mesh"), samples=samples, **options)
        assert result.automatic == automatic
        assert result.parameters["samples"] == (chosen if automatic else samples)


def test_what_is_of_no_use_stays_automatic():
    points = medialis.organic_shape(56)
    cloud = medialis.make_shape(points.points, normals=points.normals)
    result = medialis.run("surface_skeleton", cloud, importance=False)
    assert result.parameters["refine"] == AUTO and "refine" not in result.automatic
    assert result.parameters["tolerance"] == 0.0003


def _box(size):
    x = np.array([[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)]) * size
    q = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return x, [t for a, b, c, d in q for t in ((a, b, c), (a, c, d))]
