# SPDX-License-Identifier: GPL-3.0-or-later
"""Other numbers of points of a result without computing anew: a slider of the object.

The levels of a layer stay with its object as bytes, so they are there after loading the file, too.
"""

from __future__ import annotations

from functools import lru_cache

import bpy
from bpy.props import IntProperty

from medialis.hosts import Levels, unpacked_levels

from . import layers, meshes, own


def has(chosen: bpy.types.Object | None) -> bool:
    """Tell whether an object has levels."""
    return chosen is not None and chosen.type == "MESH" and layers.LEVELS in chosen


def show(chosen: bpy.types.Object, count: int) -> int:
    """Show an object with another number of points; return how many it has then.

    What was edited on it is replaced.
    """
    layer = _unpacked(bytes(chosen[layers.LEVELS])).layer(count)
    plan = layers.plan_data(layer, chosen.name)
    mesh = chosen.data
    mesh.clear_geometry()
    meshes.fill(mesh, plan.points, plan.faces, plan.layer.edges)
    layers.write_attributes(mesh, plan)
    mesh.update()
    own.remember(chosen)
    return len(plan.points)


@lru_cache(maxsize=4)
def _unpacked(data: bytes) -> Levels:
    return unpacked_levels(data)


def _get(chosen: bpy.types.Object) -> int:
    return len(chosen.data.vertices) if has(chosen) else 0


def _set(chosen: bpy.types.Object, count: int) -> None:
    if has(chosen) and chosen.mode == "OBJECT":
        show(chosen, count)


def register() -> None:
    """Add the slider to objects."""
    bpy.types.Object.medialis_level = IntProperty(
        name="Balls",
        description="Show the result with fewer or more of them, without computing it anew; what "
        "was edited is replaced",
        min=1,
        soft_max=500,
        get=_get,
        set=_set,
    )


def unregister() -> None:
    """Remove the slider."""
    del bpy.types.Object.medialis_level
    _unpacked.cache_clear()
