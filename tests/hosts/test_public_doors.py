"""Adapters go through two doors, `medialis` and `medialis.hosts`: nothing private is imported."""

import ast
from pathlib import Path

import pytest

import medialis
import medialis.hosts

ROOT = Path(__file__).resolve().parents[2]
DOORS = {"medialis": medialis, "medialis.hosts": medialis.hosts}
ADAPTERS = sorted(
    path for folder in ("blender_addon", "meshlab_plugin") for path in (ROOT / folder).rglob("*.py")
)


def imports(path: Path) -> list[tuple[str, str]]:
    """Modules and names that a file imports of medialis; "" for a module as a whole."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            found += [(node.module, alias.name) for alias in node.names]
        elif isinstance(node, ast.Import):
            found += [(alias.name, "") for alias in node.names]
    return [(module, name) for module, name in found if module.partition(".")[0] == "medialis"]


@pytest.mark.parametrize("path", ADAPTERS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_adapters_import_public_names_only(path):
    for module, name in imports(path):
        assert module in DOORS, f"{path} imports {module}"
        assert not name or name in DOORS[module].__all__, f"{name} is no public name of {module}"


def test_the_adapters_are_found_and_use_the_doors():
    assert {module for path in ADAPTERS for module, _ in imports(path)} == set(DOORS)


def test_every_name_of_the_module_is_documented():
    """Each name is in the overview of the module, and functions and classes have docstrings."""
    for name in medialis.hosts.__all__:
        found = getattr(medialis.hosts, name)
        assert isinstance(found, tuple) or found.__doc__, name
        assert f"`{name}`" in medialis.hosts.__doc__, name
