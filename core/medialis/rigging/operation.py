"""Operation: bones along the curve skeleton of a mesh, and skin weights; its files.

A shape with its bones and skin weights is written as binary glTF (GLB), for animation programs. A
joint is a node whose y axis runs along its bone, at the head. Lengths are metres, the unit of glTF,
where the unit of the shape is known. glTF keeps single precision: a shape far from the origin is
stored around its middle, and moved there by its nodes.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import unit_rows
from medialis.base.options import METERS, changed, choice, flag
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.from_balls import CurveSkeletonOptions
from medialis.curves.operation import described, graph_formats, json_content
from medialis.formats.files import complete_file
from medialis.formats.gltf import TRIANGLES, UP_TO_Y, VERTICES, Buffer, middle_of
from medialis.operations.declaration import Format, Operation
from medialis.operations.positions import numbers, place, places
from medialis.operations.result import Layer, Outcome, Result
from medialis.rigging.armature import Armature
from medialis.rigging.bones import (
    Bones,
    BonesOptions,
    SkinOptions,
    SkinWeights,
    bones,
    skin_weights,
)
from medialis.rigging.figure_bones import figure_bones
from medialis.rigging.naming import roll_axes, rolls, target_names
from medialis.rigging.pieces import carried_weights
from medialis.rigging.poses import tried
from medialis.shape.shape import Shape
from medialis.shape.surface import Surface
from medialis.shape.union import United, held_pieces, unite
from medialis.skeleton.preparation import InvariantPreparation

BY_BONE: dict[str, Any] = {"color_by": "bone", "labels": ("bone",)}
"""How layers are shown."""

MAX_TRIALS = 2
"""Maximum number of pieces that are left out in turn where the bones are no figure's."""

POSES: bool = flag(
    False,
    "Test poses",
    "Bend the rig at each main joint, draw that (test_poses.png), and tell where the surface "
    "stretches or collapses.",
)
"""The option of `armature` and `bind`."""


@dataclass(frozen=True, kw_only=True)
class ArmatureRun(InvariantPreparation):
    """Options of the operation `armature`."""

    threshold: float = changed(CurveSkeletonOptions, "threshold")
    bend: float = changed(BonesOptions, "bend")
    bone_length: float = changed(BonesOptions, "bone_length")
    blend: float = changed(BonesOptions, "blend")
    shortest: float = changed(BonesOptions, "shortest")
    skin_smoothing: float = changed(SkinOptions, "skin_smoothing")
    smoothing: float = changed(CurveSkeletonOptions, "smoothing")
    candidates: float = changed(CurveSkeletonOptions, "candidates")
    figures: bool = flag(
        True,
        "Figures",
        "Give bipeds and quadrupeds the bones of their kind, with joints where bodies bend. What "
        "is not clearly one gets bones by its shape alone, as everything does without this.",
    )
    naming: str = choice(
        "plain",
        "Names",
        "What the bones of figures are called. All other bones are numbered.",
        {
            "plain": "Names as people say them: hips, thigh.L, upper_arm.R.",
            "rigify": "Names of Rigify's figures: spine, thigh.L, upper_arm.R.",
            "mixamo": "Names of Mixamo's figures: mixamorig:Hips, mixamorig:LeftUpLeg.",
            "unreal": "Names of Unreal's mannequin: pelvis, thigh_l, upperarm_r.",
            "vrm": "Names of VRM's humanoid bones: hips, leftUpperLeg, rightUpperArm.",
            "numbers": "Bones are numbered: bone 000, bone 001, mirrored ones with .L and .R.",
        },
    )
    poses: bool = POSES

    def with_auto_resolved(self, data: Any, progress: Progress) -> Self:
        """Replace "auto" by numbers for the united surface, on which the rest is computed."""
        if isinstance(data, Shape) and data.faces is not None:
            data = unite(data, progress, joined=True).shape
        return super().with_auto_resolved(data, progress)


