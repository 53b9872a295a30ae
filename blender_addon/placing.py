# SPDX-License-Identifier: GPL-3.0-or-later
"""Where results go: a collection for each source, and a parent that they lie on and follow."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np
from mathutils import Matrix

from . import own
from .changes import Changes
from .reading import RESULT, Source, is_result


def result_collection(
    scene: bpy.types.Scene, source: bpy.types.Object, changes: Changes
) -> bpy.types.Collection:
    """Return the collection of the results of a source, "Medialis: <name>"; made when missing.

    It lies beside the source, in the collection of the scene that has it.
    """
    inside = [scene.collection, *scene.collection.children_recursive]
    for result in source.children_recursive:
        for collection in result.users_collection if is_result(result) else ():
            if _is_own(collection) and collection in inside:
                return collection
    title = f"Medialis: {source.name}"
    while len(title.encode()) > 63:  # what Blender keeps of a name
        title = title[:-1]
    made = bpy.data.collections.new(title)
    changes.undo_by(bpy.data.collections.remove, made)
    own.mark(made, RESULT, "collection")
    beside = [one for one in inside if source.name in one.objects and one.library is None]
    usable = [one for one in beside if one.override_library is None and not _is_own(one)]
    next(iter(usable), scene.collection).children.link(made)
    return made


def _is_own(collection: bpy.types.Collection) -> bool:
    return own.is_own(collection, bpy.data.collections)


def remove_empty(collections: Iterable[bpy.types.Collection]) -> None:
    """Remove those of our collections that hold nothing any more."""
    for collection in collections:
        if _is_own(collection) and not collection.all_objects and not collection.children:
            bpy.data.collections.remove(collection)


def lay_on(child: bpy.types.Object, parent: bpy.types.Object, source: Source) -> None:
    """Parent an object in the coordinates of `Source` so that it lies on its source.

    The inverse undoes rotation and scale as they were when the source was read, and has no
    translation: exact also for objects far from the world's origin.
    """
    child.parent = parent
    inverse = np.eye(4)
    inverse[:3, :3] = np.linalg.inv(source.linear)
    child.matrix_parent_inverse = Matrix(inverse.tolist())


def link(child: bpy.types.Object, collection: bpy.types.Collection) -> None:
    """Put an object into this collection only."""
    for other in child.users_collection:
        other.objects.unlink(child)
    collection.objects.link(child)


def make_active(context: bpy.types.Context, chosen: bpy.types.Object) -> None:
    """Select only this object and make it active, as Blender's own operators do.

    In a collection that is hidden or excluded from the view layer it cannot be: then nothing
    changes.
    """
    layer = context.view_layer
    layer.update()  # new collections are not in it before
    if layer.objects.get(chosen.name) != chosen:
        return
    for other in layer.objects:
        other.select_set(other == chosen)
    layer.objects.active = chosen
