"""Armatures: bones of any rig, and the files that they come in.

`read_armature` takes glTF with a skin, BVH, and the JSON that `write_armature_json` writes; hosts
hand theirs over as JSON.
"""

from __future__ import annotations

import json
import os
import struct
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from medialis.base.arrays import unit_rows
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.options import METERS, unit_name
from medialis.base.validation import FloatArray, IntArray, Positions, frozen
from medialis.formats.files import complete_file, file_bytes, reading
from medialis.formats.gltf import UP_TO_Y

LARGEST = 10_000
"""Bones that a file may have."""

ALONG = 0.99
"""Minimum cosine of the angle between a bone and the axis that it follows."""


@dataclass(frozen=True, eq=False, repr=False)
class Armature(Bound):
    """Bones as segments, of any rig.

    Attributes
    ----------
    heads, tails : (b, 3) float64
        In the units of the shape that they move.
    parents : (b,) int32
        -1: a root.
    names : tuple of str
        Of the bones; "bone 000", "bone 001", ... when missing.

    Raises
    ------
    InvalidShapeError
        When there is no bone, the arrays do not fit together, or the parents run in a circle.
    """

    heads: Positions
    tails: Positions
    parents: IntArray
    names: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        for name, kind in (("heads", np.float64), ("tails", np.float64), ("parents", np.int32)):
            object.__setattr__(self, name, frozen(getattr(self, name), kind))
        count = len(self.parents)
        wanted = (count, 3)
        if count == 0 or self.heads.shape != wanted or self.tails.shape != wanted:
            raise InvalidShapeError(
                "heads and tails of an armature must have shape (b, 3), and parents (b,), with one "
                f"bone at least, got {self.heads.shape}, {self.tails.shape} and "
                f"{self.parents.shape}."
            )
        if not (np.isfinite(self.heads).all() and np.isfinite(self.tails).all()):
            raise InvalidShapeError("The joints of an armature must be finite numbers.")
        names = self.names or tuple(f"bone {bone:03d}" for bone in range(count))
        if len(names) != count or len(set(names)) != count:
            raise InvalidShapeError(
                f"An armature of {count} bones needs as many different names, got "
                f"{len(set(names))}."
            )
        object.__setattr__(self, "names", tuple(names))
        above = np.array(self.parents)
        if (above < -1).any() or (above >= count).any():
            raise InvalidShapeError("The parents of bones must be their rows, or -1 for roots.")
        for _ in range(count):
            if not (above >= 0).any():
                break
            above = np.where(above >= 0, self.parents[above], -1)
        else:
            raise InvalidShapeError("The parents of the bones run in a circle.")

    @property
    def count(self) -> int:
        """Number of bones b."""
        return len(self.parents)

    @property
    def roots(self) -> IntArray:
        """Bones without a parent."""
        return frozen(np.flatnonzero(self.parents < 0), np.int32)


def read_armature(
    path: str | os.PathLike[str], *, unit: str | None = None, up: str | None = None
) -> Armature:
    """Read the bones of a file.

    Parameters
    ----------
    path : path
        glTF (.glb, .gltf) with a skin, BVH, or JSON with a list ``bones``, each with ``name``,
        ``parent`` (a name, a number, or null), ``head`` and ``tail``.
    unit : str, optional
        What one unit of the shape is that the bones are for: glTF is in metres, JSON in its
        ``unit``. Where one of both is unknown, numbers stay as they are.
    up : {"x", "y", "z"}, optional
        The axis of the shape that points up: in glTF it is y. BVH says neither.

    Returns
    -------
    Armature

    Raises
    ------
    FileError
        When the file cannot be read.
    InvalidShapeError
        When it is damaged, or has no bones.

    See Also
    --------
    bind_weights : what the bones move.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "arm.json")
    ...     _ = path.write_text('{"bones": [{"name": "arm", "parent": null, "head": [0, 0, 0], '
    ...                         '"tail": [1, 0, 0]}]}')
    ...     read_armature(path).names
    ('arm',)
    """
    name = os.fspath(path)
    with reading(name):
        data = file_bytes(name)
        ending = Path(name).suffix.lower()
        if ending in (".glb", ".gltf"):
            return _placed(_of_gltf(data), "m", unit, UP_TO_Y[up or "y"][0])
        if ending == ".bvh":
            return _of_bvh(data)
        found, own = _of_json(data)
        return _placed(found, own, unit, np.eye(3))


def _placed(found: Armature, own: str | None, unit: str | None, turn: FloatArray) -> Armature:
    """Return an armature in another unit, where both are known, and turned back."""
    scale = METERS[own] / METERS[unit] if own and unit else 1.0
    ends = scale * (found.heads @ turn), scale * (found.tails @ turn)
    return replace(found, heads=ends[0], tails=ends[1])


