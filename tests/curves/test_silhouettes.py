"""Silhouette skeletons (thesis 3.7.3): closed forms, and a slow oracle for features and arcs."""

import math

import numpy as np
import pytest

import medialis
from medialis.curves.from_views.views import Scratch, runs_of, silhouette_skeleton, skeletonize


def disc(size, center, radius):
    row, col = np.mgrid[:size, :size] + 0.5
    return (row - center[0]) ** 2 + (col - center[1]) ** 2 <= radius**2


def blob(size, seed):
    """A random silhouette with several contours: smoothed noise."""
    noise = np.random.default_rng(seed).normal(size=(size, size))
    for _ in range(6):
        noise = sum(np.roll(noise, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)) / 9
    mask = noise > 0
    mask[[0, -1]] = mask[:, [0, -1]] = False
    return mask


def contours(mask):
    """Cracks in their order along each contour, as (row, col, side) of the shape pixel: oracle.

    A crack leads to the next one at the corner where it ends, with the shape at the right hand; at
    a corner where two shape pixels touch diagonally the way goes from the one to the other.
    """
    sides = {"left": (0, -1), "top": (-1, 0), "right": (0, 1), "bottom": (1, 0)}
    # Corners where the crack starts and ends, going clockwise round the pixel.
    ends = {
        "left": ((1, 0), (0, 0)), "top": ((0, 0), (0, 1)),
        "right": ((0, 1), (1, 1)), "bottom": ((1, 1), (1, 0)),
    }  # fmt: skip
    starts = {}
    for r, c in np.argwhere(mask):
        for side, (dr, dc) in sides.items():
            if not mask[r + dr, c + dc]:
                a, b = ends[side]
                crack = (int(r), int(c), side)
                end = (int(r) + b[0], int(c) + b[1])
                starts.setdefault((int(r) + a[0], int(c) + a[1]), []).append((crack, end))
    found = []
    while starts:
        corner = next(iter(starts))
        chain = []
        while starts.get(corner):
            options = starts[corner]
            if chain and len(options) == 2:  # the other pixel of the diagonal
                last = chain[-1]
                options.sort(key=lambda o, at=last: (o[0][0], o[0][1]) == (at[0], at[1]))
            crack, end = options.pop(0)
            if not options:
                del starts[corner]
            chain.append(crack)
            corner = end
        found.append(chain)
    return found


def middle(crack):
    r, c, side = crack
    return {
        "left": (r + 0.5, c), "right": (r + 0.5, c + 1),
        "top": (r, c + 0.5), "bottom": (r + 1, c + 0.5),
    }[side]  # fmt: skip


def slow_crossings(mask, saliency):
    """Every pixel's nearest background pixel and its crack by brute force; pairs in rows compared.

    Returns {(row, left column)} of pairs that the skeleton passes between; left out, as the second
    value, are pairs with a tie of nearest pixels, where either answer is right.
    """
    place, lengths = {}, []
    for number, chain in enumerate(contours(mask)):
        arc = 0.0
        for crack, after in zip(chain, chain[1:] + chain[:1], strict=True):
            place[crack] = (number, arc)
            arc += math.dist(middle(crack), middle(after))
        lengths.append(arc)
    outside = np.argwhere(~mask)
    facing, tied = {}, set()
    for r, c in np.argwhere(mask):
        squares = ((outside - (r, c)) ** 2).sum(axis=1)
        br, bc = outside[squares.argmin()]
        if (squares == squares.min()).sum() > 1 or abs(r - br) == abs(c - bc):
            tied.add((r, c))
        dr, dc = r - br, c - bc
        if abs(dc) >= abs(dr):
            crack = (br, bc + 1, "left") if dc > 0 else (br, bc - 1, "right")
        else:
            crack = (br + 1, bc, "top") if dr > 0 else (br - 1, bc, "bottom")
        facing[r, c] = place[crack], math.sqrt(squares.min())
    hits, unsure = set(), set()
    for (r, c), ((contour, arc), away) in facing.items():
        if (r, c - 1) not in facing:
            continue
        (other, before), _ = facing[r, c - 1]
        rho = abs(arc - before)
        rho = min(rho, lengths[contour] - rho) if contour == other else sum(lengths) / 2
        if (r, c) in tied or (r, c - 1) in tied or abs(rho - saliency * away) < saliency + 1:
            unsure.add((int(r), int(c) - 1))
        elif rho > max(saliency * away, 6.0):
            hits.add((int(r), int(c) - 1))
    return hits, unsure


