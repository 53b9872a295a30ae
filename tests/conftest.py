"""Shared fixtures: the real shapes beside the project, where they exist."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial, wraps
from pathlib import Path

import pytest

import medialis
from medialis.shape import samples
from plates import with_walls

# Where kernels are made ahead of time, one that is missing fails the test that calls it.
os.environ.setdefault("MEDIALIS_KERNELS", "made")

REAL_SHAPES = Path(__file__).resolve().parents[2] / "shared" / "shapes"


@pytest.fixture(scope="session")
def real_shapes() -> Path:
    """Folder of the real meshes; tests that need it skip on a machine without it."""
    if not REAL_SHAPES.is_dir():
        pytest.skip("needs the real meshes in ../shared/shapes, which are not part of the project")
    return REAL_SHAPES


def made_once(make: Callable[..., medialis.Shape]) -> Callable[..., medialis.Shape]:
    """Return a function that makes each shape once, and gives a new object of its arrays."""
    first = cache(make)

    @wraps(make)
    def again(*given: object, **options: object) -> medialis.Shape:
        # A new object: what one test has computed from a shape, such as its tree, another one has
        # to compute as well.
        return replace(first(*given, **options))

    return again


# Tests ask for it some 300 times: 0.1 s for 56 cells, 3.6 s for 200. tests/shape/test_generate.py
# looks at the function itself, which is still in `medialis.shape.generate`.
medialis.organic_shape = made_once(medialis.organic_shape)
# Examples of help texts and pages ask for samples again and again: 1 s each, the tree 5 s.
samples._MADE.update(
    {name: (made_once(make), text) for name, (make, text) in samples._MADE.items()}
)


@pytest.fixture
def small_samples(monkeypatch) -> None:
    """Samples of a quarter as many vertices, for tests that run many commands on them."""
    for name, (make, text) in samples._MADE.items():
        small = partial(lambda make, _: make(64), make)
        monkeypatch.setitem(samples._MADE, name, (small, text))


QUICK = {"view_curve_skeleton": {"pairs": 40, "size": 128}}
"""Options of operations that take half a minute at their defaults."""


@pytest.fixture(scope="session")
def small_shape() -> Callable[[str], medialis.Shape]:
    """Return the shape for an operation by name: `organic_shape(56)`, or `tee()` if it needs walls.

    They are prepared as shapes from files are.
    """

    @cache
    def shape(name: str) -> medialis.Shape:
        made = with_walls(name, medialis.organic_shape(56))
        return medialis.make_shape(made.points, made.faces, repair=True)

    return shape


@pytest.fixture(scope="session")
def default_run(small_shape) -> Callable[[str], medialis.Result]:
    """Return operations at their defaults on `small_shape`, each run once and shared.

    For tests that only look at results; nobody can change these.
    """

    @cache
    def run(name: str) -> medialis.Result:
        return medialis.run(name, small_shape(name), **QUICK.get(name, {}))

    return run


@pytest.fixture(scope="session", autouse=True)
def ctrl_c() -> Iterator[None]:
    """Take Ctrl-C also where the tests were started in the background, which ignores it."""
    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def nothing_kept() -> Iterator[None]:
    """Compute all results anew: a test that compares two runs must not find the first one again."""
    with medialis.memory_limit(0):
        yield
