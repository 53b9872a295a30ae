# SPDX-License-Identifier: GPL-3.0-or-later
"""medialis in Blender: skeletons, thickness and parts of the active object, by button or script.

The adapter reads the evaluated object, calls the core (`medialis`), writes its layers as Blender
data, and reports. Every operation of the core's registry appears by itself.
"""

import atexit
import importlib.util
import sys
from pathlib import Path

_registered = False


def _find_core() -> None:
    """Use the sources beside this folder where the core is not installed (development)."""
    sources = Path(__file__).resolve().parents[1] / "core"
    if importlib.util.find_spec("medialis") is None and sources.is_dir():
        sys.path.append(str(sources))


def register() -> None:
    """Add operators, settings, panel and menu; start compiling kernels in a Blender window."""
    global _registered
    if _registered:
        return
    _find_core()
    from . import menus, operators, panel, properties, warmup

    for module in (properties, operators, panel, menus, warmup):
        module.register()
    # With `import bpy` of Blender 4.5, a Python process hangs at its end while a class of any
    # add-on is registered.
    atexit.register(unregister)
    _registered = True


def unregister() -> None:
    """Stop what runs and remove everything that `register` added."""
    global _registered
    if not _registered:  # at exit Blender and `atexit` both may call this
        return
    _registered = False
    from . import jobs, menus, operators, panel, properties, warmup

    atexit.unregister(unregister)
    jobs.stop()
    for module in (warmup, menus, panel, operators, properties):
        module.unregister()
    if __package__.startswith("bl_ext."):  # after an update the next start must find the new core
        for name in [name for name in sys.modules if name.partition(".")[0] == "medialis"]:
            del sys.modules[name]
