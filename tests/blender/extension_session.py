"""One Blender session in a process of its own, for test_packaging: installs, runs, uninstalls.

    python -I -S extension_session.py SITE STEP...

SITE is the only folder that modules beside the standard library come from at the start: it holds
bpy and what bpy asks for, but no numba, scipy or medialis. Steps are done in order:
`install=FILE.zip`, `enable`, `run`, `disable`, `uninstall`. Prints one line of JSON at the end.
"""

from __future__ import annotations

import json
import sys
from importlib.metadata import version

MODULE = "bl_ext.user_default.medialis"


def _loaded_from(names: tuple[str, ...]) -> dict[str, str | None]:
    return {name: getattr(sys.modules.get(name), "__file__", None) for name in names}


def run_operator() -> dict[str, object]:
    """Compute the surface skeleton of a torus and return what came of it."""
    import bpy

    bpy.ops.mesh.primitive_torus_add(major_segments=64, minor_segments=32)
    before = len(bpy.data.objects)
    outcome = bpy.ops.medialis.surface_skeleton()
    import medialis

    return {
        "outcome": sorted(outcome),
        "new objects": len(bpy.data.objects) - before,
        "files": _loaded_from(("medialis", "numba", "llvmlite", "scipy", "numpy")),
        "version": version("medialis"),
        "updated": hasattr(medialis.errors, "UPDATED"),
    }


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
        elif kind == "enable":
            bpy.ops.preferences.addon_enable(module=MODULE)
        elif kind == "run":
            result |= run_operator()
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
