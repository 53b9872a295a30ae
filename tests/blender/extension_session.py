"""One Blender session in a process of its own, for test_packaging: installs, runs, uninstalls.

    python -I -S extension_session.py SITE STEP...

SITE is the only folder that modules beside the standard library come from at the start: it holds
bpy and what bpy asks for, but no numba, scipy or medialis. Steps are done in order:
`install=FILE.zip`, `repository=URL`, `enable`, `run`, `click`, `disable`, `uninstall`. Prints one
line of JSON at the end. `click` tells how long the surface skeleton of the monkey takes, by the
clock and in processor time of this process and the one that computes, which it starts.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib.metadata import version
from importlib.util import find_spec

MODULE = "bl_ext.user_default.medialis"


def _found_in(names: tuple[str, ...]) -> dict[str, str | None]:
    """Return the files that the names stand for, here and so in the process that computes."""
    found = {name: find_spec(name) for name in names}
    return {name: spec and spec.origin for name, spec in found.items()}


def run_operator() -> dict[str, object]:
    """Compute the surface skeleton of a torus and return what came of it."""
    import bpy

    bpy.ops.mesh.primitive_torus_add(major_segments=64, minor_segments=32)
    before = len(bpy.data.objects)
    outcome = bpy.ops.medialis.surface_skeleton()
    import medialis
    from medialis.base.jit import MADE

    return {
        "outcome": sorted(outcome),
        "new objects": len(bpy.data.objects) - before,
        "files": _found_in(("medialis", "numba", "llvmlite", "scipy", "numpy")),
        "made": _found_in((f"medialis.skeleton.{MADE}",)),
        "version": version("medialis"),
        "numba here": "numba" in sys.modules,
        "updated": hasattr(medialis.base.errors, "UPDATED"),
    }


def click() -> dict[str, object]:
    """Compute the surface skeleton of the monkey, the first thing, and return what it took."""
    import bpy

    bpy.ops.mesh.primitive_monkey_add()
    clock, processor = time.perf_counter(), sum(os.times()[:4])
    outcome = bpy.ops.medialis.surface_skeleton()
    seconds = time.perf_counter() - clock
    bpy.ops.preferences.addon_disable(module=MODULE)  # ends the process that computes
    return {
        "clicked": sorted(outcome),
        "seconds": seconds,
        "processor seconds": sum(os.times()[:4]) - processor,
    }


def install_from(index: str) -> None:
    """Install from the repository that an index.json describes, into this profile's own."""
    import bpy

    bpy.context.preferences.system.use_online_access = True  # Blender asks for it also for file://
    repositories = bpy.context.preferences.extensions.repos
    (place,) = [i for i, repo in enumerate(repositories) if repo.module == "user_default"]
    repositories[place].use_remote_url = True
    repositories[place].remote_url = index
    bpy.ops.extensions.repo_sync(repo_index=place)
    bpy.ops.extensions.package_install(repo_index=place, pkg_id="medialis", enable_on_install=True)


def main(site: str, *steps: str) -> None:
    """Do the steps and print the last result with what is left enabled and installed."""
    sys.path.insert(0, site)
    import bpy  # isort: skip - it makes the next one importable
    import addon_utils

    result: dict[str, object] = {}
    for step in steps:
        kind, _, value = step.partition("=")
        if kind == "install":
            bpy.ops.extensions.package_install_files(
                filepath=value, repo="user_default", enable_on_install=True
            )
        elif kind == "repository":
            install_from(value)
        elif kind == "enable":
            bpy.ops.preferences.addon_enable(module=MODULE)
        elif kind == "run":
            result |= run_operator()
        elif kind == "click":
            result |= click()
        elif kind == "disable":
            bpy.ops.preferences.addon_disable(module=MODULE)
        elif kind == "uninstall":
            names = [repo.module for repo in bpy.context.preferences.extensions.repos]
            bpy.ops.extensions.package_uninstall(
                repo_index=names.index("user_default"), pkg_id="medialis"
            )
        else:
            raise SystemExit(f"unknown step {step}")
    result["enabled"] = MODULE in bpy.context.preferences.addons
    result["operator"] = hasattr(bpy.types, "MEDIALIS_OT_surface_skeleton")
    result["known"] = any(module.__name__ == MODULE for module in addon_utils.modules())
    print("RESULT " + json.dumps(result))


if __name__ == "__main__":
    main(*sys.argv[1:])
