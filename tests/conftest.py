"""Shared fixtures: the real shapes beside the project, where they exist."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

import medialis

REAL_SHAPES = Path(__file__).resolve().parents[2] / "shared" / "shapes"


@pytest.fixture(scope="session")
def real_shapes() -> Path:
    """Folder of the real meshes; tests that need it skip on a machine without it."""
    if not REAL_SHAPES.is_dir():
        pytest.skip("needs the real meshes in ../shared/shapes, which are not part of the project")
    return REAL_SHAPES


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