def _of_json(data: bytes) -> tuple[Armature, str | None]:
    """Return the bones, and their unit if it is told."""
    try:
        content = json.loads(data)
        bones, unit = content["bones"], unit_name(str(content.get("unit")))
        names = [str(bone["name"]) for bone in bones]
        rows = {name: row for row, name in enumerate(names)}
        parents = [-1 if (up := bone["parent"]) is None else up if type(up) is int else rows[up]
                   for bone in bones]  # fmt: skip
        ends = [np.array([bone[end] for bone in bones], np.float64) for end in ("head", "tail")]
    except (ValueError, KeyError, TypeError) as error:
        raise InvalidShapeError(
            "it is no armature: expected JSON with a list bones, each with name, parent, head and "
            f"tail ({type(error).__name__}: {error})."
        ) from None
    return Armature(ends[0], ends[1], np.array(parents, np.int32), tuple(names)), unit


def _of_gltf(data: bytes) -> Armature:
    """Joints of all skins, in the places of their nodes."""
    if data[:4] == b"glTF":
        (length,) = struct.unpack_from("<I", data, 12)
        data = data[20 : 20 + length]
    content = json.loads(data)
    nodes = content.get("nodes", [])
    joints = sorted({joint for skin in content.get("skins", []) for joint in skin["joints"]})
    if not joints:
        raise InvalidShapeError("it has no skin, so no bones.")
    if len(joints) > LARGEST:
        raise InvalidShapeError(f"it has {len(joints):,} bones; at most {LARGEST:,} are read.")
    above = {child: up for up, node in enumerate(nodes) for child in node.get("children", ())}
    rows = {joint: row for row, joint in enumerate(joints)}
    parents = []
    for joint in joints:
        up, steps = above.get(joint, -1), 0
        while up >= 0 and up not in rows and steps < len(nodes):
            up, steps = above.get(up, -1), steps + 1
        parents.append(rows.get(up, -1))
    ends = []  # of each joint, nodes without a mesh that hang on it
    for joint in joints:
        hung = [n for n in nodes[joint].get("children", ()) if n in rows or "mesh" not in nodes[n]]
        ends.append([_place_of(n, nodes, above)[:3, 3] for n in hung])
    names = _different([str(nodes[joint].get("name", "")) for joint in joints])
    places = np.array([_place_of(joint, nodes, above) for joint in joints], np.float64)
    heads, ways = places[:, :3, 3], _ways_along(places, ends)
    tails = _tails(heads, parents, ends)
    if ways is not None:
        tails = _turned(tails, heads, ways, ends)
    return Armature(heads, tails, np.array(parents, np.int32), names)


def _ways_along(places: FloatArray, ends: list[list[FloatArray]]) -> FloatArray | None:
    """Return the direction of each bone, (b, 3): the local axis that most bones of a rig follow.

    In most rigs one local axis of a joint (y in Blender and Mixamo, x in Unreal) points to its
    child. Return None if no axis does so for most joints with a single child.
    """
    axes = unit_rows(np.concatenate([places[:, :3, :3], -places[:, :3, :3]], axis=2).swapaxes(1, 2))
    single = [row for row, hung in enumerate(ends) if len(hung) == 1]
    if not single:
        return None
    ways = unit_rows(np.array([ends[row][0] for row in single]) - places[single, :3, 3])
    fits = (np.einsum("sax,sx->sa", axes[single], ways) > ALONG).mean(axis=0)
    best = int(fits.argmax())
    return axes[:, best] if fits[best] > 0.5 else None


def _turned(
    tails: FloatArray, heads: FloatArray, ways: FloatArray, ends: list[list[FloatArray]]
) -> FloatArray:
    """Return tails, (b, 3), turned to the given directions of the bones.

    A bone ends at the child that is on its direction; if no child is, at their mean distance. A
    bone without children keeps its length.
    """
    tails = np.array(tails)
    for row, hung in enumerate(ends):
        off = np.array(hung).reshape(-1, 3) - heads[row]
        along = off @ ways[row]
        aligned = along - ALONG * np.linalg.norm(off, axis=1)
        if (aligned > 0).any():
            tails[row] = hung[int(aligned.argmax())]
        elif not hung or along.mean() > 0:
            far = along.mean() if hung else np.linalg.norm(tails[row] - heads[row])
            tails[row] = heads[row] + far * ways[row]
    return tails


def _place_of(node: int, nodes: list[Any], above: dict[int, int]) -> FloatArray:
    """Return where a node of glTF stands in the scene, (4, 4)."""
    place = np.eye(4)
    for _ in range(len(nodes)):
        place = _own_place(nodes[node]) @ place
        if node not in above:
            return place
        node = above[node]
    raise InvalidShapeError("its nodes run in a circle.")


