"""The plugin's table of filters, which a generator writes from the registry when it is built."""

import re
import subprocess
import sys

import pytest

from medialis.operations.registry import OPERATIONS
from real_meshlab import PLUGIN

ROW = r'^    \{"(?P<command>[a-z-]+)", "(?P<title>[^"]+)", "(?:[^"\\]|\\.)*", "(?P<verb>[a-z]+)",$'
PARAMETER = r'^        \{"(?P<name>[a-z_]+)", Kind::(?P<kind>[A-Z][a-z]+), (?P<number>[^,]+), "'


@pytest.fixture(scope="module")
def table(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("table") / "filter_table.h"
    subprocess.run([sys.executable, str(PLUGIN / "generate_table.py"), str(path)], check=True)
    return path.read_text(encoding="ascii")


def test_it_has_every_operation_under_its_names(table):
    """MeshLab makes the Python name of a filter from its title: lower case, underscores."""
    found = [match.groupdict() for match in re.finditer(ROW, table, re.M)]
    assert [row["command"] for row in found] == [e.name.replace("_", "-") for e in OPERATIONS]
    names = [row["title"].lower().replace(" ", "_") for row in found]
    assert names == [entry.filter_name for entry in OPERATIONS]
    assert [row["verb"] for row in found] == [name.split("_")[0] for name in names]


def test_it_has_every_parameter_with_its_default(table):
    found = [match.groupdict() for match in re.finditer(PARAMETER, table, re.M)]
    declared = [parameter for entry in OPERATIONS for parameter in entry.parameters]
    assert [row["name"] for row in found] == [parameter.name for parameter in declared]
    assert [row["kind"].lower() for row in found] == [p.kind.value for p in declared]
    for row, parameter in zip(found, declared, strict=True):
        default = parameter.default
        if parameter.choices:
            default = parameter.choices.index(default)
        expected = 0.0 if isinstance(default, str) else float(default)
        assert float(row["number"]) == expected
