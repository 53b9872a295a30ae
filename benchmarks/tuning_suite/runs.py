"""Operations with other numbers: what results tell, and what another number cannot change."""

from __future__ import annotations

import ast
import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from typing import Any

import numpy as np

import medialis
from medialis.base import cache_folder, kept
from tuning_suite import shapes
from tuning_suite.numbers import PACKAGE, Number, gets, is_kernels, module_of, path_of, reaching

Told = Mapping[str, Any]
Pair = tuple[str, str]
"""An operation, perhaps with options as `name=choice`, and a shape."""

LONGER, AT_LEAST = 10.0, 20.0
"""A run may take so many times as long as with the number that stands, and at least so many s."""

REFINE = 0.02
"""Longest edge as a fraction of the diagonal: by default there are 3 to 4 times as many samples."""

ROOM = 6 << 30
"""Bytes of kept results: those of all shapes."""


def told(result: medialis.Result) -> dict[str, Any]:
    """Return what a result tells, as numbers and lists of words by name."""
    found: dict[str, Any] = {}
    for name, many in _flat(result.values, ""):
        numbers = [abs(float(x)) for x in many if isinstance(x, int | float)]
        found[f"{name}: count"] = len(many)
        found[f"{name}: mean"] = sum(numbers) / len(numbers) if numbers else 0.0
        found[f"{name}: words"] = [x for x in many if isinstance(x, str)]
    for layer in result.layers:
        for part in ("points", "edges", "faces"):
            rows = getattr(layer, part)
            found[f"{layer.name}/{part}"] = 0 if rows is None else len(rows)
        for name, values in {**layer.attributes, **layer.face_attributes}.items():
            if values.dtype.kind in "fiu" and len(values):
                usable = values[np.isfinite(values)].astype(float)
                found[f"{layer.name}/{name}"] = float(abs(usable).mean()) if len(usable) else 0.0
        if len(layer.points):
            away = np.linalg.norm(layer.points - result.shape.bounds[0], axis=1)
            found[f"{layer.name}/away"] = float(away.mean())
    return found


def _flat(values: Any, place: str) -> Iterator[tuple[str, list[Any]]]:
    """Yield what stands in values and tables, the rows of a table together."""
    if isinstance(values, Mapping):
        for name, value in values.items():
            yield from _flat(value, f"{place}/{name}")
    elif isinstance(values, list) and values and isinstance(values[0], Mapping):
        for name in values[0]:
            yield from _flat([row.get(name) for row in values], f"{place}/{name}")
    else:
        many = values if isinstance(values, list) else [values]
        yield place, [x for one in many for x in (one if isinstance(one, list) else [one])]


TRUTHS = {"True": True, "False": False}
"""What flags are, by what is written of them."""


def perform(pair: Pair, seconds: float = 600.0) -> dict[str, Any]:
    """Run an operation on a shape, with one thread, and return what its result tells."""
    end = time.monotonic() + seconds

    def stop(*_: object) -> None:
        if time.monotonic() > end:
            raise TimeoutError

    operation, *words = pair[0].split()
    options: dict[str, Any] = dict(word.split("=") for word in words)
    options = {name: TRUTHS.get(value, value) for name, value in options.items()}
    if any(one.name == "refine" for one in medialis.operation(operation).options.parameters()):
        options["refine"] = REFINE
    try:
        shape = shapes.shape(pair[1])
        return told(medialis.run(operation, shape, progress=stop, threads=1, **options))
    except TimeoutError:
        return {"longer": 1}
    except medialis.MedialisError:
        return {"refused": 1}
    except (ArithmeticError, LookupError, ValueError, TypeError, MemoryError):
        return {"failed": 1}


def change(before: Told, after: Told) -> tuple[float, str]:
    """Return how far a result moved, and what of it moved most."""
    found = (0.0, "")
    for name in {*before, *after}:
        a, b = before.get(name, 0), after.get(name, 0)
        if isinstance(a, list) or isinstance(b, list):
            a, b = a or [], b or []
            same = sum(x == y for x, y in zip(a, b, strict=False))
            share = 1 - same / (max(len(a), len(b)) or 1) if a != b else 0.0
        else:
            share = abs(a - b) / max(abs(a), abs(b)) if a != b else 0.0
        if share:
            found = max(found, (share, name))
    return found


_callers: dict[Any, str] = {}
"""Which module asked for what is kept: its numbers may be in it as well."""


def _note_callers() -> None:
    store = kept._memory.store

    def noted(key: Any, *given: Any) -> None:
        _callers[key] = sys._getframe(2).f_globals["__name__"]
        store(key, *given)

    kept._memory.store = noted  # type: ignore[method-assign]


_note_callers()


