"""Scenes for the tests of the Blender adapter; without bpy all of them skip."""

from __future__ import annotations

import os
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


def pytest_sessionfinish(session, exitstatus):
    session.config.status_of_bpy = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """End without bpy's own clean-up, which after all tests waited for a thread for ever (4.5)."""
    if "bpy" in sys.modules and hasattr(config, "status_of_bpy"):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.status_of_bpy)


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
