# SPDX-License-Identifier: GPL-3.0-or-later
"""What medialis has made in the file, and whether it still is as it was made.

Everything else is the user's, whatever its name: it is never written, renamed or removed. A copy of
what medialis has made is the user's, and so is what was edited since: it stays when results go.
"""

from __future__ import annotations

import hashlib
import json
import re
import uuid
from collections.abc import Iterable
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

NAME = "medialis_name"
"""Custom property of what medialis has made: a number of its own, and the name that it had then."""
PRINT = "medialis_print"
"""Custom property of objects, materials and node groups that medialis has made: what they were like
then."""
TEST_POSES = "medialis_test_poses"
"""Custom property of the action of test poses: what was there before, as JSON."""
SAMPLE = 50_000
"""Vertices whose weights are looked at: reading them takes microseconds each."""
KEYS = {
    "FLOAT": ("value", np.float32, 1),
    "INT": ("value", np.int32, 1),
    "INT8": ("value", np.int8, 1),
    "BOOLEAN": ("value", np.bool_, 1),
    "FLOAT2": ("vector", np.float32, 2),
    "FLOAT_VECTOR": ("vector", np.float32, 3),
    "FLOAT_COLOR": ("color", np.float32, 4),
    "BYTE_COLOR": ("color", np.float32, 4),
    "QUATERNION": ("value", np.float32, 4),
    "INT16_2D": ("value", np.int16, 2),
    "INT32_2D": ("value", np.int32, 2),
    "FLOAT4X4": ("value", np.float32, 16),
}
"""Key, type and width of the values of an attribute, by its type."""

Made = dict[str, list[Any]]
"""Names of what was written on data, each with its number of values and a checksum of them."""


def mark(one: Any, key: str, value: str) -> None:
    """Mark an object, material, collection or the like as made by medialis."""
    one[key] = value
    one[NAME] = f"{uuid.uuid4().hex} {one.name}"


def rename(one: Any, name: str) -> None:
    """Give another name to what medialis has made."""
    one.name = name
    one[NAME] = f"{_number(one)} {one.name}"


def is_own(one: Any, others: Iterable[Any]) -> bool:
    """Tell whether medialis has made this one of a collection of the file: a copy is the user's.

    What has got another name is a copy when it is called as Blender calls copies, or when there is
    another one of its number.
    """
    number, _, name = one.get(NAME, "").partition(" ")
    if not number or one.name == name:
        return bool(number)
    if re.fullmatch(re.escape(name) + r"\.\d{3,}", one.name):
        return False
    return not any(other != one and _number(other) == number for other in others)


def release_copies(one: Any, others: Iterable[Any]) -> None:
    """Give the copies of what goes to the user."""
    for other in others:
        if other != one and _number(other) == _number(one):
            release(other)


def _number(one: Any) -> str:
    return one.get(NAME, "").partition(" ")[0]


def remember(made: bpy.types.Object) -> None:
    """Keep what an object is like, so that `is_edited` tells changes."""
    made[PRINT] = fingerprint(made)


def is_edited(made: bpy.types.Object) -> bool:
    """Tell whether the user has changed an object since: its geometry, or what hangs on it."""
    return made.get(PRINT) != fingerprint(made)


def remember_nodes(one: Any) -> None:
    """Keep what the nodes of a material or node group are like."""
    one[PRINT] = _nodes_print(one)


def is_rewired(one: Any) -> bool:
    """Tell whether the user has changed its nodes since."""
    return one.get(PRINT, "") not in ("", _nodes_print(one))


def _nodes_print(one: Any) -> str:
    """Return a checksum of nodes, what is set in them, and links; where they lie may change."""
    tree = one.node_tree if isinstance(one, bpy.types.Material) else one
    about: list[Any] = sorted(
        [link.from_node.name, link.from_socket.identifier, link.to_node.name,
         link.to_socket.identifier] for link in tree.links
    )  # fmt: skip
    for node in tree.nodes:
        about.append([node.name, node.bl_idname, node.mute, getattr(node, "attribute_name", "")])
        values = [getattr(socket, "default_value", None) for socket in node.inputs]
        about.append([_plain(value) for value in values])
        if ramp := getattr(node, "color_ramp", None):
            about.append([[stop.position, *stop.color] for stop in ramp.elements])
    return hashlib.blake2b(json.dumps(about).encode(), digest_size=12).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, bpy.types.ID):
        return value.name_full
    return list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def release(one: Any) -> None:
    """Give what medialis has made to the user: the marks go."""
    for name in [key for key in one.keys() if key.startswith("medialis_")]:  # noqa: SIM118
        del one[name]


