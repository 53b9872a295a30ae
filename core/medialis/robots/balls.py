"""Balls for a whole robot: each link gets as many as bring its surface near, out of a given number.

1. A medial mesh of each link with many balls, and its coarser levels: how far balls that cover the
   link stick out of it on average (the volume outside over the area), for 1, 2, 4, ... balls.
2. Balls are dealt one by one to the link whose balls stick out farthest: large links and thin ones
   end alike, and a finger has as good balls as a torso.
3. Each link is fitted with its number, and covered.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from medialis.base.arrays import Described, enclosed_volume, twice_areas
from medialis.base.box_tree import NearestTree
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.options import Options, algorithm, flag, whole
from medialis.base.progress import Progress, counted
from medialis.base.validation import FloatArray
from medialis.formats.files import write_text
from medialis.medial_meshes.distances import covering, excess_of, pieces_of
from medialis.medial_meshes.medial_mesh import medial_mesh
from medialis.medial_meshes.mesh import BallCover, MedialMesh
from medialis.medial_meshes.sampling import Solid
from medialis.robots.urdf import (
    fixed_frames,
    link_shapes,
    robot_of,
    rows_of,
    srdf_text,
    urdf_text,
    yaml_text,
)
from medialis.shape.shape import Shape

MOST_LOOKED_AT = 64
"""Balls of a link up to which it is measured how far they stick out; more halve that with each
doubling."""

PIECE, ROUNDS = 0.02, 6
"""Sides of pieces that each lie in one ball, in diagonals, and rounds of giving them to balls: half
of what a single shape gets takes an eighth of the time."""

COARSE, COARSE_ROUNDS, COARSE_PLACES = 0.05, 3, 20_000
"""Sides of pieces in diagonals, rounds and places of covers while balls are shared."""

LOOKED_AT = 0.02
"""Diagonals: sides of the pieces of a link at whose middles gaps are measured."""

ROUND = 1e-6
"""A shape all of whose points are equally far from its middle, up to this share, is a sphere,"""

FULL = 0.9
"""where it has this share of the volume."""

DIRECTIONS = 200
"""Points of a ball at which it is measured how far it sticks out."""


@dataclass(frozen=True, eq=False, repr=False)
class RobotBalls(Described):
    """Balls for the links of a robot.

    Attributes
    ----------
    name : str
        Of the robot.
    links : dict of BallCover
        The balls of each link that has a shape, in its frame, in metres.
    figures : dict of float
        How good they are, lengths in metres: `coverage`, the share of the surface that lies in
        balls; `protrusion_mean` and `protrusion_p95`, how far the boundary of the balls lies
        outside; `surface_gap` and `largest_uncovered_gap`, how far the surface lies outside of the
        balls, on average and at most; `volume_ratio`, the volume of the balls over that of the
        links.
    urdf : str
        The file that they are of.
    """

    name: str
    links: Mapping[str, BallCover]
    figures: Mapping[str, float]
    urdf: str

    def __repr__(self) -> str:
        count = sum(map(len, self.links.values()))
        ratio = self.figures["volume_ratio"]
        return (
            f"RobotBalls({self.name}, {count} balls, {len(self.links)} links, volume {ratio:.3g})"
        )


@dataclass(frozen=True, kw_only=True)
class RobotBallsOptions(Options):
    """Options of `robot_balls`."""

    balls: int = whole(
        100, "Balls", "Number of balls of all links together, at most.", low=1, high=100_000
    )
    cover: bool = flag(
        True,
        "Cover",
        "Move and enlarge the balls until every point of every link lies in one; else they fit "
        "best.",
    )
    plane: Sequence[float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.plane is None:
            return
        try:
            given = np.array(self.plane, np.float64)
        except (TypeError, ValueError):
            given = np.empty(0)
        if given.shape != (4,) or not np.isfinite(given).all() or not given[:3].any():
            raise InvalidOptionError(
                f"plane must be four numbers a b c d, a direction first; got {self.plane!r}."
            )
        object.__setattr__(self, "plane", tuple((given / np.linalg.norm(given[:3])).tolist()))


@algorithm(RobotBallsOptions, keep=False)
def robot_balls(
    path: str | os.PathLike[str], options: RobotBallsOptions, progress: Progress
) -> RobotBalls:
    """Describe the links of a robot by balls, for planners that keep clear of things.

    Parameters
    ----------
    path : path
        A URDF file, with its meshes beside it or in folders above.
    plane : sequence of float, optional
        ``a, b, c, d``: balls of links that no joint moves keep to the side of a plane where
        ``a x + b y + c z`` is d or more, in the frame of the first link and in metres:
        ``(0, 0, 1, 0)`` for a robot on a table. Those that would cross it are smaller; where a link
        stands on the plane it is not covered altogether then, and figures say how far.

    Returns
    -------
    RobotBalls

    Raises
    ------
    FileError
        When the file or a mesh of it cannot be read.
    InvalidShapeError
        When it is no URDF, no link has a shape, or one encloses nothing.

    See Also
    --------
    write_robot_balls : writes them for cuRobo, MoveIt and others.
    ball_cover : of one shape.

    Notes
    -----
    Each link gets a ball at least: a message says so where that is more than
    there are.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import medialis
    >>> box = '<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>'
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "arm.urdf"
    ...     _ = path.write_text(f'<robot name="arm"><link name="base">{box}</link></robot>')
    ...     robot = medialis.robot_balls(path, balls=12)
    >>> list(robot.links), len(robot.links["base"]) <= 12, robot.figures["coverage"]
    (['base'], True, 1.0)
    """
    root = robot_of(path)
    with progress.stage("read", 0.0, 0.1):
        shapes = link_shapes(path, root, progress)
    if not shapes:
        raise InvalidShapeError(f"No link of {os.fspath(path)} has a shape.")
    round_ones = {name: ball for name, shape in shapes.items() if (ball := _sphere(shape))}
    with progress.stage("share", 0.1, 0.5):
        counts = _shared(shapes, round_ones, options, progress)
    links: dict[str, BallCover] = {}
    measured, planes = [], _planes(root, options.plane)
    with progress.stage("fit", 0.5, 1.0):
        for number, (name, shape) in enumerate(shapes.items()):
            cover = round_ones.get(name) or _balls_of(
                _few(_mesh(name, shape, counts[name], progress.still), counts[name]), shape, options
            )
            links[name] = _above(cover, shape, planes[name], progress) if name in planes else cover
            measured.append(_measured(links[name], shape))
            progress.update((number + 1) / len(shapes))
    urdf = ElementTree.tostring(root, encoding="unicode")
    return RobotBalls(root.get("name", "robot"), links, _figures(measured), urdf)


def _sphere(shape: Shape) -> BallCover | None:
    """Return the ball of a link that is one."""
    middle = shape.points.mean(axis=0)
    away = np.linalg.norm(shape.points - middle, axis=1)
    # The corners of a box are equally far from its middle, too.
    if np.ptp(away) > ROUND * away.max() or _volume(shape) < FULL * 4 / 3 * np.pi * away.max() ** 3:
        return None
    return BallCover(middle[None], np.array([away.max()]), 0.0)


def _mesh(name: str, shape: Shape, balls: int, progress: Progress) -> MedialMesh:
    try:
        return medial_mesh(shape, balls=balls, quality="fast", denoise="off", progress=progress)
    except InvalidShapeError as error:
        raise InvalidShapeError(f"Link {name}: {error}") from error


def _few(mesh: MedialMesh, count: int) -> MedialMesh:
    """Return so many balls, also where the topology needs more: those that are farthest apart.

    Meshes of links have specks, slits and inner walls, each a part or a handle that needs balls.
    """
    if count >= mesh.fewest:
        return mesh.level(count)
    mesh = mesh.level(mesh.fewest)
    chosen = [int(mesh.radii.argmax())]
    out = np.full(len(mesh), np.inf)
    while len(chosen) < count:
        last = chosen[-1]
        away = np.linalg.norm(mesh.centers - mesh.centers[last], axis=1) - mesh.radii[last]
        out = np.minimum(out, away + mesh.radii)  # how far each sticks out of those chosen
        chosen.append(int(out.argmax()))
    rows = np.column_stack([mesh.centers, mesh.radii])[chosen]
    none = np.empty((0, 3), np.int64)
    return MedialMesh.of_rows(rows, none[:, :2], none)


def _balls_of(mesh: MedialMesh, shape: Shape, options: RobotBallsOptions) -> BallCover:
    centers, radii = mesh.centers, mesh.radii
    if options.cover:
        centers, radii = covering(mesh, shape, PIECE, ROUNDS)
    return BallCover(centers, radii, excess_of(shape, centers, radii))


def _planes(
    root: ElementTree.Element, plane: Sequence[float] | None
) -> dict[str, tuple[FloatArray, float]]:
    """Return normal and distance of a plane in the frame of each link that no joint moves."""
    if plane is None:
        return {}
    normal = np.array(plane[:3])
    return {
        name: (normal @ turn, plane[3] - float(normal @ place))
        for name, (turn, place) in fixed_frames(root).items()
    }


def _above(
    cover: BallCover, shape: Shape, plane: tuple[FloatArray, float], progress: Progress
) -> BallCover:
    """Put the largest ball that touches a plane in the place of one that crosses it.

    It lies in that one and touches it where that is farthest from the plane.
    """
    normal, distance = plane
    height = cover.centers @ normal - distance
    crossing = height < cover.radii
    if not crossing.any():
        return cover
    radii = np.where(crossing, 0.5 * (height + cover.radii), cover.radii)
    centers = cover.centers + np.where(crossing, radii - height, 0.0)[:, None] * normal
    kept = radii > 0.0
    text = f"{counted(int(crossing.sum()), 'ball')} at the plane were made smaller or left out."
    progress.note(text, "at_plane", balls=int(crossing.sum()), left_out=int((~kept).sum()))
    centers, radii = centers[kept], radii[kept] * (1.0 - 1e-12)
    return BallCover(centers, radii, excess_of(shape, centers, radii))


def _shared(
    shapes: Mapping[str, Shape],
    round_ones: Mapping[str, BallCover],
    options: RobotBallsOptions,
    progress: Progress,
) -> dict[str, int]:
    """Return how many balls each link gets."""
    levels, counts = {}, {}
    for number, (name, shape) in enumerate(shapes.items()):
        if name in round_ones:
            levels[name], counts[name] = (np.ones(1), np.zeros(1)), 1
            continue
        most = min(MOST_LOOKED_AT, options.balls)
        mesh = _mesh(name, shape, most, progress.still).with_levels()
        sizes = sorted({min(1 << k, len(mesh), most) for k in range(7)})
        told = [_sticking_out(_few(mesh, size), shape) for size in sizes]
        levels[name] = np.array(sizes, float), np.minimum.accumulate(told)
        counts[name] = sizes[0]
        progress.update((number + 1) / len(shapes))
    if sum(counts.values()) > options.balls:
        need = sum(counts.values())
        text = f"{need} balls are used, not {options.balls}: one for each link."
        progress.warn(text, "more_balls", balls=need, of=options.balls)
    while sum(counts.values()) < options.balls:
        worst = max(counts, key=lambda name: _expected(*levels[name], counts[name]))
        if not levels[worst][1].any():  # all are spheres
            break
        counts[worst] += 1
    return counts


def _sticking_out(mesh: MedialMesh, shape: Shape) -> float:
    """Return the volume outside of balls that cover a shape, over its area."""
    centers, radii = covering(mesh, shape, COARSE, COARSE_ROUNDS)
    return excess_of(shape, centers, radii, COARSE_PLACES) * _volume(shape) / shape.area


def _volume(shape: Shape) -> float:
    assert shape.faces is not None
    return enclosed_volume(shape.points, shape.faces)


def _expected(sizes: FloatArray, told: FloatArray, count: int) -> float:
    if count > sizes[-1]:
        return float(told[-1] * sizes[-1] / count)
    return float(np.exp(np.interp(np.log(count), np.log(sizes), np.log(np.maximum(told, 1e-300)))))


def _measured(cover: BallCover, shape: Shape) -> dict[str, FloatArray]:
    """Return distances of the surface from the balls, and of their boundary from it, weighted."""
    assert shape.faces is not None
    pieces = pieces_of(shape.points[shape.faces], LOOKED_AT * shape.diagonal)
    corners = np.arange(3 * len(pieces)).reshape(-1, 3)
    weights = twice_areas(pieces.reshape(-1, 3), corners) / 2.0
    balls = NearestTree.of_balls(cover.centers, cover.radii)
    gaps = np.maximum(balls.distances(pieces.reshape(-1, 3))[0].reshape(-1, 3).max(axis=1), 0.0)
    steps = np.arange(DIRECTIONS) + 0.5
    up, turn = 1.0 - 2.0 * steps / DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * steps
    flat = np.sqrt(1.0 - up**2)
    around = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=1)
    places = (cover.centers[:, None] + cover.radii[:, None, None] * around).reshape(-1, 3)
    size = np.repeat(cover.radii**2, DIRECTIONS) * 4.0 * np.pi / DIRECTIONS
    outer = balls.distances(places)[0] > -1e-6 * shape.diagonal
    places, size = places[outer], size[outer]
    solid = Solid(shape.points, shape.faces)
    away = NearestTree.of_triangles(shape.points, shape.faces).distances(places)[0]
    away[solid.contains(places)] = 0.0
    whole = _volume(shape)
    volumes = np.array([whole, whole * (_held(balls, shape, solid) + cover.excess)])
    return {"gaps": gaps, "area": weights, "out": away, "size": size, "volumes": volumes}


def _held(balls: NearestTree, shape: Shape, solid: Solid) -> float:
    """Return the share of a solid that lies in balls."""
    low, high = shape.bounds
    steps = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])
    places = low + (np.arange(1, 50_001)[:, None] * steps % 1.0) * (high - low)
    inside = places[solid.contains(places)]
    return float((balls.distances(inside)[0] <= 0).mean()) if len(inside) else 1.0


def _figures(measured: list[dict[str, FloatArray]]) -> dict[str, float]:
    gaps, area, out, size = (
        np.concatenate([one[name] for one in measured]) for name in ("gaps", "area", "out", "size")
    )
    whole, balls = np.sum([one["volumes"] for one in measured], axis=0)
    order = np.argsort(out, kind="stable")
    place = np.searchsorted(np.cumsum(size[order]), 0.95 * size.sum())
    return {
        "coverage": float(area[gaps <= 0.0].sum() / area.sum()),
        "protrusion_mean": float(size @ out / size.sum()),
        "protrusion_p95": float(out[order][min(int(place), len(out) - 1)]),
        "surface_gap": float(area @ gaps / area.sum()),
        "largest_uncovered_gap": float(gaps.max()),
        "volume_ratio": float(balls / whole) if whole > 0 else float("inf"),
    }


ENDINGS = (".yml", ".yaml", ".srdf", ".urdf", ".json")


def write_robot_balls(path: str | os.PathLike[str], robot: RobotBalls) -> None:
    """Write the balls of a robot, in metres.

    Parameters
    ----------
    path : path
        Ends in .yml or .yaml (``collision_spheres`` as cuRobo reads them), .srdf
        (``link_sphere_approximation``), .urdf (the robot with balls as its collision elements) or
        .json (with the figures).
    robot : RobotBalls

    Raises
    ------
    InvalidOptionError
        For another ending.
    FileError
        When the file cannot be written.

    See Also
    --------
    robot_balls : makes them.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import medialis
    >>> ball = medialis.BallCover([[0, 0, 0.5]], [0.25], 0.0)
    >>> robot = medialis.RobotBalls("arm", {"base": ball}, {}, '<robot name="arm"/>')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     medialis.write_robot_balls(f"{folder}/arm.yml", robot)
    ...     print((Path(folder) / "arm.yml").read_text().splitlines()[3])
        - "center": [0.0, 0.0, 0.5]
    """
    name = Path(path)
    ending = name.suffix.lower()
    if ending not in ENDINGS:
        raise InvalidOptionError(f"Balls end in {', '.join(ENDINGS)}, got {name.name!r}.")
    if ending == ".json":
        spheres = {
            link: [{"center": row[:3], "radius": row[3]} for row in rows_of(cover)]
            for link, cover in robot.links.items()
        }
        content = {"robot": robot.name, "unit": "m", "links": spheres, "figures": robot.figures}
        text = json.dumps(content, indent=1) + "\n"
    elif ending == ".srdf":
        text = srdf_text(robot.name, robot.links)
    elif ending == ".urdf":
        text = urdf_text(robot.urdf, robot.links)
    else:
        text = yaml_text(robot.name, robot.links)
    write_text(name, text)
