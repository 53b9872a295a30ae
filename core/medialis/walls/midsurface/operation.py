"""Operation: the midsurface of a solid of walls, for shell elements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.errors import InvalidShapeError
from medialis.base.options import changed
from medialis.base.progress import Progress, counted
from medialis.operations.declaration import Operation
from medialis.operations.positions import place, places
from medialis.operations.result import Layer, Outcome
from medialis.shape.shape import Shape
from medialis.skeleton.layers import summary
from medialis.skeleton.surface_skeleton import Preparation, surface_skeleton
from medialis.walls.midsurface.midsurface import Midsurface, MidsurfaceOptions, midsurface

COLUMNS = ("faces", "thickness", "face_thickness", "sheet", "weld_edges", "weld")
"""Arrays of a midsurface beside its points."""


@dataclass(frozen=True, kw_only=True)
class MidsurfaceRun(MidsurfaceOptions, Preparation):
    """Options of the operation `midsurface`."""

    refine: float = changed(
        Preparation,
        "refine",
        help="Split edges longer than this share of the size for the computation, so that flat "
        "faces get samples; flat faces stay the same. Faces that are narrower have no samples: "
        "their wall is seen from the other side, or with a smaller share. auto: 2 %, or more where "
        "that would make too many samples.",
    )


def run(shape: Shape, options: MidsurfaceRun, progress: Progress) -> Outcome:
    """Compute balls, sheets, their welds, and what is no wall."""
    with progress.stage("skeleton", 0.0, 0.4):
        cloud = surface_skeleton.of(shape, options, progress)
    with progress.stage("midsurface", 0.4, 1.0):
        # A length means the shape that was given; smooth refinement may bulge out of its box.
        edge = options.edge * shape.diagonal / cloud.surface.diagonal
        found = midsurface.of(cloud, replace(options, edge=min(edge, 0.5)), progress)
    if found.sheets == 0:
        raise InvalidShapeError(
            "The solid has no midsurface: no part of it is a wall of even thickness. Try a "
            "smaller refine, which sees narrower walls, or a smaller least angle."
        )
    _note_lumps(found, progress)
    return Outcome(
        shape=shape,
        layers=_layers(found),
        values=_values(found, shape),
        arrays={
            "midsurface_points": places(found.points),
            **{f"midsurface_{name}": getattr(found, name) for name in COLUMNS},
        },
    )


def _note_lumps(found: Midsurface, progress: Progress) -> None:
    if found.wall_share is None:
        progress.note(
            "The mesh is open: how much of its volume are walls was not measured.", "open_walls"
        )
    elif found.lumps:
        shares = ", ".join(f"{100 * lump.share:.1f} %" for lump in found.lumps[:5])
        more = ", ..." if len(found.lumps) > 5 else ""
        text = (
            f"{counted(len(found.lumps), 'solid lump', verbs=('has', 'have'))} no midsurface: "
            f"{shares}{more} of the volume. {100 * found.wall_share:.0f} % of it are walls."
        )
        progress.note(text, "lumps", lumps=len(found.lumps), wall_share=found.wall_share)


def _layers(found: Midsurface) -> tuple[Layer, ...]:
    sheets = Layer(
        "midsurface",
        found.points,
        found.faces,
        attributes={"thickness": found.thickness},
        face_attributes={"sheet": found.sheet, "face_thickness": found.face_thickness},
        color_by="thickness",
        labels=("sheet",),
        role="shape",
        formats=("obj", "glb"),
    )
    if found.welds == 0:
        return (sheets,)
    used, rows = np.unique(found.weld_edges, return_inverse=True)
    edges = rows.reshape(-1, 2).astype(np.int32)
    weld = np.zeros(len(used), np.int32)
    weld[edges] = found.weld[:, None]
    fields: dict[str, Any] = {"weld": weld, "thickness": found.thickness[used]}
    shown: dict[str, Any] = {"color_by": "weld", "labels": ("weld",), "role": "hidden"}
    points = found.points[used]
    return sheets, Layer("midsurface_welds", points, edges=edges, attributes=fields, **shown)


def _values(found: Midsurface, shape: Shape) -> dict[str, Any]:
    ends = found.points[found.weld_edges]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return {
        "sheets": found.sheets,
        "welds": found.welds,
        "area": float(found.areas.sum()),
        **summary(found.thickness, "thickness"),
        "weld_length": float(lengths.sum()),
        "wall_share": found.wall_share,
        "lumps": [{"share": lump.share, "position": place(lump.position)} for lump in found.lumps],
        "sheet_list": [found.of_sheet(number) for number in range(found.sheets)],
        "weld_list": [
            {"weld": number, "length": float(lengths[found.weld == number].sum())}
            for number in range(found.welds)
        ],
        "points": len(found.points),
        "faces": len(found.faces),
        "diagonal": shape.diagonal,
    }


OPERATION = Operation(
    name="midsurface",
    filter_name="generate_midsurface",
    label="Midsurface",
    group="Thickness",
    help="Compute the sheets in the middle of the walls of a solid, for shell elements.\n\n"
    "Sheets lie between opposite sides of walls, flat, tapered or curved. They go up to the rim of "
    "the part and are welded where they meet: there they have the same vertices. Each vertex has "
    "the thickness of its wall, and where the thickness steps another sheet begins. The triangles "
    "are even. What is no wall is told, with its share of the volume.",
    examples=(
        (
            "vase.ply --edge 3% -o sheets",
            "the middle of the wall of a vase, with coarser triangles",
        ),
    ),
    sample="vase",  # a creature has no walls
    layers={
        "midsurface": "the sheets, with the thickness of the wall at each vertex and the number of "
        "the sheet at each face",
        "midsurface_welds": "the curves at which sheets meet",
    },
    options=MidsurfaceRun,
    run=run,
    thin_lines=True,
    needs_faces=True,
    order=45,
    words=("mid-surface", "shells", "FEM"),
)