@pytest.mark.parametrize("seed", range(4))
def test_crossings_agree_with_brute_force(seed):
    """Holes, wrap-around, diagonal contacts: the kernel finds the pairs that the oracle finds."""
    mask = blob(48, seed)
    assert len(contours(mask)) >= 3
    expected, unsure = slow_crossings(mask, 1.0)
    found = silhouette_skeleton(mask)
    left = np.floor(found.column - 0.5).astype(int)
    pairs = set(zip(found.row.tolist(), left.tolist(), strict=True))
    # A crossing at a pixel center belongs to the pairs on both sides of it.
    whole = found.column % 1 == 0.5
    both = {(r, int(c - 1.5)) for r, c in zip(found.row[whole], found.column[whole], strict=True)}
    assert len(expected) > 20
    assert expected <= pairs | both
    assert pairs - expected - unsure <= {(r, c + 1) for r, c in both}


def test_distance_field_is_exact():
    from scipy.ndimage import distance_transform_edt

    mask = blob(64, 7)
    near = np.where(mask, 0, np.nan).astype(np.float32)
    field, scratch = np.zeros((64, 64), np.float32), Scratch(64)
    skeletonize(runs_of(near, scratch), 1.0, scratch, field)
    expected = np.where(mask, distance_transform_edt(mask) - 0.5, 0)
    assert np.allclose(np.abs(field), expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("width", [2, 3, 8, 9])
def test_bar_has_its_middle(width):
    """Sub-pixel: the middle of an even bar lies between pixels; 45-degree branches end it."""
    mask = np.zeros((60, 40), bool)
    mask[10:50, 12 : 12 + width] = True
    found = silhouette_skeleton(mask)
    inner = (found.row >= 10 + width) & (found.row < 50 - width)
    assert (found.column[inner] == 12 + width / 2).all()
    assert (np.bincount(found.row[inner], minlength=60)[10 + width : 50 - width] == 1).all()
    # The way from side to side round the nearer end: the width and twice the way to it, at corners
    # shorter by 2 - sqrt(2) each; features lie within half a pixel of the row.
    rows = found.row[inner]
    ends = np.minimum(rows - 10, 49 - rows) + 0.5
    assert np.allclose(found.importance[inner], width + 2 * ends, rtol=0, atol=2.5)


def test_ring_has_its_circle():
    """Two contours count as the longest; every crossing is midway between them, up to the pixels.

    Each contour lies within half a diagonal of a pixel of its circle, so the middle is off by at
    most that across the ring; along a row it is that over the cosine of the slope.
    """
    mask = disc(96, (48, 48), 40) & ~disc(96, (48, 48), 20)
    found = silhouette_skeleton(mask)
    x, y = found.column - 48, found.row + 0.5 - 48
    steep = np.abs(y) < 20
    assert steep.sum() > 50
    assert np.allclose(np.hypot(x, y)[steep], 30, rtol=0, atol=math.sqrt(0.5))
    outer = 2 * math.pi * 40
    assert (found.importance[steep] > outer / 2).all()


def test_saliency_prunes_and_keeps_ends():
    """Higher saliency keeps a subset; a notch of one pixel makes no branch at the default."""
    mask = disc(128, (64, 64), 50)
    mask[13:16, 64] = True
    low, default = (silhouette_skeleton(mask, saliency=s) for s in (0.05, 1.0))
    assert len(default.column) < 0.2 * len(low.column)
    away = np.hypot(default.column - 64, default.row + 0.5 - 64)
    assert (away[default.row > 20] < 5).all()


def test_empty_and_small_masks():
    assert len(silhouette_skeleton(np.zeros((5, 7))).column) == 0
    assert len(silhouette_skeleton(np.ones((1, 1))).column) == 0
    mask = blob(32, 1)
    copy = mask.copy()
    silhouette_skeleton(mask)
    assert (mask == copy).all()


@pytest.mark.parametrize(
    "mask", [np.ones(3), np.ones((2, 2, 2)), np.array([["a"]]), np.ones((0, 3))]
)
def test_bad_masks(mask):
    with pytest.raises(medialis.InvalidShapeError, match="mask must be"):
        silhouette_skeleton(mask)


@pytest.mark.parametrize("saliency", [-1, math.nan, "x", 1e9])
def test_bad_saliency(saliency):
    with pytest.raises(medialis.InvalidOptionError, match="saliency must be"):
        silhouette_skeleton(np.ones((4, 4)), saliency=saliency)