def fingerprint(made: bpy.types.Object) -> str:
    """Return a checksum of geometry, materials, modifiers, constraints and animation.

    Place, visibility, the inputs of modifiers and poses may change.
    """
    data, digest = made.data, hashlib.blake2b(digest_size=12)
    for attribute in getattr(data, "attributes", ()):
        hidden = attribute.name.startswith(".") and attribute.name not in (
            ".edge_verts", ".corner_vert"
        )  # fmt: skip
        if not hidden and attribute.name not in ("material_index", "sharp_face"):
            digest.update(f"{attribute.name} {attribute.domain}".encode())
            digest.update(_values(attribute).tobytes())
    for spline in getattr(data, "splines", ()):
        values = np.empty(4 * len(spline.points), np.float32)
        spline.points.foreach_get("co", values)
        digest.update(values.tobytes())
    for bone in getattr(data, "bones", ()):
        places = [*bone.head_local, *bone.tail_local, bone.parent.name if bone.parent else ""]
        digest.update(f"{bone.name} {places}".encode())
    materials = [slot.material.name_full if slot.material else "" for slot in made.material_slots]
    modifiers = [(one.name, one.type) for one in made.modifiers]
    animated = [_is_animated(one) for one in (made, data) if one is not None]
    children = sorted(
        child.name
        for child in made.children
        if not child.get(NAME)
        and not any(m.type == "ARMATURE" and m.object == made for m in child.modifiers)
    )
    groups = [group.name for group in made.vertex_groups]
    about = [materials, modifiers, len(made.constraints), animated, children, groups]
    digest.update(json.dumps(about).encode())
    return digest.hexdigest()


def _is_animated(one: Any) -> bool:
    """Tell whether the user has animated something: test poses are none of theirs."""
    found = one.animation_data
    if found is not None and found.action is not None and TEST_POSES in found.action:
        return bool(json.loads(found.action[TEST_POSES])["animated"])
    return found is not None


def prints(data: Any, names: Iterable[str]) -> Made:
    """Return what these attributes are like now."""
    return {name: _print(_values(data.attributes[name])) for name in names}


def unchanged(data: Any, made: Made) -> tuple[list[str], list[str]]:
    """Return which attributes are as medialis has written them, and which the user has edited.

    Where the user has added or removed vertices or faces, Blender has carried the values along:
    they still are those of medialis.
    """
    return _sorted_out(made, lambda name: _values(data.attributes[name]), data.attributes)


def unchanged_groups(chosen: bpy.types.Object, made: Made) -> tuple[list[str], list[str]]:
    """Return the same of vertex groups."""
    present = {group.name for group in chosen.vertex_groups}
    read = read_groups(chosen, present & set(made))
    return _sorted_out(made, read.__getitem__, present, counts=len(chosen.data.vertices))


def group_prints(chosen: bpy.types.Object, names: Iterable[str]) -> Made:
    """Return what these vertex groups are like now."""
    count = len(chosen.data.vertices)
    read = read_groups(chosen, set(names))
    return {name: [count, _digest(values)] for name, values in read.items()}


def read_groups(chosen: bpy.types.Object, names: set[str]) -> dict[str, NDArray[np.float32]]:
    """Return the weights of vertex groups, -1 where a vertex has none, of up to `SAMPLE` vertices.

    Of larger meshes every so many vertices are looked at.
    """
    vertices = chosen.data.vertices
    step = max(1, -(-len(vertices) // SAMPLE))
    rows = range(0, len(vertices), step)
    numbers = {group.index: group.name for group in chosen.vertex_groups if group.name in names}
    found = {name: np.full(len(rows), -1.0, np.float32) for name in numbers.values()}
    if found:
        for row, vertex in enumerate(rows):
            for entry in vertices[vertex].groups:
                if entry.group in numbers:
                    found[numbers[entry.group]][row] = entry.weight
    return found


def _sorted_out(
    made: Made, read: Any, present: Any, counts: int = -1
) -> tuple[list[str], list[str]]:
    ours: list[str] = []
    edited: list[str] = []
    for name, (count, digest) in made.items():
        if name in present:
            values = read(name)
            same_count = count == (len(values) if counts < 0 else counts)
            (edited if same_count and digest != _digest(values) else ours).append(name)
    return ours, edited


def _print(values: NDArray[Any]) -> list[Any]:
    return [len(values), _digest(values)]


def _digest(values: NDArray[Any]) -> str:
    return hashlib.blake2b(values.tobytes(), digest_size=12).hexdigest()


def _values(attribute: bpy.types.Attribute) -> NDArray[Any]:
    """Return the values of an attribute in a row; texts are none."""
    if attribute.data_type not in KEYS:
        return np.empty(0, np.float32)
    key, kind, width = KEYS[attribute.data_type]
    values = np.empty(len(attribute.data) * width, kind)
    attribute.data.foreach_get(key, values)
    return values
