"""Results come back from their folders as they were written."""

import numpy as np
import pytest

import medialis


@pytest.mark.slow
@pytest.mark.parametrize("name", ["surface_skeleton", "thickness", "curve_skeleton", "parts"])
def test_results_come_back(name, tmp_path):
    result = medialis.run(name, medialis.organic_shape(56))
    medialis.write_result(result, tmp_path, pictures=medialis.Pictures(main=False))
    again = medialis.read_result(tmp_path)
    assert (again.operation, again.parameters) == (result.operation, result.parameters)
    assert again.values == result.values and again.messages == result.messages
    assert [m.code for m in again.messages] == [m.code for m in result.messages]
    assert [layer.name for layer in again.shown] == [layer.name for layer in result.shown]
    assert np.array_equal(again.shape.points, result.shape.points)
    for ours, theirs in zip(again.layers, result.layers, strict=True):
        for one in ("name", "color_by", "color_limits", "labels", "filter_unit", "filter_default"):
            assert getattr(ours, one) == getattr(theirs, one), one
        assert np.array_equal(ours.points, theirs.points)
        for key, values in theirs.attributes.items():
            assert np.array_equal(ours.attributes[key], values, equal_nan=values.dtype.kind == "f")
    assert again.extras.keys() == result.extras.keys() & {"graph"}
    if "graph" in result.extras:
        assert np.array_equal(again.extras["graph"].edges, result.extras["graph"].edges)


def test_a_folder_without_a_result_is_named(tmp_path):
    with pytest.raises(medialis.FileError, match="holds no result"):
        medialis.read_result(tmp_path)


def test_a_damaged_manifest_is_a_sentence(tmp_path):
    (tmp_path / "manifest.json").write_text('{"layers": [{}]}')
    with pytest.raises(medialis.InvalidShapeError, match=r"manifest\.json"):
        medialis.read_result(tmp_path)
