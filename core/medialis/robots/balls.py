"""Balls or capsules for a whole robot: links get as many as they need, out of a given number.

1. Covers of each link by 1, 2, 3, ... balls (`covers.py`).
2. They are shared so that links get thicker by small factors, thin ones as well as thick ones
   (`sharing.py`), and links that must not touch do not (`clearances.py`).
3. The cover of each link is improved, measured and written.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from medialis.base.arrays import Described, enclosed_volume
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.options import Options, algorithm, flag, whole
from medialis.base.progress import Progress, counted
from medialis.base.validation import FloatArray
from medialis.formats.files import write_text
from medialis.medial_meshes.mesh import BallCover
from medialis.robots.clearances import LinkOverlap, RestingLinks
from medialis.robots.covers import (
    Candidates,
    CapsuleCover,
    Clearance,
    Cover,
    LinkCovers,
    Needs,
    ball_axes,
    capsule_axes,
    refined,
)
from medialis.robots.figures import measured, summed
from medialis.robots.link_solids import LinkSolid
from medialis.robots.sharing import share
from medialis.robots.urdf import (
    Ends,
    ends_of,
    link_shapes,
    mjcf_text,
    rest_frames,
    robot_of,
    separate_pairs,
    srdf_text,
    urdf_text,
    yaml_text,
)
from medialis.shape.shape import Shape

PATCHES = 500
"""Patches of the surface of each link, about, where there are few balls for each."""

PATCHES_PER_BALL = 40
"""Patches for each ball that a link gets on average."""

MOST_NUMBERS = 1 << 27
"""Entries of the tables of all links together: half a gigabyte."""

ROUND = 1e-6
"""A shape all of whose points are equally far from its middle, up to this share, is a sphere,"""

FULL = 0.9
"""where it has this share of the volume."""


@dataclass(frozen=True, eq=False, repr=False)
class RobotBalls(Described):
    """Balls for the links of a robot.

    Attributes
    ----------
    name : str
        Of the robot.
    links : dict of BallCover, or of CapsuleCover
        The balls or capsules of each link that has a shape, in its frame, in metres.
    figures : dict of float
        How good they are, lengths in metres: `coverage`, the share of the surface that lies in
        balls; `protrusion_mean`, `protrusion_p95` and `protrusion_max`, how far the boundary of the
        balls lies outside; `surface_gap` and `largest_uncovered_gap`, how far the surface lies
        outside of the balls, on average and at most; `volume_ratio`, the volume of the balls over
        that of the links.
    urdf : str
        The file that they are of.
    protrusions : dict of float
        Of each link: how far its balls stick out, at most, in metres.
    overlaps : tuple of LinkOverlap
        Links that move against each other without a joint between them, and whose balls overlap at
        rest though the links do not; the deepest first.
    """

    name: str
    links: Mapping[str, BallCover | CapsuleCover]
    figures: Mapping[str, float]
    urdf: str
    protrusions: Mapping[str, float] = field(default_factory=dict)
    overlaps: tuple[LinkOverlap, ...] = ()

    @property
    def has_capsules(self) -> bool:
        """True when links have capsules rather than balls."""
        return any(isinstance(cover, CapsuleCover) for cover in self.links.values())

    def __repr__(self) -> str:
        count = sum(map(len, self.links.values()))
        ratio, kind = self.figures["volume_ratio"], "capsules" if self.has_capsules else "balls"
        return (
            f"RobotBalls({self.name}, {count} {kind}, {len(self.links)} links, volume {ratio:.3g})"
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
        "Every point of every link lies in a ball; else balls are smaller by half of what they "
        "stick out, so that neither side is off by more.",
    )
    capsules: bool = flag(
        False, "Capsules", "Use capsules in place of balls: fewer hold a long link as closely."
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
    """Describe the links of a robot by balls or capsules, for planners that keep clear of things.

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
        When it is no URDF, or no link has a shape.
    InvalidOptionError
        When `plane` is not four numbers.

    See Also
    --------
    write_robot_balls : writes them for cuRobo, MoveIt and others.
    ball_cover : of one shape.

    Notes
    -----
    Each link gets at least one ball; a message reports where that is more than `balls`. Links that
    move against each other without a joint between them get covers that do not overlap at rest,
    where the number of balls allows it. All balls are used as long as they decrease the protrusion.

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
    with progress.stage("examine", 0.1, 0.3):
        solids = _solids(shapes, options.balls, progress)
    resting = RestingLinks(solids, rest_frames(root), separate_pairs(root))
    with progress.stage("share", 0.3, 0.7):
        covers = _shared(solids, resting, options, progress)
    links: dict[str, BallCover | CapsuleCover] = {}
    found, planes = [], _planes(root, options.plane)
    with progress.stage("measure", 0.7, 1.0):
        for number, (name, solid) in enumerate(solids.items()):
            cover = covers[name] if options.cover else covers[name].balanced()
            if name in planes:
                cover = _above(cover, planes[name], progress)
            covers[name] = cover
            figures = measured(cover, solid)
            found.append(figures)
            first, second = cover.axes[:, :3], cover.axes[:, 3:]
            links[name] = (
                CapsuleCover(first, second, cover.radii, figures.excess)
                if options.capsules
                else BallCover(first, cover.radii, figures.excess)
            )
            progress.update((number + 1) / len(shapes))
    overlaps = resting.overlaps(covers)
    _note_overlaps(overlaps, progress)
    urdf = ElementTree.tostring(root, encoding="unicode")
    protrusions = {
        name: float(one.out.max(initial=0.0)) for name, one in zip(solids, found, strict=True)
    }
    name = root.get("name", "robot")
    return RobotBalls(name, links, summed(found), urdf, protrusions, overlaps)


