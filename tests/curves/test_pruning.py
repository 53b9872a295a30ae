"""What is no limb, on graphs drawn by hand."""

import numpy as np
import pytest

from medialis.curves._kernels import BallLinks
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.finishing import _no_limbs

TRUNK, LIMB = np.arange(-10, 11) * 0.5, np.arange(1, 9) * 0.5
HALF_BALL = 2 * np.pi


def with_a_limb(radius, width, hangs, area):
    """Return which nodes are of no limb: a trunk of radius 1 with a limb four long in its middle.

    `width` is half the width on the limb, `hangs` what hangs on each of its nodes (0: no
    candidate), `area` what lies beside each.
    """
    trunk = np.column_stack([TRUNK, 0 * TRUNK, 0 * TRUNK])
    limb = np.column_stack([0 * LIMB, LIMB, 0 * LIMB])
    nodes, t, k = np.concatenate([trunk, limb]), len(TRUNK), len(LIMB)
    edges = [(i, i + 1) for i in range(t - 1)]
    edges += [(10, t), *((t + i, t + i + 1) for i in range(k - 1))]
    radii = np.concatenate([np.ones(t), np.full(k, radius)])
    graph = CurveSkeleton.of(nodes, edges, radii)
    widths = np.concatenate([np.ones(t), np.full(k, width)])
    known = np.concatenate([np.full(t, HALF_BALL), np.broadcast_to(hangs, k)])
    areas = np.concatenate([np.full(t, np.pi), np.full(k, area)])
    none = np.empty(0)
    links = BallLinks(nodes, radii, np.zeros(t + k + 1, int), none, none, none, 0.5, widths)
    gone = _no_limbs(graph, links, np.arange(t + k), known, areas)
    assert not gone[:t].any()
    return gone[t:]


def test_a_limb_stays_and_what_is_wider_than_long_goes():
    cap = HALF_BALL * 0.3**2
    assert not with_a_limb(0.3, 0.3, cap, np.pi * 0.3).any()
    assert not with_a_limb(0.3, 3.9, cap, np.pi * 0.3).any()
    assert with_a_limb(0.3, 4.1, cap, np.pi * 0.3).all()


def test_what_leads_across_a_sheet_goes():
    """Only its end is a candidate: a seventh of the way outside the ball at its base."""
    cap = HALF_BALL * 0.3**2
    assert with_a_limb(0.3, 0.3, np.where(LIMB == 4, cap, 0), 1.0).all()
    assert not with_a_limb(0.3, 0.3, np.where(LIMB >= 3, cap, 0), 1.0).any()


def test_a_way_that_goes_on_behind_its_last_candidate_ends_there():
    cap = HALF_BALL * 0.3**2
    assert (with_a_limb(0.3, 0.3, np.where(LIMB < 3, cap, 0), 1.0) == (LIMB >= 3)).all()


@pytest.mark.parametrize(("area", "goes"), [(4.0, True), (1.0, False)])
def test_a_short_limb_ends_with_a_cap(area, goes):
    """Of a limb longer than half round the end may be far from where it was measured."""
    assert with_a_limb(0.3, 0.3, 31 * 0.3**2, area).all() == goes
    assert not with_a_limb(0.3, 0.3, 29 * 0.3**2, area).any()
