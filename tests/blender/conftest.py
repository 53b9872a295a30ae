"""Scenes for the tests of the Blender adapter; without bpy all of them skip."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MISSING = "bpy is not installed: make hosts"

# A Python for bpy has the core's dependencies, not necessarily the core.
for name, folder in (("blender_addon", ROOT), ("medialis", ROOT / "core")):
    if find_spec(name) is None:
        sys.path.append(str(folder))


@pytest.fixture(scope="session")
def addon():
    """The adapter, registered as `import bpy` users register it."""
    pytest.importorskip("bpy", reason=MISSING)
    import blender_addon

    blender_addon.register()
    yield blender_addon
    blender_addon.unregister()


@pytest.fixture
def scene(addon):
    """An empty file with one empty scene."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene
