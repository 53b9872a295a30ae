"""Where the joints of a figure are: shoulders and hips inside the body, elbows and knees in bends.

A limb is measured along its part of the curve skeleton (`Strand`). Its root lies on the straight
line of its first bone, about a radius inside the body (`_root`). The other joints are those of the
cheapest chain: bones that leave the middle cost, places thicker than what is beside them cost, and
shares of the length that are unusual for the kind cost least (`_chain`). A bent joint is moved to
where the lines of its two bones meet, as curve skeletons cut corners. Joints of both sides are
mirror images where the shape is its own (`mirror_plane`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import kd_tree, places_along, rows_at, unit_rows
from medialis.base.validation import FloatArray
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.rigging.limbs import Plane

PLACES = 96  # halved 0.3 %, doubled 0.5 %
"""Places along a limb at which a joint may be."""

OFF_MIDDLE = 0.15  # halved 0.4 %, doubled 0.4 %
"""Root mean square of the distance of a bone from the middle, in radii, that costs one."""

UNUSUAL = 0.08  # halved 0.5 %, doubled 0.6 %
"""Distance of a joint from its usual share of the length that costs one."""

THIN = 0.1  # halved < 0.1 %, doubled 0.1 %
"""Logarithm of the radius beside a joint over that at it that is worth one."""

BESIDE = 0.12  # halved 0.2 %, doubled 0.3 %
"""Share of the length within which it is looked for thicker places."""

SKIPPED, THICKER = 0.12, 1.12
"""Inside the body an arm is so many times thicker than anywhere beyond this share of its length."""

INSIDE, HANGING = 0.1, 1.5
"""Radii that a shoulder is inside of where an arm leaves the body, and those more of one that hangs
straight down."""

UPPER_ARM = 1.1
"""Usual length of the upper arm, of that of the forearm."""

BEYOND = 0.3  # halved 0.5 %, doubled 2 %
"""Last radii by which a limb goes on beyond the end of its curve, the middle of its tip."""

HIPS, HIPS_OF_FOUR = -0.38, -0.25
"""Height of the hips over the fork of the legs, in its radii: of bipeds, and of quadrupeds."""

CORNER = 25.0  # halved 0.4 %, doubled 0 %
"""Degrees of a bend from which on its joint is where the lines of its bones meet."""

ARM, LEG = (0.42, 0.775), (0.42, 0.82)
"""Usual shares of elbow and wrist from shoulder to fingertip; of knee and ankle from hip to toe."""

ARM_TO_PALM = (0.47, 0.86)
"""Usual shares of elbow and wrist from shoulder to where fingers part."""

PAW = (0.375, 0.71, 0.89)
"""Usual shares of the joints of a quadruped's leg."""

SPINE = (0.28, 0.62)
"""Usual shares of the joints of the spine of a biped, from hips to neck."""

MIRRORED = 0.006  # halved 1.0 %, doubled 0 %
"""Median distance of the mirror image from the surface, of the size, of symmetric shapes: scans
with noise of 0.3 % are."""


@dataclass(frozen=True)
class Strand:
    """A limb at even places along it: positions and radii (n, 4), from the body to its tip."""

    table: FloatArray

    @classmethod
    def of(cls, curve: CurveSkeleton, nodes: list[int], places: int = PLACES) -> Strand:
        """Sample the curve skeleton along nodes, and go on to the surface."""
        table = np.column_stack([curve.nodes[nodes], curve.radii[nodes]])
        return cls(_even(_with_tip(table), places))

    @property
    def points(self) -> FloatArray:
        """Positions, (n, 3)."""
        return self.table[:, :3]

    @property
    def radii(self) -> FloatArray:
        """Radii, (n,)."""
        return self.table[:, 3]

    @property
    def length(self) -> float:
        """Length of all of it."""
        return float(places_along(self.points)[-1])

    def at(self, share: float) -> FloatArray:
        """Return the position at a share of the length, (3,)."""
        places = np.linspace(0.0, 1.0, len(self.table))
        return rows_at(share, places, self.points)

    def share_of(self, point: FloatArray) -> float:
        """Return the share of the length nearest to a point."""
        return float(np.linalg.norm(self.points - point, axis=1).argmin() / (len(self.table) - 1))


