# SPDX-License-Identifier: GPL-3.0-or-later
"""medialis in Blender: skeletons, thickness and parts of the active object, by button or script.

The adapter reads the evaluated object, calls the core (`medialis`), writes its layers as Blender
data, and reports. Every operation of the core's registry appears by itself.
"""

import atexit
import importlib.util
import sys
from pathlib import Path

bl_info = {
    "name": "Medialis",
    "author": "The medialis developers",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "3D View > Sidebar > Medialis, Object > Medialis",
    "description": "Medial skeletons, thickness and parts of meshes and point clouds",
    "category": "Object",
}


def _find_core() -> None:
    """Use the sources beside this folder where the core is not installed (development)."""
    sources = Path(__file__).resolve().parents[1] / "core"
    if importlib.util.find_spec("medialis") is None and sources.is_dir():
        sys.path.append(str(sources))


def register() -> None:
    """Add operators, settings, panel and menu; start compiling kernels in a Blender window."""
    _find_core()
    from . import menus, operators, panel, properties, warmup

    for module in (properties, operators, panel, menus, warmup):
        module.register()
    # With `import bpy` of Blender 4.5, a Python process hangs at its end while a class of any
    # add-on is registered.
    atexit.register(unregister)


def unregister() -> None:
    """Stop what runs and remove everything that `register` added."""
    from . import jobs, menus, operators, panel, properties, warmup

    atexit.unregister(unregister)
    jobs.stop()
    for module in (warmup, menus, panel, operators, properties):
        module.unregister()
