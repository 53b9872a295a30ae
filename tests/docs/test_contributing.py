"""The walk-through of CONTRIBUTING.md: one folder more in a checkout, and every host has it.

Blender has it too: tests/blender/test_contributing.py.
"""

import json
from importlib.util import find_spec

import pytest
from code_blocks import blocks, run_bash
from extended_checkout import NAME, PAGE, extended_checkout, python_path, run_in

import medialis
from medialis.formats.ply_attributes import read_ply_attributes, write_ply


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A checkout with the operation, and a mesh in it."""
    folder = extended_checkout(tmp_path_factory.mktemp("checkout"))
    shape = medialis.organic_shape(56)
    write_ply(folder / "creature.ply", shape.points, shape.faces)
    return folder


@pytest.mark.slow
def test_the_command_line_has_it(checkout):
    (commands,) = (code for language, code in blocks(PAGE) if language == "bash")
    output = run_bash(commands, checkout, python_path(checkout))
    assert "widest-places" in output
    values = json.loads((checkout / "out" / "manifest.json").read_text())["values"]
    layer = read_ply_attributes(checkout / "out" / f"{NAME}.ply")
    radius = layer.attributes["radius"]
    assert values["places"] == len(layer.points) == 3
    table = (checkout / "out" / f"{NAME}.csv").read_text().splitlines()
    assert [float(x) for x in table[1].split(",")] == [*values["widest"], radius[0]]
    assert list(radius) == sorted(radius, reverse=True) and values["radius_max"] == radius[0]


@pytest.mark.slow
def test_its_test_passes(checkout):
    printed = run_in(checkout, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"test_{NAME}.py")
    assert "2 passed" in printed


@pytest.mark.slow
def test_the_report_has_it(checkout):
    run_in(checkout, "-m", "medialis", "widest-places", "creature.ply", "-o", "r", "--report")
    report = json.loads((checkout / "r" / "report.json").read_text())
    assert report["operation"] == NAME and (checkout / "r" / "report.html").is_file()


@pytest.mark.slow
def test_batches_have_it(checkout):
    chosen = ["--set", f"{NAME}.places=2", "--workers", "1", "--no-picture"]
    run_in(checkout, "-m", "medialis", "batch", NAME, "creature.ply", "-o", "b", *chosen)
    manifest = json.loads((checkout / "b" / "creature" / NAME / "manifest.json").read_text())
    assert manifest["values"]["places"] == 2


@pytest.mark.slow
def test_the_table_of_the_meshlab_plugin_has_it(checkout):
    run_in(checkout, "-c", "from medialis.hosts import write_notes; write_notes('.')")
    table = json.loads((checkout / "medialis-filters.json").read_text())["filters"]
    entry = next(entry for entry in table if entry["name"] == "generate_widest_places")
    assert entry["title"] == "Generate Medial Widest Places"
    assert ("places", "int", 5) in [
        (p["name"], p["kind"], p["default"]) for p in entry["parameters"]
    ]


@pytest.mark.slow
@pytest.mark.skipif(find_spec("pymeshlab") is None, reason="needs the extra meshlab")
def test_pymeshlab_has_it(checkout):
    code = (
        "import medialis_meshlab, pymeshlab\n"
        "meshes = pymeshlab.MeshSet()\n"
        "meshes.load_new_mesh('creature.ply')\n"
        "meshes.generate_widest_places(places=3)\n"
        "print(meshes.current_mesh().vertex_number())"
    )
    assert run_in(checkout, "-c", code).split()[-1] == "3"


def test_the_package_itself_is_unchanged():
    assert NAME not in [chosen.name for chosen in medialis.OPERATIONS]