def _with_tip(table: FloatArray) -> FloatArray:
    """Go on by the last radius: curve skeletons end so far before the surface."""
    places = places_along(table[:, :3])
    reach = 1.5 * table[-1, 3]
    start = rows_at(places[-1] - reach, places, table[:, :3])
    way = table[-1, :3] - start
    size = float(np.linalg.norm(way))
    if size == 0:
        return table
    tip = np.append(table[-1, :3] + BEYOND * way / size * table[-1, 3], table[-1, 3])
    return np.vstack([table, tip])


def _even(table: FloatArray, count: int) -> FloatArray:
    places = places_along(table[:, :3])
    along = np.linspace(0.0, places[-1], count)
    return rows_at(along, places, table)


def mirror_plane(points: FloatArray, normal: FloatArray, offset: float) -> Plane | None:
    """Return the plane near to one under which points are their own mirror image, else None.

    Parameters
    ----------
    points : (n, 3) float64
    normal : (3,) float64
        Unit.
    offset : float
    """
    size = float(np.ptp(points, axis=0).max())
    some = points[:: max(len(points) // 3000, 1)]
    tree = kd_tree(points, near=False)
    plane = Plane(normal, offset)
    for _ in range(12):
        apart, near = tree.query(plane.image(some))
        close = apart <= max(2.0 * float(np.median(apart)), 1e-12 * size)
        p, q = some[close], points[near[close]]
        product = (p - p.mean(axis=0)).T @ (q - q.mean(axis=0))
        found = np.linalg.eigh(product + product.T)[1][:, 0]
        found = found if found @ plane.normal > 0 else -found
        if found @ normal < 0.8:
            return None
        plane = Plane(found, float(found @ (p.mean(axis=0) + q.mean(axis=0)) / 2))
    apart = tree.query(plane.image(some))[0]
    own = tree.query(some, k=2)[0][:, 1]
    allowed = MIRRORED * size + float(np.median(own)) / 2
    fits = np.median(apart) <= allowed and np.quantile(apart, 0.95) <= 4 * allowed
    return plane if fits else None


def limb_joints(strand: Strand, shares: tuple[float, ...], root: FloatArray) -> FloatArray:
    """Return the joints of a limb from its root to its tip, (k + 2, 3).

    Parameters
    ----------
    strand : Strand
        From the middle of the body on.
    shares : tuple of k floats
        Where the joints between are as a rule, of the way from the root to the tip.
    root : (3,) float64
        Shoulder or hip.
    """
    away = np.linalg.norm(strand.points - root, axis=1)
    first = int(away.argmin())
    reach = max(away[first], strand.radii[first])
    first = min(first + int((away[first:] > reach).argmax()), len(away) // 2)
    table = np.vstack([np.append(root, strand.table[first, 3]), strand.table[first:]])
    inner = Strand(_even(table, PLACES))
    rows = _chain(inner, shares)
    return _corners(inner, rows, inner.points[rows].copy())


def arm_joints(strand: Strand, base: float, up: FloatArray, palm: bool) -> FloatArray:
    """Return shoulder, elbow, wrist and tip, (4, 3).

    The shoulder is between where the arm leaves the body and where the forearm lets one expect it.
    """
    root = shoulder(strand, base, up)
    shares = ARM_TO_PALM if palm else ARM
    joints = limb_joints(strand, shares, root)
    wanted = UPPER_ARM * np.linalg.norm(joints[2] - joints[1])
    way = unit_rows(root - joints[1])
    root = root + 0.5 * (wanted - np.linalg.norm(root - joints[1])) * way
    return limb_joints(strand, shares, root)


def shoulder(strand: Strand, base: float, up: FloatArray) -> FloatArray:
    """Return the root of an arm, (3,): a bit inside of where it leaves the body.

    Inside the body it is thicker than anywhere farther on. An arm that hangs down (against `up`,
    unit) lies at the body below its shoulder.
    """
    n = len(strand.table)
    low = min(round(base * (n - 1)), n // 2)
    skip = round(SKIPPED * (n - low))
    onward = np.maximum.accumulate(strand.radii[::-1])[::-1]
    outside = strand.radii[low : n - skip] <= THICKER * onward[low + skip :]
    outer = low + int(outside.argmax())
    first, last = outer + (n - outer) // 12, outer + (n - outer) // 3
    point, way = _line(strand.points[first : last + 1])
    way = way if way @ (strand.points[last] - strand.points[first]) > 0 else -way
    inside = INSIDE + HANGING * max(0.0, -float(way @ up))
    along = float((strand.points[outer] - point) @ way) - inside * float(strand.radii[outer])
    return np.asarray(point + along * way)


def hip(strand: Strand, base: float, up: FloatArray, level: float) -> FloatArray:
    """Return the root of a leg, (3,): on its straight line, so many radii of the fork above it.

    Parameters
    ----------
    strand : Strand
        From the fork on.
    base : float
        Share of the length at which it leaves the ball of the fork.
    up : (3,) float64
        Along the trunk of a biped, against the legs of a quadruped; unit.
    level : float
    """
    n = len(strand.table)
    low = min(round(base * (n - 1)), n // 3)
    point, way = _line(strand.points[low : low + n // 5])
    way = way if way @ (strand.points[low + n // 5] - strand.points[low]) > 0 else -way
    rise = (point - strand.points[0]) @ up - level * strand.radii[0]
    slope = min(float(way @ up), -0.5)
    return np.asarray(point - rise / slope * way)


def _chain(strand: Strand, shares: tuple[float, ...]) -> list[int]:
    """Return the rows of the joints of the cheapest chain of bones, both ends included."""
    n = len(strand.table)
    along = np.linspace(0.0, 1.0, n)
    bone = _off_middle(strand)
    beside = max(round(BESIDE * n), 1)
    smooth = np.log(np.maximum(strand.radii, 0.2 * np.median(strand.radii)))
    above = np.minimum(
        np.array([smooth[max(i - beside, 0) : i + 1].max() for i in range(n)]),
        np.array([smooth[i : i + beside + 1].max() for i in range(n)]),
    )
    thin = -np.minimum((above - smooth) / THIN, 2.0)
    total = np.full(n, np.inf)
    total[0] = 0.0
    before = []
    for share in (*shares, None):
        sums = total[:, None] + bone
        before.append(sums.argmin(axis=0))
        total = sums.min(axis=0)
        if share is not None:
            total = total + ((along - share) / UNUSUAL) ** 2 + thin
    rows = [n - 1]
    for row in before[::-1]:
        rows.append(int(row[rows[-1]]))
    return rows[::-1]


def _off_middle(strand: Strand) -> FloatArray:
    """Return what a bone from row to row costs, (n, n): its squared distances from the middle."""
    n = len(strand.table)
    cost = np.full((n, n), np.inf)
    allowed = (OFF_MIDDLE * np.maximum(strand.radii, 0.5 * np.median(strand.radii))) ** 2
    for i in range(n - 3):
        off = strand.points[i:] - strand.points[i]
        gram = off @ off.T
        ends = np.diagonal(gram)
        share = np.clip(gram / np.maximum(ends, 1e-300)[:, None], 0.0, 1.0)
        apart = ends - 2 * share * gram + share**2 * ends[:, None]
        apart = np.tril(np.maximum(apart, 0.0) / allowed[i:])
        cost[i, i + 3 :] = (apart.sum(axis=1) * 8 / n)[3:]
    return cost


def _corners(strand: Strand, rows: list[int], joints: FloatArray) -> FloatArray:
    """Move bent joints to where the lines of their bones meet."""
    for k in range(1, len(rows) - 1):
        one, other = joints[k] - joints[k - 1], joints[k + 1] - joints[k]
        size = np.linalg.norm(one) * np.linalg.norm(other)
        if size == 0 or one @ other / size > np.cos(np.radians(CORNER)):
            continue
        lines = [
            _line(strand.points[_middle_rows(low, high)])
            for low, high in ((rows[k - 1], rows[k]), (rows[k], rows[k + 1]))
        ]
        found = _nearest_of_lines(*lines)
        if found is None:
            continue
        step = found - joints[k]
        most = 1.5 * strand.radii[rows[k]]
        joints[k] += step * min(1.0, most / max(float(np.linalg.norm(step)), 1e-300))
    return joints


def _middle_rows(low: int, high: int) -> slice:
    margin = (high - low) // 4
    return slice(low + margin, max(high - margin, low + margin + 2) + 1)


def _line(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a point and the direction of the line of least squares."""
    middle = points.mean(axis=0)
    return middle, np.linalg.svd(points - middle)[2][0]


def _nearest_of_lines(
    one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]
) -> FloatArray | None:
    """Return the middle of the shortest way between two lines, None where they are parallel."""
    (a, u), (b, v) = one, other
    across = np.cross(u, v)
    if np.linalg.norm(across) < np.sin(np.radians(0.5 * CORNER)):
        return None
    s, t, _ = np.linalg.solve(np.column_stack([u, -v, across]), b - a)
    return np.asarray((a + s * u + b + t * v) / 2)
