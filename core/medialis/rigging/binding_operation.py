"""Operation: weights with which the bones of any armature move a mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.options import file
from medialis.base.progress import Progress
from medialis.operations.declaration import Format, Operation
from medialis.operations.positions import numbers, places
from medialis.operations.result import Layer, Outcome
from medialis.rigging.armature import Armature, read_armature, write_armature_json, write_bvh
from medialis.rigging.binding import BindOptions, Weighing, bind_weights
from medialis.rigging.bones import Bones
from medialis.rigging.operation import (
    BY_BONE,
    POSES,
    RIGGED,
    ArmatureRun,
    bones_layer,
    laid_bones,
    test_poses_of,
)
from medialis.shape.shape import Shape
from medialis.shape.union import unite


@dataclass(frozen=True, kw_only=True)
class BindRun(Weighing):
    """Options of the operation `bind`."""

    armature: str = file(
        "Armature",
        "File with the bones: glTF with a skin, BVH, or JSON of medialis. Without one, the bones "
        "are those of the operation armature.",
        bones=True,
    )
    poses: bool = POSES


def run(shape: Shape, options: BindRun, progress: Progress) -> Outcome:
    """Read the bones, and weigh them."""
    with progress.stage("bones", 0.0, 0.4):
        rig = _bones(shape, options.armature, progress)
    with progress.stage("weights", 0.4, 1.0):
        weighing = BindOptions.taken_from(options, armature=rig)
        skin = replace(bind_weights.of(shape, weighing, progress), rig=rig)
    moving = np.isin(np.arange(rig.count), skin.bones)
    if not moving.all():
        idle = [name for name, moves in zip(rig.names, moving, strict=True) if not moves]
        shown = ", ".join(idle[:3]) + (", ..." if len(idle) > 3 else "")
        text = f"{len(idle)} of {rig.count} bones move nothing: {shown}."
        progress.note(text, "idle_bones", bones=len(idle), of=rig.count)
    fields: dict[str, Any] = {"bone": skin.bones[:, 0], "weight": skin.weights[:, 0]}
    own = not options.armature
    poses, panels = test_poses_of(shape, skin, options.poses, progress)
    return Outcome(
        shape=shape,
        layers=(
            Layer("bound_skin", shape.points, shape.faces, attributes=fields, on_input=True,
                  role="skin", **BY_BONE),
            replace(bones_layer(rig), name="bound_bones", role="bones" if own else "hidden",
                    auxiliary=not own),
        ),
        values={
            "bones": rig.count,
            "vertices": shape.point_count,
            "moving_bones": int(moving.sum()),
            "diagonal": shape.diagonal,
            "bone_names": list(rig.names),
            **poses,
        },
        arrays={
            "heads": places(rig.heads),
            "tails": places(rig.tails),
            "parents": rig.parents,
            "skin_bones": skin.bones,
            "skin_weights": numbers(skin.weights),
        },
        extras={"bones": rig, "skin": skin},
        panels=panels,
    )  # fmt: skip


def _bones(shape: Shape, path: str, progress: Progress) -> Bones | Armature:
    """Read the bones of a file, or lay them along the curve skeleton."""
    if path:
        found = read_armature(path, unit=shape.unit, up=shape.up)
        ends = found.heads - shape.offset, found.tails - shape.offset
        return replace(found, heads=ends[0], tails=ends[1])
    options = ArmatureRun()
    return laid_bones(shape, unite(shape, progress, joined=True), options, progress)[2]


OPERATION = Operation(
    name="bind",
    filter_name="compute_scalar_by_medial_bind",
    label="Bind to armature",
    group="Skeleton",
    help="Compute the weights with which the bones of an armature move a mesh.\n\n"
    "The nearest bone is the one with the shortest way inside the body. The mesh may have holes, "
    "several pieces, inner faces, or no inside: no vertex is left without a bone. Weights are "
    "smooth and sum to 1. A piece that no bone runs through follows the nearest skin; a small "
    "piece moves as a whole. End markers move nothing.",
    source=None,
    examples=(("creature.ply", "weights of its own bones; bind.glb opens in other programs"),),
    layers={
        "bound_skin": "the surface with the bone that moves each vertex most",
        "bound_bones": "one line for each bone",
    },
    options=BindRun,
    run=run,
    needs_faces=True,
    thin_lines=True,
    formats=(
        RIGGED,
        Format("json", lambda path, result: write_armature_json(
            path, result.extras["bones"], result.shape.unit), "bones"),
        Format("bvh", lambda path, result: write_bvh(path, result.extras["bones"]), "bones"),
    ),
    order=91,
    words=("skin weights", "automatic weights", "bone heat", "parent"),
)  # fmt: skip