def run(shape: Shape, options: ArmatureRun, progress: Progress) -> Outcome:
    """Unite the pieces, find the curve skeleton, lay bones along it, compute the weights."""
    with progress.stage("pieces", 0.0, 0.1):
        union = unite(shape, progress, joined=True)
    with progress.stage("curve", 0.1, 0.9):
        union, curve, rig = laid_bones(shape, union, options, progress)
    one_piece = union.shape is shape
    with progress.stage("weights", 0.9, 1.0):
        whole = skin_weights.of(rig, options, progress)
    n = union.shape.point_count  # a refined shape has the given points first
    skin = replace(whole, bones=whole.bones[:n], weights=whole.weights[:n], rig=rig)
    if not one_piece:
        skin = run_patiently(lambda: carried_weights(skin, union, shape), progress)
    if rig.cut:
        text = (
            f"An armature has no loops: {rig.cut} of the curve skeleton were cut, each where both "
            "paths round it from the root are equally long."
        )
        progress.note(text, "loops_cut", loops=rig.cut)
    if len(rig.roots) > 1:
        text = (
            f"The shape has {len(rig.roots)} separate parts that enclose no volume: they were not "
            "united, and each has a root bone."
        )
        progress.warn(text, "root_bones", roots=len(rig.roots))
    poses, panels = test_poses_of(shape, skin, options.poses, progress)
    return Outcome(
        shape=(curve.surface or shape) if one_piece else shape,
        layers=(bones_layer(rig), _skin_layer(shape, skin)),
        values={
            "bones": rig.count,
            "kind": rig.kind or None,
            "limbs": int(rig.limbs.max()) + 1,
            "mirrored": int((rig.mirrors >= 0).sum()),
            "roots": len(rig.roots),
            "cut_loops": rig.cut,
            "diagonal": shape.diagonal,
            "bone_table": _bone_table(rig),
            **poses,
        },
        arrays={
            "heads": places(rig.heads),
            "tails": places(rig.tails),
            **{name: getattr(rig, name) for name in ("parents", "limbs", "mirrors")},
            "skin_bones": skin.bones,
            "skin_weights": numbers(skin.weights),
            "nodes": places(curve.nodes),
            "edges": curve.edges,
        },
        extras={"graph": curve, "bones": rig, "skin": skin},
        panels=panels,
    )


def laid_bones(
    shape: Shape, union: United, options: ArmatureRun, progress: Progress
) -> tuple[United, CurveSkeleton, Bones]:
    """Return the bones along the curve skeleton of united pieces, and what they were united to.

    Where they are no figure's, up to `MAX_TRIALS` pieces that may be held or worn are left out in
    turn: a sword would be a limb.
    """
    before = len(progress.messages)
    if union.shape is not shape:
        note_pieces(union, progress)
    curve, _ = described(union.shape, options, progress)
    rig = named_bones(curve, shape.up, options, progress)
    if rig.kind or not options.figures or union.shape is shape:
        return union, curve, rig
    for piece in held_pieces(union, shape)[:MAX_TRIALS]:
        trial = progress.still
        less = unite(shape, trial, joined=True, without=piece)
        note_pieces(less, trial)
        other, _ = described(less.shape, options, trial)
        found = named_bones(other, shape.up, options, trial)
        if found.kind:
            del progress.messages[before:]
            progress.messages += trial.messages
            return less, other, found
    return union, curve, rig


def note_pieces(union: United, progress: Progress) -> None:
    """Report how many pieces of a shape were united, bridged, and left loose."""
    loose, bridges = int(union.loose.sum()), len(union.bridges)
    count = union.piece_count - loose
    if count > 1:
        text = f"{counted(count, 'piece')} were united into one surface."
        progress.note(text, "pieces_united", pieces=count)
    if bridges:
        text = f"{counted(bridges, 'bridge', verbs=('was', 'were'))} added between pieces apart."
        progress.note(text, "pieces_bridged", bridges=bridges)
    if loose:
        text = f"{counted(loose, 'loose piece', verbs=('follows', 'follow'))} the nearest skin."
        progress.note(text, "pieces_attached", pieces=loose)


