"""What a slider shows is what can be typed into the operation."""

import numpy as np
import pytest

import medialis
from medialis.base.options import Kind
from medialis.operations.result import FilterUnit, Layer


@pytest.mark.parametrize(
    "unit",
    [
        FilterUnit(),
        FilterUnit.degrees(),
        FilterUnit.length(3.0, "threshold"),
        FilterUnit.length(3.0, "threshold", power=2.0),
    ],
    ids=["none", "angle", "length", "area"],
)
def test_a_unit_goes_both_ways(unit):
    assert unit.of_attribute(unit.attribute(0.25)) == pytest.approx(0.25, rel=1e-15)
    assert unit.of_attribute(-1.0) == 0.0


def test_units_are_those_of_the_options():
    assert FilterUnit.degrees().attribute(180.0) == np.pi
    assert FilterUnit.length(20.0).attribute(0.05) == 1.0
    assert FilterUnit.length(20.0, power=2.0).attribute(0.05) == pytest.approx(1.0, rel=1e-15)


@pytest.mark.slow
def test_a_slider_hides_what_the_option_removes():
    shape = medialis.organic_shape(100)
    layer = medialis.run("skeleton_importance", shape, threshold=0.05).layers[0]
    unit, values = layer.filter_unit, layer.attributes[layer.filter_by]
    assert unit.kind is Kind.LENGTH and unit.option == "threshold"
    every = medialis.run("skeleton_importance", shape).layers[0].attributes[layer.filter_by]
    assert (every >= unit.attribute(0.05)).sum() == len(values) < len(every)


@pytest.mark.slow
def test_an_importance_that_is_an_area_has_the_option_as_its_side():
    layer = medialis.run("curve_skeleton", medialis.organic_shape(100)).layers[0]
    values = layer.attributes[layer.filter_by]
    assert layer.filter_unit.kind is Kind.LENGTH and layer.filter_unit.power == 2.0
    largest = values[np.isfinite(values)].max()
    assert 0.0 < layer.filter_unit.of_attribute(largest) < 1.0


def test_points_below_the_default_are_hidden_and_not_lost():
    values = np.array([0.5, 1.0, np.inf, np.nan])
    unit = FilterUnit.length(2.0)
    points = np.zeros((4, 3))
    layer = Layer("x", points, attributes={"v": values}, filter_by="v", filter_unit=unit)
    assert not layer.hidden.any()
    layer = Layer(
        "x", points, attributes={"v": values}, filter_by="v", filter_unit=unit, filter_default=0.5
    )
    assert layer.hidden.tolist() == [True, False, False, False]
