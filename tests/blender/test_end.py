"""A Python process that has registered the add-on ends as any other."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("bpy", reason="bpy is not installed: make hosts")

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("last", ["", "blender_addon.unregister()"])
def test_a_script_ends(last):
    """Blender 4.2 crashed at its end, and 4.5 hung (fixed)."""
    code = f"import bpy, blender_addon\nblender_addon.register()\n{last}"
    path = os.pathsep.join([str(ROOT), str(ROOT / "core")])
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stderr
