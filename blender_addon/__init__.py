# SPDX-License-Identifier: GPL-3.0-or-later
"""medialis in Blender: skeletons, thickness and parts of the active object, by button or script.

The adapter reads the evaluated object, calls the core (`medialis`), writes its layers as Blender
data, and reports. Every operation of the core's registry appears by itself.
"""

import atexit
from typing import Any

_registered = False


def register() -> None:
    """Add operators, settings, preferences, panel and menu; nothing is computed.

    Blender does it for the extension, and scripts where they want it: no import does it.
    """
    global _registered
    if _registered:
        return
    for module in _modules():
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
    from . import jobs

    atexit.unregister(unregister)
    jobs.stop()
    for module in reversed(_modules()):
        module.unregister()


def _modules() -> tuple:
    """Return the modules that register something, in their order."""
    from . import (
        assets,
        editing,
        finding,
        levels,
        live,
        menus,
        metarigs,
        operators,
        overlay,
        panel,
        preferences,
        presets,
        properties,
        selecting,
    )

    first = (
        preferences,
        properties,
        levels,
        operators,
        presets,
        selecting,
        editing,
        assets,
        metarigs,
    )
    return *first, panel, menus, finding, live, overlay


def __getattr__(name: str) -> Any:
    """Return `run` or the function of an operation, such as `thickness` (see `functions.py`)."""
    from medialis import OPERATIONS

    if name != "run" and all(name != operation.name for operation in OPERATIONS):
        raise AttributeError(f"there is no operation {name!r}")
    from . import functions

    return functions.run if name == "run" else functions.function(name)