def test_poses_of(
    shape: Shape, skin: SkinWeights, wanted: bool, progress: Progress
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the values of test poses, and the panels of their picture; nothing if not wanted."""
    if not wanted:
        return {}, {}
    rows, panels = run_patiently(lambda: tried(shape, skin, progress), progress)
    return {"test_poses": rows}, {"test_poses": panels} if panels else {}


def named_bones(
    curve: CurveSkeleton, up: str | None, options: ArmatureRun, progress: Progress
) -> Bones:
    """Lay the bones of a figure along a curve skeleton, or bones by its shape alone."""
    rig = _figure(curve, up, options, progress) or bones.of(curve, options, progress)
    if not rig.kind:
        return rig
    names = () if options.naming == "numbers" else target_names(rig, options.naming)
    return replace(rig, given_names=names)


def _figure(
    curve: CurveSkeleton, up: str | None, options: ArmatureRun, progress: Progress
) -> Bones | None:
    """Return the bones of a figure, and say what is not sure; None where there is none."""
    if not options.figures:
        return None
    rig, doubt = run_patiently(lambda: figure_bones(curve, options.blend, up), progress)
    if rig is not None:
        progress.note(f"The bones are those of a {rig.kind}.", "figure", kind=rig.kind)
        if options.naming == "vrm" and rig.kind == "quadruped":
            text = "VRM has no names for quadrupeds: the bones have plain ones."
            progress.note(text, "no_target_names", target="vrm")
    elif doubt:
        progress.note(f"{doubt} The bones are numbered.", "figure_unsure")
    elif options.naming not in ("plain", "numbers"):
        text = "The shape is not clearly a biped or quadruped: the bones are numbered."
        progress.note(text, "no_figure")
    return rig


def bones_layer(rig: Bones | Armature) -> Layer:
    """Layer of one edge a bone."""
    rows = np.arange(2 * rig.count, dtype=np.int32).reshape(-1, 2)
    attributes: dict[str, Any] = {
        "bone": np.repeat(np.arange(rig.count, dtype=np.int32), 2),
        "parent": np.repeat(rig.parents, 2),
    }
    if isinstance(rig, Bones):
        radii = np.stack([rig.head_radii, rig.tail_radii], axis=1).ravel()
        sides = {"limb": np.repeat(rig.limbs, 2), "side": np.repeat(rig.sides, 2)}
        attributes = {"radius": radii, **attributes, **sides}
    ends = np.stack([rig.heads, rig.tails], axis=1).reshape(-1, 3)
    return Layer("armature", ends, edges=rows, attributes=attributes, role="bones", **BY_BONE)


def _skin_layer(shape: Shape, skin: SkinWeights) -> Layer:
    """Layer of the surface with the bone that moves each point most, and its weight."""
    fields: dict[str, Any] = {"bone": skin.bones[:, 0], "weight": skin.weights[:, 0]}
    shown: dict[str, Any] = {"on_input": True, "role": "skin", **BY_BONE}
    return Layer("skin", shape.points, shape.faces, attributes=fields, **shown)


def _bone_table(rig: Bones) -> list[dict[str, Any]]:
    """Return name, parent, head, tail, length and roll (radians) of each bone, and more."""
    connected, turns = rig.connected, rolls(rig)
    lengths = np.linalg.norm(rig.tails - rig.heads, axis=1)
    return [
        {
            "name": name,
            "parent": int(rig.parents[bone]),
            "limb": int(rig.limbs[bone]),
            "mirror": int(rig.mirrors[bone]),
            "head": place(rig.heads[bone]),
            "tail": place(rig.tails[bone]),
            "length": float(lengths[bone]),
            "roll": float(turns[bone]),
            "connected": bool(connected[bone]),
        }
        for bone, name in enumerate(rig.names)
    ]


def write_rigged_gltf(
    path: str | os.PathLike[str],
    surface: Surface,
    normals: ArrayLike,
    skin: SkinWeights,
    *,
    unit: str | None = None,
    up: str | None = None,
) -> None:
    """Write a mesh with its bones and weights as GLB.

    Parameters
    ----------
    path : path
        Replaced when it is there.
    surface : Surface
        A mesh of n vertices.
    normals : (n, 3) float
    skin : SkinWeights
        Of its vertices, with its bones.
    unit : str, optional
        What one unit of the points is; metres when unknown.
    up : {"x", "y", "z"}, optional
        The axis that points up: the nodes at the top turn it to y, which is up in glTF.

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    rig = skin.rig
    assert rig is not None and surface.faces is not None
    scale = METERS[unit] if unit else 1.0
    middle = middle_of(surface)
    frames = bone_frames(rig)
    frames[:, :3, 3] = scale * (frames[:, :3, 3] - middle)
    points = (scale * (surface.points - middle)).astype(np.float32)
    store = Buffer()
    attributes = {
        "POSITION": store.add(points, VERTICES, limits=True),
        "NORMAL": store.add(_directions(normals), VERTICES),
    }
    joints, weights = _influences(skin)
    for number, first in enumerate(range(0, joints.shape[1], 4)):
        attributes[f"JOINTS_{number}"] = store.add(joints[:, first : first + 4], VERTICES)
        attributes[f"WEIGHTS_{number}"] = store.add(weights[:, first : first + 4], VERTICES)
    indices = store.add(surface.faces.astype(np.uint32).ravel(), TRIANGLES)
    inverse = np.linalg.inv(frames).transpose(0, 2, 1).astype(np.float32)  # columns come first
    inverse[:, :, 3] = [0, 0, 0, 1]
    turn, rotation = UP_TO_Y[up or "y"]
    place = {"translation": (turn @ (scale * middle)).tolist()} if middle.any() else {}
    if rotation:
        place["rotation"] = rotation
    nodes, children = _nodes(rig, frames, scale)
    top, mesh = len(nodes), len(nodes) + 1
    nodes.append({"name": "armature", **place, "children": children})
    nodes.append({"name": "skin", **place, "mesh": 0, "skin": 0})
    bound = {"joints": list(range(rig.count)), "skeleton": top}
    bound["inverseBindMatrices"] = store.add(inverse)
    store.write(path, {
        "scene": 0,
        "scenes": [{"nodes": [top, mesh]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
        "skins": [bound],
    })  # fmt: skip


def bone_frames(rig: Bones | Armature) -> FloatArray:
    """Return the place of each bone: its head, and axes of which y runs along it, (b, 4, 4)."""
    y = unit_rows(rig.tails - rig.heads, instead=[0.0, 1.0, 0.0])
    z = roll_axes(rig) if isinstance(rig, Bones) else np.zeros_like(y)
    # A bone without a length has no such axis: the one that is farthest from it makes it definite.
    least = np.eye(3)[np.abs(y).argmin(axis=1)]
    z = unit_rows(z - (z * y).sum(axis=1)[:, None] * y, 1e-9, unit_rows(np.cross(least, y)))
    frames = np.tile(np.eye(4), (rig.count, 1, 1))
    frames[:, :3, 0], frames[:, :3, 1], frames[:, :3, 2] = np.cross(y, z), y, z
    frames[:, :3, 3] = rig.heads
    return frames


def _nodes(
    rig: Bones | Armature, frames: FloatArray, scale: float
) -> tuple[list[dict[str, Any]], list[int]]:
    """Return the node of each bone, then one at each end, and the numbers of the roots."""
    own = [np.eye(4) if parent < 0 else frames[parent] for parent in rig.parents.tolist()]
    local = np.linalg.inv(np.array(own)) @ frames
    nodes: list[dict[str, Any]] = [
        {"name": name, "translation": place[:3, 3].tolist(), "rotation": _quaternion(place[:3, :3])}
        for name, place in zip(rig.names, local, strict=True)
    ]
    children: dict[int, list[int]] = {}
    for bone, parent in enumerate(rig.parents.tolist()):
        children.setdefault(parent, []).append(bone)
    lengths = scale * np.linalg.norm(rig.tails - rig.heads, axis=1)
    for bone in range(rig.count):
        if bone not in children:  # without it nobody knows where the last bone ends
            children[bone] = [len(nodes)]
            tip = [0.0, float(lengths[bone]), 0.0]
            nodes.append({"name": f"{rig.names[bone]} end", "translation": tip})
        nodes[bone]["children"] = children[bone]
    return nodes, children.get(-1, [])


def _quaternion(turn: FloatArray) -> list[float]:
    """Return a rotation as (x, y, z, w): the eigenvector of Bar-Itzhack's symmetric matrix."""
    (a, b, c), (d, e, f), (g, h, i) = turn
    matrix = np.array([
        [a - e - i, b + d, c + g, h - f],
        [b + d, e - a - i, f + h, c - g],
        [c + g, f + h, i - a - e, d - b],
        [h - f, c - g, d - b, a + e + i],
    ])  # fmt: skip
    return [float(x) for x in np.linalg.eigh(matrix)[1][:, -1]]


def _influences(skin: SkinWeights) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """Return joints and weights as glTF wants them: in fours, sums of 1, joint 0 for none."""
    room = ((0, 0), (0, -skin.bones.shape[1] % 4))
    bones = np.pad(skin.bones, room, constant_values=-1)
    weights = np.where(bones >= 0, np.pad(skin.weights, room), 0.0)
    weights[weights.sum(axis=1) <= 0.0, 0] = 1.0
    weights /= weights.sum(axis=1, keepdims=True)
    joints = np.where(weights > 0, bones, 0).clip(min=0)
    kind = np.uint8 if joints.max(initial=0) < 256 else np.uint16
    return joints.astype(kind), weights.astype(np.float32)


def _directions(normals: ArrayLike) -> NDArray[np.float32]:
    """Return unit normals; glTF has no word for a missing one, which points up."""
    found = np.array(normals, np.float64)
    found[np.linalg.norm(found, axis=1) < 0.5] = [0.0, 0.0, 1.0]
    return found.astype(np.float32)


def _write_rig(path: Path, result: Result) -> None:
    """Write the given shape with the bones of a result."""
    skin = result.extras["skin"]
    count = len(skin.bones)  # a refined shape has the given points first
    given = next(layer for layer in result.layers if layer.role == "skin")
    surface, normals = Surface.of_checked(given.points, given.faces), result.shape.normals[:count]
    shape = result.shape
    write_rigged_gltf(path, surface, normals, skin, unit=shape.unit, up=shape.up)


def _write_bones(path: Path, result: Result) -> None:
    """Write the graph of the bones as JSON, and with it the bones themselves."""
    rig, shape = result.extras["bones"], result.shape
    told = {"kind": rig.kind or None, "up": shape.up, "bones": result.values["bone_table"]}
    content = json_content(rig.graph, shape.unit) | told
    with complete_file(path) as stream:
        stream.write((json.dumps(content, allow_nan=False) + "\n").encode("ascii"))


RIGGED = Format("glb", _write_rig, "skin", unasked=True)

RIG_FORMATS = (
    *(
        replace(kind, write=_write_bones) if kind.name == "json" else kind
        for kind in graph_formats(lambda result: result.extras["bones"].graph)
    ),
    RIGGED,
)
"""The graph is the one that the bones lie along: its loops are cut."""

OPERATION = Operation(
    name="armature",
    filter_name="generate_armature",
    label="Armature",
    group="Skeleton",
    help="Lay bones along the curve skeleton of a mesh, and compute skin weights.\n\n"
    "The root is at the thickest junction. Joints are where limbs bend or change their thickness; "
    "limbs that mirror each other have bones of the same names, with .L and .R. Loops are cut. "
    "Each point of the surface has at most four bones, with weights that sum to 1 and stay on "
    "their own limb. Pieces that overlap or touch are united, and pieces apart are bridged; small "
    "loose pieces and clothes follow the nearest skin. Needs a mesh.",
    source=None,
    examples=(("creature.ply", "bones and skin weights; armature.glb opens in other programs"),),
    layers={
        "armature": "one line for each bone",
        "skin": "the surface with the bone that moves each vertex most",
    },
    options=ArmatureRun,
    run=run,
    needs_faces=True,
    formats=RIG_FORMATS,
    thin_lines=True,
    order=90,
    words=("bones", "rig", "skin weights"),
)
