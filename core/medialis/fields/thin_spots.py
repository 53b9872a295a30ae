"""Thin spots: where a shape is thinnest, one entry a place (thesis 3.5.1).

What a place is, `fields/low_places.py` says. A few samples that are far too low (a fold, a bad
normal) make none.

The samples only tell where a place is. Its value is the least distance between its two sides, which
lies between samples as a rule (`fields/calipers.py`). Where parts of a mesh overlap, that distance
is how deep they do, and no wall: such places are told apart (`fields/enclosure.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Literal

import numpy as np

from medialis.balls.surface_skeleton import as_cloud
from medialis.fields.low_places import LowPlace
from medialis.fields.thickness import (
    ThicknessOptions,
    thickness,
    thickness_field,
    thickness_without,
)
from medialis.fields.wall_places import PROMINENCE, WallBalls
from medialis.kept import Described
from medialis.model.medial_cloud import MedialCloud
from medialis.options import algorithm, length, number, whole
from medialis.progress import Progress, counted
from medialis.threads import run_patiently
from medialis.validation import FloatArray, IntArray, as_points, frozen

LOOKED_AT = 10
"""Places are looked at, thinnest first, until enough are walls, but no more than so many times the
number that was asked for."""

ROUNDS = 8
"""Times that places are looked for again, at most, because some were specks or overlaps."""

SpotKind = Literal["wall", "overlap"]


@dataclass(frozen=True, eq=False, repr=False)
class ThinSpot(Described):
    """A place where the shape is thin.

    Attributes
    ----------
    position : (3,) float64
        The thinnest place, on the surface; in a cloud the thinnest sample.
    opposite : (3,) float64
        The place that it faces on the other side of the wall; NaN where no ball between two walls
        is near, as in a cube.
    value : float
        The thickness there: the distance of the two places, or the ball of the thinnest sample
        where that distance has no minimum (at the end of a finger, along a sharp edge). Without a
        threshold, no less than what the third lowest sample there is a prominence above.
    kind : {"wall", "overlap"}
        "overlap" where two parts of a mesh, or a part with itself, overlap: the value tells how
        deep, not how thick a wall is.
    vertex : int
        Index of the thinnest sample.
    vertices : (v,) int32
        All samples of the place, ascending.
    area : float
        Of the surface that they stand for (a third of each face at each corner); NaN in a cloud.
    """

    position: FloatArray
    opposite: FloatArray
    value: float
    kind: SpotKind
    vertex: int
    vertices: IntArray
    area: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", as_points([self.position], "position")[0])
        object.__setattr__(self, "opposite", frozen(np.asarray(self.opposite), np.float64))
        object.__setattr__(self, "vertices", frozen(np.asarray(self.vertices), np.int32))


@dataclass(frozen=True, kw_only=True)
class ThinSpotOptions(ThicknessOptions):
    """Options of `thin_spots`."""

    threshold: float = length(
        0.0,
        "Thin below",
        "Every connected region thinner than this share of the size is a thin spot. 0 finds the "
        "places that are thinner than all around them.",
    )
    spots: int = whole(
        10,
        "Thin spots",
        "List at most this many places of each kind, the thinnest first.",
        low=1,
        high=100_000,
    )
    prominence: float = number(
        PROMINENCE,
        "Prominence",
        "Without a threshold: how far the thickness rises around a place before it counts as one "
        "of its own, as a share of its thickness.",
        high=100.0,
        advanced=True,
    )


@algorithm(ThinSpotOptions, door=as_cloud)
def thin_spots(
    cloud: MedialCloud, options: ThinSpotOptions, progress: Progress
) -> tuple[ThinSpot, ...]:
    """List the thinnest places of a shape, thinnest first.

    Parameters
    ----------
    cloud : MedialCloud
        Balls on n samples. Those between two walls join their sides into one place.

    Returns
    -------
    tuple of ThinSpot
        Walls, then overlaps of parts (`kind`), each by rising value. No two walls have the same
        vertices, nor two overlaps.

    Raises
    ------
    InvalidShapeError
        When no inner ball is valid.

    See Also
    --------
    thickness : the field that the places are those of.

    Notes
    -----
    Cost: sorting n values and the edges, 0.2 s for 194,000 vertices, and some 20 ms a place.
    Source: thesis 3.5.1 (locally thin parts).

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> spots = medialis.thin_spots(cloud)
    >>> spots[0].kind, bool(spots[0].value < spots[1].value)
    ('wall', True)
    """
    thickness.of(cloud, options, progress)  # raises where there is no ball
    spots, specks = run_patiently(lambda: _find(cloud, options), progress)
    if specks:
        progress.note(
            f"{counted(specks, 'place', verbs=('was', 'were'))} left out that only a few samples "
            "make far thinner than all around: flaws of the mesh, such as folds.",
            "specks",
            places=specks,
        )
    return spots


def _find(cloud: MedialCloud, options: ThinSpotOptions) -> tuple[tuple[ThinSpot, ...], int]:
    """Return thin spots, walls before overlaps, and how many specks were as thin as they.

    Balls of specks and of overlaps are left out, the thickness completed and its places looked for
    again: the wall round them is a place when nothing in it is thinner. What is beside specks is
    crumpled as well as a rule: each round leaves out one ring more round new ones.
    """
    share, level, field = options.share, options.threshold, thickness_field(cloud, options)
    assert field is not None
    values = share * field.values
    every = partial(WallBalls, cloud, share=share, with_threshold=level > 0)
    balls, level = every(), level * cloud.surface.diagonal
    flawed = specks = np.zeros(cloud.surface.point_count, np.bool_)
    found: dict[str, list[LowPlace]] = {"wall": [], "overlap": [], "speck": []}
    changed = True
    for rings in range(ROUNDS):
        before = int(flawed.sum())
        if changed:
            found["wall"], specks = [], np.zeros_like(flawed)
            low = balls.low_places(values, prominence=options.prominence)
            for place in islice(low, LOOKED_AT * options.spots):
                if len(found["wall"]) == options.spots or place.value >= (level or np.inf):
                    break
                what = balls.kind(place)
                if what == "wall" or not balls.touches(place, flawed):
                    found[what].append(place)
                if what != "wall":
                    (specks if what == "speck" else flawed)[place.vertices] = True
        flawed |= balls.grown(specks, rings)
        if int(flawed.sum()) == before:
            break
        rest = field and thickness_without(cloud, flawed, options, field)
        changed = balls.leave_out(flawed) or rest is not field
        field = rest
        values = np.full(len(flawed), np.inf) if field is None else share * field.values
    if level > 0:
        found["wall"] = list(islice(balls.low_places(values, level=level), options.spots))
    spots: list[ThinSpot] = []
    kinds: tuple[SpotKind, ...] = ("wall", "overlap")
    for kind in kinds:
        places = found[kind][: options.spots]
        by = every() if kind == "overlap" and places else balls
        spots += sorted((_spot(kind, by, place) for place in places), key=lambda spot: spot.value)
    return tuple(spots), len(found["speck"])


def _spot(kind: SpotKind, balls: WallBalls, place: LowPlace) -> ThinSpot:
    surface = balls.surface
    position, opposite, value = balls.thinnest(place)
    area = np.nan if surface.faces is None else float(surface.point_areas[place.vertices].sum())
    return ThinSpot(position, opposite, value, kind, place.vertex, place.vertices, area)
