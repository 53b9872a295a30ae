"""Kernels compiled before the first run of an operation, in several processes."""

import importlib
import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest

import medialis
from medialis.base import cache_folder
from medialis.hosts import compile_ahead

STALE = "write the list anew: python benchmarks/record_kernels.py"


def test_the_list_names_kernels_of_today():
    """A few may be out of date: they are compiled when they are called."""
    every = compile_ahead.all_listed()
    assert len(every) > 100
    right = 0
    for one in every:
        module, _, name = one.kernel.partition(":")
        found = getattr(importlib.import_module(f"medialis.{module}"), name, None)
        if found is not None:
            wanted = inspect.signature(found.py_func).parameters
            right += len(wanted) == len(one.arguments)
    assert right >= 0.9 * len(every), STALE


def test_every_operation_is_listed():
    named = {name for one in compile_ahead.all_listed() for name in one.operations}
    known = {operation.name for operation in medialis.OPERATIONS}
    assert len(known & named) >= 0.9 * len(known), STALE


RUN = """
import sys, medialis
from medialis.hosts.compile_ahead import compile_ahead, is_needed
from medialis.base.cache_folder import kernel_cache
count = lambda: sum(1 for _ in kernel_cache().rglob("*.nbi"))
assert is_needed("smooth")
seen = []
compile_ahead("smooth", medialis.Progress(lambda fraction, text: seen.append(fraction)))
assert not is_needed("smooth") and seen == sorted(seen) and seen[-1] > 0.5, seen
shape = medialis.organic_shape(56)
before = count()
medialis.run("smooth", medialis.make_shape(shape.points, shape.faces, repair=True))
print(before, count())
"""


def test_what_is_compiled_ahead_is_not_compiled_again(tmp_path):
    folder = Path(cache_folder.PACKAGE).parent
    environment = dict(os.environ, MEDIALIS_CACHE_DIR=str(tmp_path), PYTHONPATH=str(folder))
    run = subprocess.run(
        [sys.executable, "-c", RUN], env=environment, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    before, after = map(int, run.stdout.split())
    assert before > 10 and after - before <= 0.2 * after, STALE


def test_cancelling_ends_the_helpers(tmp_path, monkeypatch):
    monkeypatch.setenv("MEDIALIS_CACHE_DIR", str(tmp_path))
    cache_folder.kernel_cache.cache_clear()
    try:
        with pytest.raises(medialis.Cancelled):
            compile_ahead.compile_ahead("thickness", medialis.Progress(lambda *_: False))
        assert compile_ahead.is_needed("thickness")
        assert not compile_ahead.is_needed("no such operation")
    finally:
        monkeypatch.undo()
        cache_folder.kernel_cache.cache_clear()
