# SPDX-License-Identifier: GPL-3.0-or-later
"""Results that were edited: given back to their operation, or written to a file."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty
from numpy.typing import NDArray

from medialis import MedialisError
from medialis import operation as find_operation
from medialis.hosts import Parameter, takes_back, write_edited

from . import folders, jobs, own, properties, reading
from .reading import FORMATS, OPERATION, RESULT

ABOUT = {
    "ma": "Balls, edges and triangles of a medial mesh, as text",
    "glb": "Triangles, binary glTF",
    "obj": "Triangles, as text",
    "json": "Balls with middle and radius",
    "urdf": "Balls as collision bodies of a robot",
}
"""Formats of results, for tooltips."""


class Edited(NamedTuple):
    """The mesh of a result as it is now, scaled and moved with its object."""

    points: NDArray[np.float64]
    faces: NDArray[np.int32] | None
    edges: NDArray[np.int32] | None
    attributes: dict[str, NDArray[np.float64]]


def read_edited(chosen: bpy.types.Object, origin: NDArray[np.float64]) -> Edited:
    """Read points, triangles, edges and radii, in world axes relative to an origin."""
    chosen.update_from_editmode()
    data, faces, edges = chosen.data, None, None
    matrix = np.array(chosen.matrix_world, np.float64)
    linear, place = matrix[:3, :3], matrix[:3, 3] - origin
    own = reading.positions(data).astype(np.float64)
    if chosen.type == "MESH":
        faces, _ = reading.triangles(data, reading.corner_vertices(data))
        edges = np.empty(2 * len(data.edges), np.int32)
        data.edges.foreach_get("vertices", edges)
        edges = edges.reshape(-1, 2)
    attributes = {}
    radius = data.attributes.get("radius")
    if radius is not None and (radius.domain, radius.data_type) == ("POINT", "FLOAT"):
        values = np.empty(len(own), np.float32)
        radius.data.foreach_get("value", values)
        # Balls stay balls: of an object that is scaled unevenly they keep their volume.
        attributes["radius"] = values.astype(np.float64) * abs(np.linalg.det(linear)) ** (1 / 3)
    points = np.einsum("ij,kj->ik", own, linear) + place
    return Edited(points, faces, edges, attributes)


def option_of(chosen: bpy.types.Object | None) -> Parameter | None:
    """Return the option of an operation that takes this result back, if there is one."""
    if chosen is None or chosen.type != "MESH" or not reading.is_result(chosen):
        return None
    source = reading.source_of(chosen)
    if source is None or source == chosen:
        return None
    return takes_back(find_operation(chosen[OPERATION]), chosen[RESULT])


class MEDIALIS_OT_rebuild(bpy.types.Operator):
    """Give the result as it was edited back to its operation, which measures and rebuilds it"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.rebuild"
    bl_label = "Rebuild"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it for results that an operation takes back."""
        return jobs.running is None and option_of(context.active_object) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Wait for the result."""
        return self._run(context, "EXEC_DEFAULT")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin; the operator of the operation goes on."""
        return self._run(context, "INVOKE_DEFAULT")

    def _run(self, context: bpy.types.Context, how: str) -> set[str]:
        chosen, option = context.active_object, option_of(context.active_object)
        source = reading.source_of(chosen)
        origin = np.array(source.matrix_world, np.float64)[:3, 3]
        path = folders.exchange() / "medialis-edited.ma"
        try:
            write_edited(path, *read_edited(chosen, origin))
        except MedialisError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        own.remember(
            chosen
        )  # given back, it is the result's again, and goes when the new one comes
        operation = find_operation(chosen[OPERATION])
        given = properties.values_of(operation, context.scene.medialis)
        run = getattr(bpy.ops.medialis, operation.name)
        return run(how, **{**given, option.name: str(path)})


def _formats(chosen: bpy.types.Object | None) -> list[str]:
    known = "" if chosen is None else chosen.get(FORMATS, "")
    return known.split(",") if known else []


def _items(self: Any, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    found = _formats(None if context is None else context.active_object)
    entries = [(ending, ending.upper(), ABOUT.get(ending, "")) for ending in found]
    _shown[:] = entries or [("none", "None", "This result has no formats of its own")]
    return _shown


_shown: list[tuple[str, str, str]] = []
"""Blender keeps no reference to items that a function returns."""


class MEDIALIS_OT_export_layer(bpy.types.Operator):
    """Write the result, as it is now, to a file for other programs"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.export_layer"
    bl_label = "Export"
    bl_options: ClassVar = {"REGISTER"}
    __annotations__: ClassVar = {
        "filepath": StringProperty(subtype="FILE_PATH"),
        "format": EnumProperty(name="Format", items=_items),
    }

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it for results that have formats."""
        return bool(_formats(context.active_object))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the name."""
        self.filepath = bpy.path.clean_name(context.active_object.name) + "." + self.format
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write; the ending of the name is that of the format."""
        path = bpy.path.ensure_ext(bpy.path.abspath(self.filepath), "." + self.format)
        edited = read_edited(context.active_object, np.zeros(3))
        try:
            write_edited(path, *edited, unit=reading.scene_unit(context.scene))
        except MedialisError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Written: {path}")
        return {"FINISHED"}


_classes = (MEDIALIS_OT_rebuild, MEDIALIS_OT_export_layer)


def register() -> None:
    """Add the operators."""
    for made in _classes:
        bpy.utils.register_class(made)


def unregister() -> None:
    """Remove the operators."""
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
