"""Shared fixtures: the real shapes beside the project, where they exist."""

from __future__ import annotations

from pathlib import Path

import pytest

REAL_SHAPES = Path(__file__).resolve().parents[2] / "shared" / "shapes"


@pytest.fixture(scope="session")
def real_shapes() -> Path:
    """Folder of the real meshes; tests that need it skip on a machine without it."""
    if not REAL_SHAPES.is_dir():
        pytest.skip("needs the real meshes in ../shared/shapes, which are not part of the project")
    return REAL_SHAPES
