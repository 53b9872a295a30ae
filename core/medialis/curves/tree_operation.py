"""Operation: cylinders of a tree from a mesh or a scan: quantitative structure models.

`tree_cylinders.csv` has the columns of TreeQSM's cylinders, by which rTwig knows it as one of its,
`tree_cylinders.branches.csv` those of its branches. Both programs count rows from 1 and take
lengths for metres.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import perpendicular
from medialis.base.options import METERS, file, flag, number
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.from_balls import CurveSkeletonOptions, curve_skeleton
from medialis.curves.scanned_tree import ScannedTree, scanned_tree
from medialis.curves.tree_cylinders import (
    TreeCylinders,
    lowest_thick_end,
    nearest_end,
    tree_cylinders,
)
from medialis.formats.files import write_lines
from medialis.operations.declaration import Format, Operation
from medialis.operations.positions import place
from medialis.operations.result import Layer, Outcome, Result
from medialis.shape.shape import Shape
from medialis.skeleton.layers import samples_layer, summary, vertices_in_file

LITRES = 1000.0
"""In a cubic metre."""

BREAST_HEIGHT = 1.3
"""Height in metres at which foresters measure the diameter of a trunk."""

MIN_MEASURED = 0.5
"""Minimum fraction of the length with a measured radius; a smaller one is reported in a warning.
Generated trees without leaves have 0.22 to 0.98 and lengths up to 14 % too short; trees with leaves
have 0.2 to 0.65 and lengths up to 78 % too long, although all points are explained."""

MIN_EXPLAINED = 0.95
"""Fraction of points near a cylinder below which a model may be incomplete."""

MAX_VOLUME_ERROR = 0.15
"""Maximum relative error of the volume of a scan; a larger one is reported in a warning."""

GUESS_ERROR = 1.0
"""Relative error of the volume above which it is reported as a guess."""

SIDES = 12
"""Sides of a cylinder in pictures."""


@dataclass(frozen=True, kw_only=True)
class TreeCylindersRun(CurveSkeletonOptions):
    """Options of the operation `tree_cylinders`."""

    root: str = file(
        "Root",
        "Text file with a vertex number, or the x y z of a point, near the end where the tree "
        "begins. Without it that is the lowest one of the thick ends.",
        selection="each",
    )
    cylinder_length: float = number(
        3.0,
        "Cylinder length",
        "Cylinders are about so many of their radii long.",
        low=0.5,
        high=100.0,
    )
    taper: bool = flag(
        False,
        "Taper",
        "Let radii never grow along a branch, nor from one to the next.",
    )

    def auto_values(
        self, data: Any, starts: Mapping[str, float], progress: Progress
    ) -> dict[str, float]:
        """Choose automatic lengths; none is needed for clouds, which have no curve skeleton."""
        if isinstance(data, Shape) and data.faces is None:
            return {}
        return super().auto_values(data, starts, progress)


def run(shape: Shape, options: TreeCylindersRun, progress: Progress) -> Outcome:
    """Model a cloud by its sections, a mesh by its curve skeleton."""
    picked = vertices_in_file(options.root, shape, "no tree begins there")
    root = shape.points[int(picked[0])] if len(picked) else None
    if shape.faces is None:
        return _of_cloud(shape, root, options, progress)
    return _of_mesh(shape, root, options, progress)


def _of_mesh(
    shape: Shape, picked: FloatArray | None, options: TreeCylindersRun, progress: Progress
) -> Outcome:
    """Find the curve skeleton, hang it from its root, cut it in cylinders and measure them."""
    with progress.stage("curve skeleton", 0.0, 0.9):
        graph = curve_skeleton.of(shape, options, progress)
    if picked is not None:
        root = nearest_end(graph, picked)
    else:
        root = lowest_thick_end(graph, "xyz".index(shape.up or "z"))
    tree = run_patiently(lambda: _tree(graph, root, options), progress)
    _note(graph, root, tree, progress)
    surface = graph.surface
    assert surface is not None
    return Outcome(
        shape=surface,
        layers=(_layer(tree), samples_layer(surface)),
        values=_values(tree, surface),
        extras={"cylinders": tree, "graph": graph},
        panels=_panels(tree, surface),
    )


def _of_cloud(
    shape: Shape, root: FloatArray | None, options: TreeCylindersRun, progress: Progress
) -> Outcome:
    """Fit cylinders to the points of a scan."""
    up = "xyz".index(shape.up or "z")
    model = run_patiently(
        lambda: scanned_tree(shape.points, up=up, root=root, length=options.cylinder_length),
        progress,
    )
    if model.on_ground:
        text = f"{counted(model.on_ground, 'point')} of the ground were left out."
        progress.note(text, "ground_left_out", points=model.on_ground)
    if model.points + model.on_ground < shape.point_count:
        text = f"{counted(model.points, 'point')} are used: the cloud was thinned."
        progress.note(text, "cloud_thinned", points=model.points)
    _warn_of_scan(model, progress)
    quality = {
        "explained_percent": 100 * model.explained,
        "measured_percent": 100 * model.measured,
        "volume_error_percent": 100 * model.volume_error,
        "noise": model.noise,
        "spacing": model.spacing,
        "points_used": model.points,
        "points_on_ground": model.on_ground,
    }
    return Outcome(
        shape=shape,
        layers=(_layer(model.cylinders), samples_layer(shape)),
        values=_values(model.cylinders, shape) | quality,
        extras={"cylinders": model.cylinders},
        panels=_panels(model.cylinders, shape),
    )


def _warn_of_scan(model: ScannedTree, progress: Progress) -> None:
    """Warn of an uncertain volume or length, and of points without a cylinder."""
    if model.volume_error > GUESS_ERROR:
        text = (
            f"Hardly any radius could be measured: points are {model.spacing:.2g} apart. Radii and "
            "volume are guesses; a denser scan is needed."
        )
        progress.warn(text, "radii_unmeasured", spacing=model.spacing)
    elif model.volume_error > MAX_VOLUME_ERROR:
        text = (
            f"The volume may be off by {100 * model.volume_error:.0f} %: "
            f"{100 * model.measured:.0f} % of the length has a measured radius. "
            "More points, or scans from more sides, help."
        )
        progress.warn(text, "volume_uncertain", error=model.volume_error)
    elif model.measured < MIN_MEASURED:
        text = (
            f"{100 * (1 - model.measured):.0f} % of the length is in limbs too thin to measure: "
            "twigs, or leaves, which make the length too long."
        )
        progress.warn(text, "length_uncertain", fraction=1 - model.measured)
    if model.explained < MIN_EXPLAINED:
        text = (
            f"{100 * (1 - model.explained):.0f} % of the points are not explained by a cylinder: "
            "leaves, other objects, or twigs closer together than the points. Take leaves away."
        )
        progress.warn(text, "unexplained_points", fraction=1 - model.explained)


def _panels(tree: TreeCylinders, shape: Shape) -> dict[str, tuple[tuple[str, Layer], ...]]:
    """Return the picture of the cylinders beside the shape."""
    turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
    axes = tree.axes
    u = perpendicular(axes)
    ring = np.cos(turn)[:, None] * u[:, None] + np.sin(turn)[:, None] * np.cross(axes, u)[:, None]
    ring = tree.radii[:, None, None] * ring
    points = np.stack([tree.starts[:, None] + ring, tree.ends[:, None] + ring], axis=1)
    a, b = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    sides = np.concatenate([np.stack([a, b, b + SIDES], 1), np.stack([a, b + SIDES, a + SIDES], 1)])
    faces = (sides + 2 * SIDES * np.arange(len(tree))[:, None, None]).reshape(-1, 3)
    orders = np.repeat(tree.orders, 2 * SIDES)
    cylinders = Layer("cylinders", points.reshape(-1, 3), faces.astype(np.int32),
                      attributes={"order": orders}, color_by="order")  # fmt: skip
    given = Layer("shape", shape.points, shape.faces)
    return {"cylinders": (("points" if shape.faces is None else "mesh", given),
                          ("cylinders by branch order", cylinders))}  # fmt: skip


def _tree(graph: CurveSkeleton, root: int, options: TreeCylindersRun) -> TreeCylinders:
    return tree_cylinders(graph, root, length=options.cylinder_length, taper=options.taper)


def _note(graph: CurveSkeleton, root: int, tree: TreeCylinders, progress: Progress) -> None:
    if tree.cut:
        text = (
            f"{counted(tree.cut, 'loop', verbs=('was', 'were'))} cut where the branches that close "
            "it are thinnest."
        )
        progress.warn(text, "loops_cut", loops=tree.cut)
    parts = np.bincount(graph.components[graph.edges[:, 0]], minlength=graph.component_count)
    other = int((parts > 0).sum()) - 1
    if other:
        text = (
            f"{counted(other, 'part', verbs=('is', 'are'))} not joined to the tree and left out; "
            "a root there gives them."
        )
        progress.warn(text, "parts_left_out", parts=other)


def _layer(tree: TreeCylinders) -> Layer:
    """Return the middles of the cylinders as lines, those of a limb in one."""
    ends = np.append(tree.first[1:], len(tree)) - 1
    # Each limb has a point more than cylinders: rows move on by one at each.
    rows = np.arange(len(tree)) + tree.branches
    count = len(tree) + len(ends)
    points, cylinder = np.empty((count, 3)), np.empty(count, np.int64)
    points[rows], cylinder[rows] = tree.starts, np.arange(len(tree))
    points[rows[ends] + 1], cylinder[rows[ends] + 1] = tree.ends[ends], ends
    attributes: dict[str, NDArray[Any]] = {
        "radius": tree.radii[cylinder],
        "order": tree.orders[cylinder],
        "branch": tree.branches[cylinder],
        "cylinder": cylinder.astype(np.int32),
    }
    edges = np.stack([rows, rows + 1], axis=1).astype(np.int32)
    shown: dict[str, Any] = {"color_by": "order", "labels": ("branch",)}
    return Layer("tree_cylinders", points, edges=edges, attributes=attributes, **shown)


def _sums(labels: NDArray[np.integer], values: FloatArray) -> FloatArray:
    return np.asarray(np.bincount(labels, values), np.float64)


def _breast_diameter(tree: TreeCylinders, shape: Shape) -> float | None:
    """Return the diameter of the trunk 1.3 m above its base; None without a unit or so high up."""
    up = "xyz".index(shape.up or "z")
    trunk = np.flatnonzero(tree.branches == 0)
    if shape.unit not in METERS:
        return None
    height = tree.starts[0, up] + BREAST_HEIGHT / METERS[shape.unit]
    there = trunk[(tree.starts[trunk, up] <= height) & (tree.ends[trunk, up] > height)]
    return float(2.0 * tree.radii[there[0]]) if len(there) else None


def _values(tree: TreeCylinders, shape: Shape) -> dict[str, Any]:
    up = "xyz".index(shape.up or "z")
    length, volume = (_sums(tree.branches, one) for one in (tree.lengths, tree.volumes))
    orders, parents = tree.orders[tree.first], tree.parents[tree.first]
    above = np.where(parents < 0, -1, tree.branches[parents])
    return {
        "cylinders": len(tree),
        "limbs": len(tree.first),
        "highest_order": int(tree.orders.max()),
        "loops_cut": tree.cut,
        "root": place(tree.starts[0]),
        "length": float(length.sum()),
        "volume": float(volume.sum()),
        **summary(tree.radii, "radius"),
        "height": float(max(tree.starts[:, up].max(), tree.ends[:, up].max()) - tree.starts[0, up]),
        "breast_diameter": _breast_diameter(tree, shape),
        "diagonal": shape.diagonal,
        "order_table": [
            {
                "order": order,
                "limbs": int((orders == order).sum()),
                "length": float(length[orders == order].sum()),
                "volume": float(volume[orders == order].sum()),
            }
            for order in range(int(orders.max()) + 1)
        ],
        "limb_table": [
            {
                "order": int(orders[row]),
                "parent": int(above[row]),
                "length": float(length[row]),
                "volume": float(volume[row]),
                "radius": float(tree.radii[tree.first[row]]),
                "branch_angle": None if parents[row] < 0 else float(tree.angles[row]),
                "position": place(tree.starts[tree.first[row]]),
            }
            for row in range(len(tree.first))
        ],
    }


def _write(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    rows: Iterable[tuple[Any, ...]] = zip(*(one.tolist() for one in columns.values()), strict=True)
    write_lines(path, [",".join(columns), *(",".join(map(repr, row)) for row in rows)])


def _in_metres(result: Result) -> tuple[TreeCylinders, float]:
    tree: TreeCylinders = result.extras["cylinders"]
    return tree, METERS.get(result.shape.unit or "m", 1.0)


def write_cylinders(path: Path, result: Result) -> None:
    """Write a line for each cylinder, with the columns of TreeQSM; lengths are in metres."""
    tree, metre = _in_metres(result)
    after = np.zeros(len(tree), np.int64)
    goes_on = tree.branches[1:] == tree.branches[:-1]
    after[:-1][goes_on] = np.flatnonzero(goes_on) + 2
    columns: dict[str, NDArray[Any]] = {
        "radius": tree.radii * metre,
        "length": tree.lengths * metre,
    }
    for name, rows in (("start", tree.starts * metre), ("axis", tree.axes)):
        columns |= {f"{name}.{axis}": one for axis, one in zip("xyz", rows.T, strict=True)}
    numbers: dict[str, NDArray[Any]] = {
        "parent": tree.parents + 1,
        "extension": after,
        "added": np.zeros(len(tree), np.int64),
        "UnmodRadius": tree.measured * metre,
        "branch": tree.branches + 1,
        "BranchOrder": tree.orders,
        "PositionInBranch": tree.positions + 1,
    }
    _write(path, columns | numbers)


def write_branches(path: Path, result: Result) -> None:
    """Write a line for each limb, with the columns of TreeQSM: metres, litres, degrees."""
    tree, metre = _in_metres(result)
    first, parents = tree.first, tree.parents[tree.first]
    up = "xyz".index(result.shape.up or "z")
    x, y = (tree.leaving[:, (up + axis) % 3] for axis in (1, 2))
    columns: dict[str, NDArray[Any]] = {
        "order": tree.orders[first],
        "parent": np.where(parents < 0, 0, tree.branches[parents] + 1),
        "volume": _sums(tree.branches, tree.volumes) * metre**3 * LITRES,
        "length": _sums(tree.branches, tree.lengths) * metre,
        "angle": np.nan_to_num(np.degrees(tree.angles)),
        "height": (tree.starts[first, up] - tree.starts[0, up]) * metre,
        "azimuth": np.degrees(np.arctan2(y, x)),
        "diameter": 2.0 * tree.radii[first] * metre,
    }
    _write(path, columns)


OPERATION = Operation(
    name="tree_cylinders",
    filter_name="generate_tree_cylinders",
    label="Tree cylinders",
    group="Skeleton",
    help="Fit cylinders to trunk, branches and twigs of a tree (quantitative structure model).\n\n"
    "Each cylinder has its radius, length, parent and branch order, each limb its volume and its "
    "angle; together they are a quantitative structure model. The tree begins at its lowest thick "
    "end or at a given place. A mesh is modelled along its curve skeleton; loops are cut where "
    "they are thinnest. A cloud of points needs no normals: its ground is left out, one side of a "
    "limb is enough, and radii of twigs that cannot be measured follow the pipe model.",
    options=TreeCylindersRun,
    run=run,
    needs_normals=False,
    thin_lines=True,
    formats=(
        Format("csv", write_cylinders, "cylinders"),
        Format("branches.csv", write_branches, "cylinders"),
    ),
    examples=(("tree.ply --unit m --taper", "from a root to the twigs, thinner and thinner"),),
    sample="tree",
    layers={
        "tree_cylinders": "the middles of the cylinders with radius, order and branch",
        "samples": "the surface as computed on",
    },
    order=74,
    words=("QSM", "tree", "plant", "roots", "branch order"),
)
