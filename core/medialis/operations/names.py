"""What the operations are called, read from their declarations as text: help needs no more."""

from __future__ import annotations

import ast
import importlib
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

RENAMED = {"denoise": "remove_outliers"}
"""Names of older versions that still work, and what they are now."""


def renamed_note(name: str) -> str:
    """Return the sentence that tells the new name of an operation."""
    return f"The operation {name} is called {RENAMED[name]} now; smooth moves points instead."


_DECLARATION = re.compile(
    r"^(\w+) = (Operation\(\n.*?^\))|^(OPERATION) = ", re.MULTILINE | re.DOTALL
)
"""A constant and its call; an `OPERATION` that is made in another way is loaded to be known."""

LAST = 1000.0
"""Where hosts list an operation that says nothing of it."""

PACKAGE = Path(__file__).resolve().parents[1]
DECLARED_IN = "*operation.py"
"""Files of features that declare operations."""


class Named(NamedTuple):
    """Module, constant, name and first line of help of an operation, and where hosts list it."""

    module: str
    constant: str
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
    found = [named for path in PACKAGE.rglob(DECLARED_IN) for named in _declared(path)]
    return tuple(sorted(found, key=lambda named: (named.order, named.name)))


def _declared(path: Path) -> list[Named]:
    """Read the declarations of a file; load it where its names are not written out."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    module = ".".join(("medialis", *parts))
    found = []
    for constant, call, made in _DECLARATION.findall(path.read_text(encoding="utf-8")):
        words = ast.parse(call, mode="eval").body.keywords if call else ()
        about = {word.arg: word.value for word in words}
        try:
            name, help = (ast.literal_eval(about[word]) for word in ("name", "help"))
            order = ast.literal_eval(about["order"]) if "order" in about else LAST
        except (ValueError, KeyError):
            declared = getattr(importlib.import_module(module), constant or made)
            name, help, order = declared.name, declared.help, declared.order
        found.append(Named(module, constant or made, name, help.splitlines()[0], order))
    return found
