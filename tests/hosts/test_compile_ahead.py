"""Kernels compiled before the first run of an operation, in several processes."""

import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import typeof

import medialis
from medialis.base import cache_folder
from medialis.base.compiling import dispatcher_of
from medialis.hosts import compile_ahead
from medialis.walls._kernels import Patch, _offer

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))
import record_kernels  # noqa: E402

STALE = "write the list anew: python benchmarks/record_kernels.py"
SEARCH = ["walls._kernels:Search", "f8:2C", "f8", "f8", "f8", *["f8:1C", "f8:2C", "f8:1C", "f8:1C"]]


def is_of_today(one):
    """Tell whether a kernel is there, takes that many arguments, and its records these fields."""
    try:
        for word in one.arguments:
            compile_ahead.example(word)
        wanted = inspect.signature(compile_ahead.named(one.kernel).py_func).parameters
    except (ImportError, AttributeError, TypeError):
        return False
    return len(wanted) == len(one.arguments)


def test_the_list_names_kernels_of_today():
    """A few may be out of date: they are compiled when they are called."""
    every = compile_ahead.all_listed()
    assert len(every) > 100
    assert sum(map(is_of_today, every)) >= 0.9 * len(every), STALE


def test_examples_have_the_types_of_calls():
    """Records hold arrays, numbers and other records; what was recorded comes back as it was."""
    patch = ["walls._kernels:Patch", "f8:2C", "i8:2C", "i8:2C"]
    for word in ("f8", "b1", "i4:1C", "f8:2Cr", "f8:2F", "f8:1A", patch, ["", patch, "i8"]):
        assert record_kernels.word(typeof(compile_ahead.example(word))) == word
    assert type(compile_ahead.example(patch)) is Patch


def test_types_tell_what_a_kernel_calls():
    """`_offer` of two places calls `_measure`; nothing has to be compiled for it."""
    arguments = [compile_ahead.example(word) for word in ("f8:1C", "f8:1C", SEARCH)]
    called = record_kernels.callees(dispatcher_of(_offer), tuple(map(typeof, arguments)))
    assert {record_kernels.name_of(kernel) for kernel, _ in called} == {"walls._kernels:_measure"}


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
compile_ahead(["smooth"], medialis.Progress(lambda fraction, text: seen.append(fraction)))
assert not is_needed("smooth") and seen == sorted(seen) and seen[-1] > 0.5, seen
shape = medialis.organic_shape(56)
before = count()
medialis.run("smooth", medialis.make_shape(shape.points, shape.faces, repair=True))
print(before, count())
"""


@pytest.mark.slow
def test_what_is_compiled_ahead_is_not_compiled_again(tmp_path):
    folder = Path(cache_folder.PACKAGE).parent
    environment = dict(os.environ, MEDIALIS_CACHE_DIR=str(tmp_path), PYTHONPATH=str(folder))
    environment["MEDIALIS_KERNELS"] = "numba"
    run = subprocess.run(
        [sys.executable, "-c", RUN], env=environment, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    before, after = map(int, run.stdout.split())
    assert before > 10 and after - before <= 0.2 * after, STALE


def test_cancelling_ends_the_helpers(tmp_path, monkeypatch):
    monkeypatch.setenv("MEDIALIS_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compile_ahead, "record", dict)  # as where nothing is made ahead of time
    cache_folder.kernel_cache.cache_clear()
    try:
        with pytest.raises(medialis.Cancelled):
            compile_ahead.compile_ahead(["thickness"], medialis.Progress(lambda *_: False))
        assert compile_ahead.is_needed("thickness")
        assert not compile_ahead.is_needed("no such operation")
    finally:
        monkeypatch.undo()
        cache_folder.kernel_cache.cache_clear()
