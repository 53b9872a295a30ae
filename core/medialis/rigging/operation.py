"""Operation: bones along the curve skeleton of a mesh, and skin weights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.options import changed, choice
from medialis.base.progress import Progress
from medialis.curves.from_balls.skeleton import CurveSkeletonOptions
from medialis.curves.operation import described
from medialis.operations.declaration import Operation
from medialis.operations.positions import numbers, place, places
from medialis.operations.result import Layer, Outcome
from medialis.rigging.bones import Bones, BonesOptions, SkinWeights, bones
from medialis.rigging.formats import RIG_FORMATS
from medialis.rigging.naming import NAMINGS
from medialis.rigging.skinning import SkinOptions, skin_weights
from medialis.shape.shape import Shape
from medialis.skeleton.surface_skeleton import Preparation


@dataclass(frozen=True, kw_only=True)
class ArmatureRun(Preparation):
    """Options of the operation `armature`."""

    threshold: float = changed(CurveSkeletonOptions, "threshold")
    bend: float = changed(BonesOptions, "bend")
    bone_length: float = changed(BonesOptions, "bone_length")
    blend: float = changed(BonesOptions, "blend")
    shortest: float = changed(BonesOptions, "shortest")
    skin_smoothing: float = changed(SkinOptions, "skin_smoothing")
    smoothing: float = changed(CurveSkeletonOptions, "smoothing")
    candidates: float = changed(CurveSkeletonOptions, "candidates")
    naming: str = choice(
        "numbers",
        "Names",
        "Bones are numbered, or have names as Rigify's figures do (spine, thigh.L, upper_arm.R) or "
        "Mixamo's (mixamorig:Hips, mixamorig:LeftUpLeg). Up is z.",
        ("numbers", *NAMINGS),
    )


def run(shape: Shape, options: ArmatureRun, progress: Progress) -> Outcome:
    """Find the curve skeleton, lay bones along it, compute the weights."""
    with progress.stage("curve", 0.0, 0.9):
        curve, _ = described(shape, options, progress)
    with progress.stage("weights", 0.9, 1.0):
        rig = bones.of(curve, options, progress)
        whole = skin_weights.of(rig, options, progress)
    if options.naming != "numbers":
        rig = replace(rig, given_names=NAMINGS[options.naming](rig))
    n = shape.point_count  # a refined shape has the given points first
    skin = replace(whole, bones=whole.bones[:n], weights=whole.weights[:n], rig=rig)
    if rig.cut:
        progress.note(
            f"An armature has no loops: {rig.cut} of the curve skeleton were cut, each where both "
            "paths round it from the root are equally long.",
            "loops_cut",
            loops=rig.cut,
        )
    if len(rig.roots) > 1:
        progress.note(
            f"The shape has {len(rig.roots)} separate parts: each has a root bone.",
            "root_bones",
            roots=len(rig.roots),
        )
    return Outcome(
        shape=curve.surface or shape,
        layers=(_bones_layer(rig), _skin_layer(shape, skin)),
        values={
            "bones": rig.count,
            "limbs": int(rig.limbs.max()) + 1,
            "mirrored": int((rig.mirrors >= 0).sum()),
            "roots": len(rig.roots),
            "cut_loops": rig.cut,
            "diagonal": shape.diagonal,
            "bone_table": _table(rig),
        },
        arrays={
            "heads": places(rig.heads),
            "tails": places(rig.tails),
            "parents": rig.parents,
            "limbs": rig.limbs,
            "mirrors": rig.mirrors,
            "skin_bones": skin.bones,
            "skin_weights": numbers(skin.weights),
            "nodes": places(curve.nodes),
            "edges": curve.edges,
        },
        extras={"graph": curve, "bones": rig, "skin": skin},
    )


def _bones_layer(rig: Bones) -> Layer:
    """Layer of one edge a bone."""
    rows = np.arange(2 * rig.count, dtype=np.int32).reshape(-1, 2)
    return Layer(
        "armature",
        np.stack([rig.heads, rig.tails], axis=1).reshape(-1, 3),
        edges=rows,
        attributes={
            "radius": np.stack([rig.head_radii, rig.tail_radii], axis=1).ravel(),
            "bone": np.repeat(np.arange(rig.count, dtype=np.int32), 2),
            "parent": np.repeat(rig.parents, 2),
            "limb": np.repeat(rig.limbs, 2),
            "side": np.repeat(rig.sides, 2),
        },
        color_by="bone",
        labels=("bone",),
        role="bones",
    )


def _skin_layer(shape: Shape, skin: SkinWeights) -> Layer:
    """Layer of the surface with the bone that moves each point most, and its weight."""
    return Layer(
        "skin",
        shape.points,
        shape.faces,
        attributes={"bone": skin.bones[:, 0], "weight": skin.weights[:, 0]},
        color_by="bone",
        labels=("bone",),
        on_input=True,
        role="skin",
    )


def _table(rig: Bones) -> list[dict[str, Any]]:
    connected = rig.connected
    return [
        {
            "name": name,
            "parent": int(rig.parents[bone]),
            "limb": int(rig.limbs[bone]),
            "mirror": int(rig.mirrors[bone]),
            "head": place(rig.heads[bone]),
            "tail": place(rig.tails[bone]),
            "connected": bool(connected[bone]),
        }
        for bone, name in enumerate(rig.names)
    ]


OPERATION = Operation(
    name="armature",
    filter_name="generate_armature",
    label="Armature",
    group="Skeleton",
    help="Lay bones along the curve skeleton of a mesh, and compute skin weights.\n\n"
    "The root is at the thickest junction. Joints are where limbs bend or change their thickness; "
    "limbs that mirror each other have bones of the same names, with .L and .R. Loops are cut. "
    "Each point of the surface has at most four bones, with weights that sum to 1 and stay on "
    "their own limb. Needs a mesh.",
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
)