def _note_overlaps(overlaps: Sequence[LinkOverlap], progress: Progress) -> None:
    if overlaps:
        worst = overlaps[0]
        text = (
            f"{counted(len(overlaps), 'pair')} of links overlap by their balls at rest though the "
            f"links do not, {worst.first} and {worst.second} by {1000 * worst.depth:.3g} mm: more "
            "balls keep them apart."
        )
        progress.warn(text, "links_overlap", pairs=len(overlaps), depth=worst.depth)


def _solids(shapes: Mapping[str, Shape], balls: int, progress: Progress) -> dict[str, LinkSolid]:
    """Cut the surface of each link into patches, and find its medial balls."""
    each = max(PATCHES, PATCHES_PER_BALL * balls // len(shapes))
    patches = min(each, math.isqrt(MOST_NUMBERS // len(shapes)))
    solids = {}
    for number, (name, shape) in enumerate(shapes.items()):
        solids[name] = LinkSolid(shape, patches)
        _ = solids[name].medial_balls
        progress.update((number + 1) / len(shapes))
    return solids


def _sphere(shape: Shape) -> Cover | None:
    """Return the ball of a link that is one."""
    middle = shape.points.mean(axis=0)
    away = np.linalg.norm(shape.points - middle, axis=1)
    assert shape.faces is not None
    # The corners of a box are equally far from its middle, too.
    volume = enclosed_volume(shape.points, shape.faces)
    if np.ptp(away) > ROUND * away.max() or volume < FULL * 4 / 3 * np.pi * away.max() ** 3:
        return None
    radius = np.array([away.max()])
    return Cover(np.tile(middle, 2)[None], radius, radius)


def _shared(
    solids: Mapping[str, LinkSolid],
    resting: RestingLinks,
    options: RobotBallsOptions,
    progress: Progress,
) -> dict[str, Cover]:
    """Return the cover of each link by its share of the balls."""
    round_ones = {name: ball for name, one in solids.items() if (ball := _sphere(one.shape))}
    total = options.balls - len(round_ones)
    rest = [name for name in solids if name not in round_ones]
    if len(solids) > options.balls:
        text = f"{len(solids)} balls are used, not {options.balls}: one for each link."
        progress.warn(text, "more_balls", balls=len(solids), of=options.balls)
    free, limits, clearances = {}, {}, {}
    for number, name in enumerate(rest):
        clearances[name] = resting.clearance(name)
        free[name] = _choices(
            solids[name], clearances[name], options.capsules, options.balls / len(solids)
        )
        allowed = free[name].needs.candidates.limits
        if allowed.min() < free[name].protrusion(1):
            limits[name] = allowed
        progress.update(0.5 * (number + 1) / len(rest))
    gaps = [gap for gap in resting.gaps.values() if gap < np.inf]
    shares = share(free, limits, gaps, max(total, len(rest)), progress.still)
    covers = {}
    for number, name in enumerate(rest):
        one = shares.covers[name]
        chosen = one.needs.candidates.subset(one.columns(shares.counts[name]))
        floor = shares.floors.get(name, np.inf)
        covers[name] = refined(
            one.solid, chosen, clearances[name] if floor < np.inf else None, floor
        )
        progress.update(0.5 + 0.5 * (number + 1) / len(rest))
    return {name: round_ones[name] if name in round_ones else covers[name] for name in solids}


def _choices(
    solid: LinkSolid, clearance: Clearance | None, capsules: bool, each: float
) -> LinkCovers:
    """Return the covers of a link without regard to other links; candidates have limits."""
    needs = Needs.of(solid.patches, Candidates.of_axes(ball_axes(solid), solid, clearance))
    covers = LinkCovers(solid, needs, needs.best())
    if not capsules:
        return covers
    axes = capsule_axes(solid, covers, each)
    needs = Needs.of(solid.patches, Candidates.of_axes(axes, solid, clearance))
    return LinkCovers(solid, needs, needs.best())


def _planes(
    root: ElementTree.Element, plane: Sequence[float] | None
) -> dict[str, tuple[FloatArray, float]]:
    """Return normal and distance of a plane in the frame of each link that no joint moves."""
    if plane is None:
        return {}
    normal = np.array(plane[:3])
    return {
        name: (normal @ turn, plane[3] - float(normal @ place))
        for name, (turn, place) in rest_frames(root, fixed=True).items()
    }


def _above(cover: Cover, plane: tuple[FloatArray, float], progress: Progress) -> Cover:
    """Shrink the balls and capsules that cross a plane until they touch it.

    A ball becomes the largest one inside it that is above the plane. The radius of a capsule is
    the smaller one of such balls at its two ends, and the capsule stays inside the given one.
    """
    normal, distance = plane
    ends = cover.axes.reshape(-1, 2, 3)
    height = ends @ normal - distance
    largest = np.minimum(0.5 * (height + cover.radii[:, None]), cover.radii[:, None])
    radii = largest.min(axis=1)
    crossing = radii < cover.radii
    if not crossing.any():
        return cover
    raised = np.where(crossing[:, None], np.maximum(radii[:, None] - height, 0.0), 0.0)
    ends = ends + raised[..., None] * normal
    kept = radii > 0.0
    kind = "ball" if (cover.axes[:, :3] == cover.axes[:, 3:]).all() else "capsule"
    text = f"{counted(int(crossing.sum()), kind)} at the plane were made smaller or left out."
    progress.note(text, "at_plane", balls=int(crossing.sum()), left_out=int((~kept).sum()))
    radii = np.where(crossing, radii * (1.0 - 1e-12), radii)[kept]
    return Cover(ends[kept].reshape(-1, 6), radii, cover.depths[kept])


ENDINGS = (".yml", ".yaml", ".srdf", ".urdf", ".xml", ".json")
CAPSULE_ENDINGS = (".urdf", ".xml", ".json")
"""Of files that can hold capsules."""


def check_ending(path: Path, capsules: bool) -> None:
    """Refuse a file whose ending says no format, or one without capsules where there are some."""
    endings = CAPSULE_ENDINGS if capsules else ENDINGS
    if path.suffix.lower() not in endings:
        kind = "Capsules" if capsules else "Balls"
        raise InvalidOptionError(f"{kind} end in {', '.join(endings)}, got {path.name!r}.")


def write_robot_balls(path: str | os.PathLike[str], robot: RobotBalls) -> None:
    """Write the balls or capsules of a robot, in metres.

    Parameters
    ----------
    path : path
        Ends in .yml or .yaml (``collision_spheres`` as cuRobo reads them), .srdf
        (``link_sphere_approximation``), .urdf (the robot with balls as its collision elements; a
        cylinder and two spheres for each capsule), .xml (a MuJoCo model with the joints and masses
        of the robot, and geoms of type sphere or capsule) or .json (with the figures). Capsules can
        be in the last three.
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
    check_ending(name, robot.has_capsules)
    ending, balls = name.suffix.lower(), _balls_of(robot)
    if ending == ".json":
        content = {
            "robot": robot.name,
            "unit": "m",
            "links": {link: [*map(_row_of, ends_of(cover))] for link, cover in robot.links.items()},
            "figures": finite(robot.figures),
            "protrusions": dict(robot.protrusions),
            "overlaps": [asdict(pair) for pair in robot.overlaps],
        }
        text = json.dumps(content, indent=1) + "\n"
    elif ending == ".srdf":
        text = srdf_text(robot.name, balls)
    elif ending == ".urdf":
        text = urdf_text(robot.urdf, robot.links)
    elif ending == ".xml":
        text = mjcf_text(robot.urdf, robot.links)
    else:
        text = yaml_text(robot.name, balls)
    write_text(name, text)


def _balls_of(robot: RobotBalls) -> dict[str, BallCover]:
    return {link: one for link, one in robot.links.items() if isinstance(one, BallCover)}


def _row_of(part: Ends) -> dict[str, Any]:
    if part.length == 0.0:
        return {"center": part.start.tolist(), "radius": part.radius}
    return {"start": part.start.tolist(), "end": part.end.tolist(), "radius": part.radius}


def finite(figures: Mapping[str, float]) -> dict[str, float | None]:
    """Return figures for JSON: None for those that are not defined."""
    return {name: value if math.isfinite(value) else None for name, value in figures.items()}
