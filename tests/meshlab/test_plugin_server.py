"""The plugin in the real MeshLab 2020.09: every operation, by meshlabserver."""

from pathlib import Path

import numpy as np
import pytest
from real_meshlab import MeshLab, make_meshlab, x_server

import medialis
from medialis.io.meshes import read_mesh
from medialis.io.ply_attributes import read_ply_attributes, write_ply
from medialis.operations.handover import layer_colors
from medialis.operations.registry import OPERATIONS, operation

FLOAT = 2e-7  # MeshLab 2020.09 holds single precision


@pytest.fixture(scope="module")
def meshlab(tmp_path_factory) -> MeshLab:
    with x_server() as display:
        yield make_meshlab(tmp_path_factory.mktemp("meshlab") / "with space ä", display)


@pytest.fixture(scope="module")
def creature(tmp_path_factory) -> Path:
    shape = medialis.organic_shape(56)
    path = tmp_path_factory.mktemp("shapes") / "Käfer mit Leerzeichen.ply"
    # As MeshLab will hold it, so that both sides compute on the same bits.
    write_ply(path, shape.points.astype(np.float32).astype(np.float64), faces=shape.faces)
    return path


def nothing_left(meshlab: MeshLab) -> bool:
    return not any((meshlab.folder / "temporary").iterdir())


@pytest.mark.parametrize("entry", OPERATIONS, ids=lambda entry: entry.name)
def test_every_operation_adds_its_layers(meshlab, creature, tmp_path, entry):
    """The layer that the filter leaves as the current one is saved with scalars and colours."""
    out = tmp_path / "out.ply"
    printed = meshlab.run([creature], entry, more=["-o", str(out), "-m", "vq", "vc"])
    assert "Problem with filter" not in printed, printed
    result = medialis.run(entry.name, medialis.read_shape(creature))
    layer = next((x for x in result.layers if not x.auxiliary), None)
    found = read_ply_attributes(out)
    if layer is None:  # a picture or numbers only: the shape stays the current layer
        assert len(found.points) == len(read_mesh(creature).points)
    else:
        np.testing.assert_allclose(found.points, layer.points, rtol=0, atol=FLOAT)
        faces = 0 if layer.faces is None else len(layer.faces)
        assert (0 if found.faces is None else len(found.faces)) == faces
        if layer.color_by in layer.attributes:
            expected = np.asarray(layer.attributes[layer.color_by], np.float32)
            np.testing.assert_array_equal(found.attributes["quality"], expected)
            colors = [found.attributes[name] for name in ("red", "green", "blue", "alpha")]
            np.testing.assert_array_equal(np.stack(colors, axis=1), layer_colors(layer))
    for name, value in result.values.items():
        if isinstance(value, int | float) and np.isfinite(value):
            assert f"{name}: " in printed
    assert nothing_left(meshlab)


def test_smoke(meshlab, creature, tmp_path):
    print(meshlab.run([creature], operation("thickness"), {"kind": "radius"}))
