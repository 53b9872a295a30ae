# SPDX-License-Identifier: GPL-3.0-or-later
"""What a result found on a mesh as the selection of edit mode: thin walls, failed walls, a part."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty
from numpy.typing import NDArray

from medialis import MedialisError

from . import placing, reading, writing
from .properties import LENGTH_SUFFIX
from .removing import attribute_of

WALLS, SPOT, CHECK = "wall_thickness", "thin_spot", "check"
"""Attributes of the operations thickness and wall_check."""
COLOR = "_color"
"""What the colours of an attribute end in."""
FAILED = (1, 2, 5)
"""What `check` is where walls are too thin or too thick, or a gap is too narrow."""

WHICH = (
    ("THIN", "Thin Walls", "Faces thinner than the threshold, or of the thin spots where it is 0"),
    ("FAILED", "Failed Walls", "Faces that do not pass the wall check: too thin, too thick, a gap"),
    ("PART", "Part", "Faces of one part or segment: that of the active face, or that of a number"),
)

WORDS = {"THIN": ("thickness", "too thin"), "FAILED": ("3D print",), "PART": ("segment",)}
"""What people look for."""

MISSING = {
    "THIN": "No thickness, or no thin spot where no threshold is given: run Thickness first.",
    "FAILED": "This mesh was not checked: run Wall Check or 3D Print Check first.",
    "PART": "This mesh has no parts: run Parts, or another segmentation, first.",
}


def carrier(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the mesh object that a result has written on: the active one, or its source."""
    for chosen in (context.active_object, reading.target(context)):
        if chosen is not None and chosen.type == "MESH" and available(chosen):
            return chosen
    return None


def available(chosen: bpy.types.Object) -> list[str]:
    """Return what can be selected on a mesh object, of `WHICH`."""
    found = {
        "THIN": bool(attribute_of(chosen, WALLS) or attribute_of(chosen, SPOT)),
        "FAILED": bool(attribute_of(chosen, CHECK)),
        "PART": bool(labels_of(chosen)),
    }
    return [name for name, there in found.items() if there]


def labels_of(chosen: bpy.types.Object) -> str:
    """Return the attribute that numbers the parts: the one in whose colours the mesh is shown.

    Else the last one that has colours; empty where none has. That of the faces goes before that of
    the vertices.
    """
    known = chosen.data.attributes
    shown = chosen.data.color_attributes.active_color
    colored = [one.name for one in chosen.data.color_attributes]
    names = [name.partition(COLOR)[0] for name in [*colored, *([shown.name] if shown else [])]]
    for name in reversed(names):
        found = attribute_of(chosen, name)
        if found and known[found].data_type == "INT":
            return attribute_of(chosen, f"face_{name}") or found
    return ""


