"""The walk-through of CONTRIBUTING.md: one file more in a copy of the package is an operation."""

import json
import os
import re
import shutil
import subprocess
import sys

import pytest
from code_blocks import blocks, run_bash
from website.pages import ROOT

import medialis
from medialis.io.ply_attributes import read_ply_attributes, write_ply

NAME = "widest_places"


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """A copy of the core with the module of the page, and the registry changed as it says."""
    folder = tmp_path_factory.mktemp("extended")
    package = folder / "medialis"
    skip = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "core" / "medialis", package, ignore=skip)
    module, test = (
        code for language, code in blocks(ROOT / "CONTRIBUTING.md") if language == "python"
    )
    (package / "operations" / f"{NAME}.py").write_text(module)
    (folder / "test_widest_places.py").write_text(test)
    registry = package / "operations" / "registry.py"
    text, first = re.subn(
        r"(from medialis\.operations import \()", rf"\1\n    {NAME},", registry.read_text()
    )
    text, second = re.subn(
        r"(OPERATIONS: tuple\[Operation, \.\.\.\] = \()", rf"\1\n    {NAME}.OPERATION,", text
    )
    assert (first, second) == (1, 1)
    registry.write_text(text)
    return folder


def test_the_command_line_has_it(extended):
    shape = medialis.organic_shape(56)
    write_ply(extended / "creature.ply", shape.points, shape.faces)
    (commands,) = (
        code for language, code in blocks(ROOT / "CONTRIBUTING.md") if language == "bash"
    )
    output = run_bash(commands, extended, {"PYTHONPATH": str(extended)})
    assert "widest-places" in output
    values = json.loads((extended / "out" / "manifest.json").read_text())["values"]
    layer = read_ply_attributes(extended / "out" / f"{NAME}.ply")
    radius = layer.attributes["radius"]
    assert values["places"] == len(layer.points) == 3
    assert list(radius) == sorted(radius, reverse=True) and values["radius_max"] == radius[0]


def test_its_test_passes(extended):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_widest_places.py"],
        cwd=extended, env={**os.environ, "PYTHONPATH": str(extended)},
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0 and "1 passed" in done.stdout, done.stdout


def test_the_package_itself_is_unchanged():
    assert NAME not in [chosen.name for chosen in medialis.OPERATIONS]