class Base:
    """Results with the numbers that stand: what they come from is kept, and who read what."""

    def __init__(self) -> None:
        self.results: dict[Pair, dict[str, Any]] = {}
        self._seconds: dict[Pair, float] = {}
        self._readers: dict[Pair, dict[str, set[str]]] = {}

    def result(self, pair: Pair) -> dict[str, Any]:
        """Return what a result tells, computed once."""
        if pair not in self.results:
            codes: set[Any] = set()

            def look(frame: Any, event: str, _: object) -> None:
                if event == "call":
                    codes.add(frame.f_code)

            # Whoever runs in this time is seen, so nothing may be found.
            entries = dict(kept._memory._entries)
            kept.forget()
            threading.setprofile(look)
            sys.setprofile(look)
            clock = time.monotonic()
            try:
                self.results[pair] = perform(pair)
            finally:
                sys.setprofile(None)
                threading.setprofile(None)  # type: ignore[arg-type]
            self._seconds[pair] = time.monotonic() - clock
            for key, entry in entries.items():
                kept._memory._entries.setdefault(key, entry)
            readers: dict[str, set[str]] = {}
            for code in codes:
                path = Path(code.co_filename)
                if path.is_relative_to(PACKAGE):
                    for name in code.co_names:
                        if name.isupper():
                            readers.setdefault(name, set()).add(module_of(path))
            self._readers[pair] = readers
        return self.results[pair]

    def reads(self, pair: Pair, number: Number) -> bool:
        """Tell whether a function was called that reads a number; of kernels none is known."""
        self.result(pair)
        readers = self._readers[pair].get(number.name, set())
        return number.in_kernels or any(gets(module, number) for module in readers)

    def with_value(self, number: Number, value: float, pairs: list[Pair]) -> list[dict[str, Any]]:
        """Run with another value of a number that only functions read."""
        holders = [
            sys.modules[name]
            for name in reaching(number.module)
            if name in sys.modules
            and gets(name, number)
            and hasattr(sys.modules[name], number.name)
        ]
        memory = kept._memory._entries
        entries = dict(memory)
        for key in entries:
            if not {key[0][0], _callers.get(key)}.isdisjoint(reaching(number.module)):
                del memory[key]
        for module in holders:
            setattr(module, number.name, value)
        try:
            return [perform(pair, max(AT_LEAST, LONGER * self._seconds[pair])) for pair in pairs]
        finally:
            for module in holders:
                setattr(module, number.name, number.value)
            memory.clear()
            memory.update(entries)


def in_own_process(number: Number, value: float, pairs: list[Pair]) -> list[dict[str, Any]]:
    """Run with another value that is there before anything is imported or compiled."""
    with tempfile.TemporaryDirectory() as folder:
        environment = dict(os.environ)
        if number.in_kernels:
            environment["MEDIALIS_CACHE_DIR"] = folder
            _copy_kernels(number, Path(folder))
        work = json.dumps([number.module, number.name, value, pairs])
        program = Path(__file__).resolve().parents[1] / "tuning.py"
        answer = subprocess.run(
            [sys.executable, program, "--one", work],
            capture_output=True, text=True, env=environment, check=False,
        )  # fmt: skip
    if answer.returncode:
        return [{"failed": 1} for _ in pairs]
    return list(json.loads(answer.stdout.splitlines()[-1]))


def _copy_kernels(number: Number, folder: Path) -> None:
    """Copy the compiled kernels that do not have a number in them."""
    known = cache_folder.kernel_cache()
    changed = {name for name in reaching(number.module) if is_kernels(name)}
    target = folder / known.name
    folder.chmod(0o700)
    target.mkdir(mode=0o700)
    for path in known.glob("*.nb?"):
        if not any(f"-{name}." in path.name for name in changed):
            shutil.copyfile(path, target / path.name)


def one(work: str) -> None:
    """Answer `in_own_process`: import a module with another number, run, print results."""
    module, name, value, pairs = json.loads(work)
    assert module not in sys.modules, f"{module} is imported before its number is another one"
    spec = find_spec(module)
    assert spec is not None
    tree = ast.parse(path_of(module).read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign):
            _state(node, name, value)
    loaded = module_from_spec(spec)
    sys.modules[module] = loaded
    exec(compile(ast.fix_missing_locations(tree), str(path_of(module)), "exec"), loaded.__dict__)
    parent, _, last = module.rpartition(".")
    setattr(importlib.import_module(parent), last, loaded)
    assert getattr(loaded, name) == value
    results = [perform(tuple(pair)) for pair in pairs]
    print(json.dumps(results))


def _state(statement: ast.Assign, name: str, value: float) -> None:
    """Put another value into a statement, if it states this name."""
    (target,) = statement.targets
    if isinstance(target, ast.Name) and target.id == name:
        statement.value = ast.Constant(value)
    elif isinstance(target, ast.Tuple) and isinstance(statement.value, ast.Tuple):
        for i, one in enumerate(target.elts):
            if isinstance(one, ast.Name) and one.id == name:
                statement.value.elts[i] = ast.Constant(value)
