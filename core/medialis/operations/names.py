"""What the operations are called, read from their declarations as text: help needs no more."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import pkgutil
import re
from functools import cache
from typing import NamedTuple

import medialis.operations

RENAMED = {"denoise": "remove_outliers"}
"""Names of older versions that still work, and what they are now."""


def renamed_note(name: str) -> str:
    """Return the sentence that tells the new name of an operation."""
    return f"The operation {name} is called {RENAMED[name]} now; smooth moves points instead."


_DECLARATION = re.compile(r"^OPERATION\b", re.MULTILINE)


class Named(NamedTuple):
    """Module, name and first line of help of an operation, and where hosts list it."""

    module: str
    name: str
    first_line: str
    order: float

    @property
    def command(self) -> str:
        """The name as the command line writes it."""
        return self.name.replace("_", "-")


@cache
def named_operations() -> tuple[Named, ...]:
    """Return all operations in the order in which hosts list them, without loading them."""
    modules = (module.name for module in pkgutil.iter_modules(medialis.operations.__path__))
    found = (_named(f"medialis.operations.{module}") for module in modules)
    return tuple(sorted(filter(None, found), key=lambda named: (named.order, named.name)))


def _named(module: str) -> Named | None:
    """Read the declaration of a module; load it where its names are not written out."""
    spec = importlib.util.find_spec(module)
    source = spec.loader.get_source(module) if spec and spec.loader else None  # type: ignore[attr-defined]
    declaration = None if source is None else _DECLARATION.search(source)
    if source is not None and declaration is None:
        return None
    try:
        call = ast.parse(source[declaration.start() :]).body[0].value  # type: ignore
        about = {word.arg: word.value for word in call.keywords}
        name, help = ast.literal_eval(about["name"]), ast.literal_eval(about["help"])
        order = ast.literal_eval(about["order"])
    except (TypeError, ValueError, KeyError, AttributeError, SyntaxError):
        declared = getattr(importlib.import_module(module), "OPERATION", None)
        if declared is None:
            return None
        name, help, order = declared.name, declared.help, declared.order
    return Named(module, name, help.splitlines()[0], order)
