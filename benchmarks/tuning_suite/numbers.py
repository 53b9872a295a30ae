"""The numbers that tune algorithms: where they stand, who reads them, and what is said of them."""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from medialis.base import cache_folder

PACKAGE = cache_folder.PACKAGE
WAYS = ("halved", "doubled")
LONGEST_LINE = 100
Record = Mapping[str, Mapping[str, Any]]

LARGEST = 2**31 - 1
"""From here on numbers are largest indices, moduli, and what stands for none: they tune nothing."""

NAMES_OF_PLACES = re.compile(
    r"Columns? of|Rows of|What |How a length|Their places|Numbers of a prim"
)
"""Texts of numbers that name a place in an array, or a state: they tune nothing."""


class Number(NamedTuple):
    """A constant that tunes: module, name, value, and the first sentence of its text."""

    module: str
    name: str
    value: float
    text: str

    @property
    def key(self) -> str:
        """What the record has it by."""
        return f"{self.module.removeprefix('medialis.')}.{self.name}"

    @property
    def in_kernels(self) -> bool:
        """Whether it is compiled into kernels."""
        return is_kernels(self.module)


def is_kernels(module: str) -> bool:
    """Tell whether a module holds kernels."""
    return module.endswith("_kernels")


def module_of(path: Path) -> str:
    """Return the dotted name of a source file."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(("medialis", *(part for part in parts if part != "__init__")))


@cache
def trees() -> dict[str, ast.Module]:
    """Parse all modules of the core, by dotted name."""
    return {
        module_of(path): ast.parse(path.read_text(encoding="utf-8"))
        for path in sorted(PACKAGE.rglob("*.py"))
    }


def path_of(module: str) -> Path:
    """Return the source file of a module."""
    path = PACKAGE.joinpath(*module.split(".")[1:])
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def stated(tree: ast.Module) -> Iterator[tuple[ast.Assign, list[str], str]]:
    """Find the constants of a module that have a text: the statement, their names, the text."""
    body = tree.body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign) or not isinstance(after, ast.Expr):
            continue
        text = after.value.value if isinstance(after.value, ast.Constant) else None
        names = [one.id for one in ast.walk(node.targets[0]) if isinstance(one, ast.Name)]
        if isinstance(text, str) and all(name.isupper() for name in names):
            yield node, names, text


def tunes(statement: ast.Assign, text: str) -> bool:
    """Tell whether constants tune, rather than name places or states, or follow from others."""
    parts = list(ast.walk(statement.value))
    counted = any(isinstance(one, ast.Call) and ast.unparse(one.func) == "range" for one in parts)
    derived = any(isinstance(one, ast.Name) and one.id.isupper() for one in parts)
    return not counted and not derived and not NAMES_OF_PLACES.match(text)


def numbers_of_module(module: str) -> Iterator[Number]:
    """Find the numbers of a module, in the order of the source."""
    for statement, names, text in stated(trees()[module]):
        for name in names if tunes(statement, text) else ():
            value = getattr(importlib.import_module(module), name)
            if type(value) in (int, float) and 0 < abs(value) < LARGEST:
                yield Number(module, name, value, text.split(". ")[0].replace("\n", " "))


def numbers(folder: str) -> list[Number]:
    """Find the numbers of a folder of the core."""
    paths = sorted((PACKAGE / folder).glob("*.py"))
    return [number for path in paths for number in numbers_of_module(module_of(path))]


def other_values(number: Number) -> dict[str, float]:
    """Return half and double, where they are others; whole numbers stay whole."""
    whole = isinstance(number.value, int)
    half = max(1, number.value // 2) if whole else number.value / 2
    return {
        way: value
        for way, value in zip(WAYS, (half, number.value * 2), strict=True)
        if value != number.value
    }


@cache
def imported(module: str) -> frozenset[str]:
    """Return the modules that a module imports, in functions as well."""
    found = set()
    for node in ast.walk(trees()[module]):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return frozenset(found & trees().keys())


@cache
def reaching(module: str) -> frozenset[str]:
    """Return the modules that import one, or import one that does: what it can change."""
    found, new = set[str](), {module}
    while new:
        found |= new
        new = {name for name in trees() if imported(name) & new} - found
    return frozenset(found)


@cache
def _names_from(module: str) -> frozenset[tuple[str, str]]:
    """Return what a module imports by name: the modules and the names."""
    return frozenset(
        (node.module, alias.name)
        for node in ast.walk(trees()[module])
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    )


def gets(module: str, number: Number) -> bool:
    """Tell whether a module states a number or imports it by name."""
    return module == number.module or (number.module, number.name) in _names_from(module)


@cache
def _read_at_import(module: str) -> frozenset[str]:
    """Return the names that a module reads outside of functions: for defaults, other constants."""
    names = set()
    waiting: list[ast.AST] = [trees()[module]]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            waiting += [one for one in (*node.args.defaults, *node.args.kw_defaults) if one]
            waiting += getattr(node, "decorator_list", [])
            continue
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            names.add(node.id)
        waiting += ast.iter_child_nodes(node)
    return frozenset(names)


def is_read_at_import(number: Number) -> bool:
    """Tell whether a number has to be another one before modules are imported."""
    return number.in_kernels or any(
        number.name in _read_at_import(module) for module in trees() if gets(module, number)
    )


def percent(change: float) -> str:
    """Say a change in few characters."""
    if change == 0:
        return "0 %"
    if change < 0.001:
        return "< 0.1 %"
    return f"{100 * change:.1f} %" if change < 0.01 else f"{100 * change:.0f} %"


COMMENT = re.compile(r" *# (?:-; )*(?:halved|doubled) [<\d][^#]*$")
"""What `comment` makes, at the end of a line."""


def comment(module: str, names: list[str], record: Record) -> str | None:
    """Say how far results move with each number of a statement; None where nothing is known."""
    cells = []
    for name in names:
        entry = record.get(f"{module.removeprefix('medialis.')}.{name}", {})
        ways = [f"{way} {percent(entry[way][1])}" for way in WAYS if way in entry]
        cells.append(", ".join(ways) if ways and entry["reached"] else "-")
    return None if set(cells) <= {"-"} else f"# {'; '.join(cells)}"


def with_comments(module: str, source: str, record: Record) -> str:
    """Return a source with what was measured beside each number, or above it in a line of its own.

    What stood there of the kind is replaced, so that a second time changes nothing.
    """
    lines = source.splitlines()
    for statement, names, text in reversed(list(stated(ast.parse(source)))):
        above, last = statement.lineno - 2, statement.end_lineno - 1
        told = comment(module, names, record) if tunes(statement, text) else None
        bare = COMMENT.sub("", lines[last])
        beside = f"{bare}  {told}"
        if told is None:
            lines[last] = bare
        elif len(beside) <= LONGEST_LINE and "#" not in bare:
            lines[last] = beside
        else:
            lines[last] = bare
            lines.insert(statement.lineno - 1, told)
        if above >= 0 and COMMENT.fullmatch(lines[above]):
            del lines[above]
    return "\n".join(lines) + "\n"
