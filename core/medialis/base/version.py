"""The version of this package, and its public names, which are loaded when they are first used."""

import ast
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def package_version() -> str:
    """Return the installed version; "unknown" when the sources are used without installing."""
    for folder in map(Path, sys.path):
        # As importlib.metadata does it, which takes 40 ms to be loaded and to read one line.
        for found in folder.glob("medialis-*.dist-info/METADATA"):
            for line in found.read_text("utf-8").splitlines():
                if line.startswith("Version: "):
                    return line.removeprefix("Version: ")
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("medialis")
    except PackageNotFoundError:
        return "unknown"


def public_names(
    package: str, file: str, **more: Callable[[], Any]
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__all__`, `__getattr__` and `__dir__` of a package.

    Commands and scripts load only what they need: its `__init__.pyi` tells the module of each
    public name, as to editors and mypy, and a name is loaded when it is first used.

    Parameters
    ----------
    package, file : str
        Its `__name__` and `__file__`.
    more : callable
        Gives the value of a name that is not in `__all__`.
    """
    stub = ast.parse((Path(file).parent / "__init__.pyi").read_text("utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: str(node.module) for node in imports for alias in node.names}

    def load(name: str) -> Any:
        if name not in homes and name not in more:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        given = more.get(name)
        value = given() if given else getattr(importlib.import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return sorted(homes), load, lambda: sorted([*homes, *more])