def faces_that(mesh: bpy.types.Mesh, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the polygons that have one of these vertices: part of such a polygon is meant."""
    totals = reading.corner_totals(mesh)
    begins = np.cumsum(totals) - totals
    return np.logical_or.reduceat(chosen[reading.corner_vertices(mesh)], begins)


def part_of_faces(chosen: bpy.types.Object) -> NDArray[np.int32]:
    """Return the part of each polygon; where vertices are numbered, that of its first corner."""
    mesh = chosen.data
    attribute = mesh.attributes[labels_of(chosen)]
    labels = _values(attribute, np.int32)
    if attribute.domain == "FACE":
        return labels
    totals = reading.corner_totals(mesh)
    return labels[reading.corner_vertices(mesh)[np.cumsum(totals) - totals]]


def _values(attribute: bpy.types.Attribute, kind: Any) -> NDArray[Any]:
    values = np.empty(len(attribute.data), kind)
    attribute.data.foreach_get("value", values)
    return values


def panel_threshold(context: bpy.types.Context, chosen: bpy.types.Object) -> float:
    """Return the threshold of Thickness in the panel, in the units of the scene.

    Raises
    ------
    InvalidShapeError
        When the object cannot be read.
    """
    settings = context.scene.medialis
    own = settings.of_thickness
    if settings.lengths_in == "SCENE":
        return float(getattr(own, "threshold" + LENGTH_SUFFIX))
    if not own.threshold:
        return 0.0
    points = reading.read_object(context, chosen).points
    return 0.01 * own.threshold * float(np.linalg.norm(np.ptp(points, axis=0)))


class MEDIALIS_OT_select_faces(bpy.types.Operator):
    """Select the faces in edit mode that a result has found"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.select_faces"
    bl_label = "Select Faces of Result"
    bl_options: ClassVar = {"REGISTER", "UNDO"}
    __annotations__: ClassVar = {
        "which": EnumProperty(name="Faces", description="What is selected", items=WHICH),
        "threshold": FloatProperty(
            name="Threshold",
            description="Faces are thin below this; at first, the threshold of Thickness in the "
            "panel. 0: those of the thin spots that were found",
            subtype="DISTANCE",
            min=0.0,
            precision=4,
        ),
        "part": IntProperty(
            name="Part",
            description="Number of the part. -1: that of the active face",
            default=-1,
            min=-1,
        ),
        "extend": BoolProperty(name="Extend", description="Keep what is selected already"),
    }

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it for meshes that a result has written on."""
        if carrier(context) is None:
            cls.poll_message_set("Compute thickness, a wall check, parts or segments first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Select, and go to edit mode."""
        chosen = carrier(context)
        try:
            if not self.properties.is_property_set("threshold"):
                self.threshold = panel_threshold(context, chosen)
            writing.leave_edit_mode(context, chosen)
            faces = self._faces(chosen)
            count = _select(context, chosen, faces, extend=self.extend)
        except (MedialisError, RuntimeError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        text = f"{count:,} of {len(faces):,} faces of {chosen.name} are selected."
        self.report({"INFO"}, text)
        return {"FINISHED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the options that count."""
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(self, "which")
        own = {"THIN": "threshold", "PART": "part"}.get(self.which)
        if own is not None:
            layout.prop(self, own)
        layout.prop(self, "extend")

    def _faces(self, chosen: bpy.types.Object) -> NDArray[np.bool_]:
        """Return whether each polygon is meant.

        Raises
        ------
        MedialisError
            When the result for it is missing.
        """
        mesh, wanted = chosen.data, WALLS if self.threshold else SPOT
        known = mesh.attributes
        if self.which == "PART":
            name = labels_of(chosen)
        else:
            name = attribute_of(chosen, {"THIN": wanted, "FAILED": CHECK}[self.which])
        if name not in known:
            raise MedialisError(MISSING[self.which])
        if self.which == "PART":
            return self._part(chosen)
        if self.which == "FAILED":
            return faces_that(mesh, np.isin(_values(known[name], np.int32), FAILED))
        if not self.threshold:
            return faces_that(mesh, _values(known[name], np.int32) >= 0)
        return faces_that(mesh, _values(known[name], np.float32) < self.threshold)

    def _part(self, chosen: bpy.types.Object) -> NDArray[np.bool_]:
        parts = part_of_faces(chosen)
        if self.part < 0:
            active = chosen.data.polygons.active
            if not 0 <= active < len(parts):
                raise MedialisError("There is no active face: click on one in edit mode, or give "
                                    "the number of the part.")  # fmt: skip
            self.part = int(parts[active])
        return parts == self.part


def _select(
    context: bpy.types.Context, chosen: bpy.types.Object, faces: NDArray[np.bool_], *, extend: bool
) -> int:
    """Select polygons with their edges and vertices, in edit mode; return how many are selected.

    What is hidden stays hidden, and is not selected.
    """
    mesh = chosen.data
    before = np.empty(len(faces), bool)
    mesh.polygons.foreach_get("hide", before)
    faces = faces & ~before
    if extend:
        mesh.polygons.foreach_get("select", before)
        faces = faces | before
    corners = np.repeat(faces, reading.corner_totals(mesh))
    edges = np.empty(len(corners), np.int32)
    mesh.loops.foreach_get("edge_index", edges)
    for rows, held in ((reading.corner_vertices(mesh), mesh.vertices), (edges, mesh.edges)):
        chosen_ones = np.zeros(len(held), bool)
        chosen_ones[rows[corners]] = True
        held.foreach_set("select", chosen_ones)
    mesh.polygons.foreach_set("select", faces)
    placing.make_active(context, chosen)
    context.tool_settings.mesh_select_mode = (False, False, True)
    bpy.ops.object.mode_set(mode="EDIT")
    return int(faces.sum())


def draw_entries(layout: Any) -> None:
    """Draw the three selections, with the words that people look for."""
    for name, label, _ in WHICH:
        text = f"Select {label} ({', '.join(WORDS[name])})"
        layout.operator("medialis.select_faces", text=text).which = name


def register() -> None:
    """Add the operator."""
    bpy.utils.register_class(MEDIALIS_OT_select_faces)


def unregister() -> None:
    """Remove the operator."""
    bpy.utils.unregister_class(MEDIALIS_OT_select_faces)