def _own_place(node: dict[str, Any]) -> FloatArray:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    place = np.eye(4)
    place[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    place[:3, :3] *= node.get("scale", (1.0, 1.0, 1.0))
    place[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return place


def _different(names: list[str]) -> tuple[str, ...]:
    """Return names of which no two are the same, and none is empty."""
    taken: dict[str, int] = {}
    found = []
    for row, name in enumerate(names):
        own = name or f"bone {row:03d}"
        while own in taken:
            taken[own] += 1
            own = f"{own}.{taken[own]:03d}"
        taken[own] = 0
        found.append(own)
    return tuple(found)


def _tails(heads: FloatArray, parents: list[int], ends: list[list[FloatArray]]) -> FloatArray:
    """Return where bones end: in the middle of what hangs on them; the last half as long again."""
    tails = np.array(heads)
    for row, hung in enumerate(ends):
        if hung:
            tails[row] = np.mean(hung, axis=0)
        elif parents[row] >= 0:
            tails[row] = heads[row] + 0.5 * (heads[row] - heads[parents[row]])
    return tails


def _of_bvh(data: bytes) -> Armature:
    """Joints of the hierarchy, as they are without a motion."""
    words = data.decode("utf-8", "replace").split("MOTION")[0].split()
    names: list[str] = []
    heads: list[FloatArray] = []
    parents: list[int] = []
    ends: list[list[FloatArray]] = []
    open_joints: list[int] = []
    at, joint = 0, -1
    while at < len(words):
        word = words[at].upper()
        if word in ("ROOT", "JOINT"):
            if len(names) == LARGEST:
                raise InvalidShapeError(f"it has more than {LARGEST:,} bones.")
            begin = at + 1
            while words[at + 1] != "{":
                at += 1
            names.append(" ".join(words[begin : at + 1]))
            parents.append(open_joints[-1] if open_joints else -1)
            ends.append([])
            joint = len(names) - 1
        elif word == "END":
            joint = -1
        elif word == "{":
            open_joints.append(joint)
        elif word == "}":
            open_joints.pop()
        elif word == "OFFSET":
            offset = np.array(words[at + 1 : at + 4], np.float64)
            above = next((row for row in reversed(open_joints[:-1]) if row >= 0), -1)
            place = offset + (heads[above] if above >= 0 else 0.0)
            if above >= 0:
                ends[above].append(place)
            if open_joints[-1] >= 0:
                heads.append(place)
            at += 3
        at += 1
    if not names or len(heads) != len(names):
        raise InvalidShapeError("it has no ROOT with an OFFSET for each joint, so no bones.")
    places = np.array(heads)
    return Armature(
        places, _tails(places, parents, ends), np.array(parents, np.int32), _different(names)
    )


def write_bvh(path: str | os.PathLike[str], armature: Any) -> None:
    """Write bones as the rest pose of a BVH file, of one frame; blanks in names become "_".

    Parameters
    ----------
    path : path
        Replaced when it is there.
    armature : Armature or Bones

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    children: dict[int, list[int]] = {}
    for bone, up in enumerate(armature.parents.tolist()):
        children.setdefault(up, []).append(bone)
    lines, channels = ["HIERARCHY"], 0
    waiting = [(root, 0, True) for root in reversed(children[-1])]
    while waiting:
        bone, depth, opens = waiting.pop()
        indent = "\t" * depth
        if not opens:
            lines.append(indent + "}")
            continue
        up = int(armature.parents[bone])
        kind = "JOINT" if up >= 0 else "ROOT"
        offset = armature.heads[bone] - (armature.heads[up] if up >= 0 else 0.0)
        turns = "Zrotation Xrotation Yrotation"
        given = f"3 {turns}" if up >= 0 else f"6 Xposition Yposition Zposition {turns}"
        channels += int(given[0])
        lines += [
            f"{indent}{kind} {'_'.join(armature.names[bone].split())}",
            indent + "{",
            f"{indent}\tOFFSET {_numbers(offset)}",
            f"{indent}\tCHANNELS {given}",
        ]
        waiting.append((bone, depth, False))
        hung = children.get(bone, [])
        waiting += [(child, depth + 1, True) for child in reversed(hung)]
        if not hung:
            tip = _numbers(armature.tails[bone] - armature.heads[bone])
            lines += [f"{indent}\tEnd Site", indent + "\t{", f"{indent}\t\tOFFSET {tip}",
                      indent + "\t}"]  # fmt: skip
    lines += ["MOTION", "Frames: 1", "Frame Time: 0.0333333", " ".join(["0"] * channels)]
    with complete_file(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode())


def _numbers(offset: FloatArray) -> str:
    return " ".join(f"{x:.9g}" for x in offset.tolist())


def write_armature_json(path: str | os.PathLike[str], armature: Any, unit: str | None) -> None:
    """Write bones as `read_armature` reads them: names, parents, heads, tails, lengths, the unit.

    Parameters
    ----------
    path : path
        Replaced when it is there.
    armature : Armature or Bones
    unit : str or None
        What one unit of the joints is.

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    names = armature.names
    lengths = np.linalg.norm(armature.tails - armature.heads, axis=1)
    bones = [
        {"name": name, "parent": names[up] if up >= 0 else None, "head": head, "tail": tail,
         "length": far}
        for name, up, head, tail, far in zip(
            names, armature.parents.tolist(), armature.heads.tolist(), armature.tails.tolist(),
            lengths.tolist(), strict=True,
        )
    ]  # fmt: skip
    text = json.dumps({"format": "medialis armature", "version": 1, "unit": unit, "bones": bones})
    with complete_file(path) as stream:
        stream.write(text.encode() + b"\n")
