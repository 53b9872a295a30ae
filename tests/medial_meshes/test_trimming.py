"""What an envelope does not need is taken from the rims, and nothing else."""

import numpy as np
import pytest

from medialis.medial_meshes.fins import trimmed
from medialis.medial_meshes.mesh import Complex, betti_numbers

SQUARE = [[0, 0, 0, 1.0], [4, 0, 0, 1.0], [4, 4, 0, 1.0], [0, 4, 0, 1.0]]
EDGES = [[0, 1], [1, 2], [0, 2], [2, 3], [0, 3]]
FACES = [[0, 1, 2], [0, 2, 3]]


def with_stub(ball: list[float]) -> Complex:
    """A slab of two triangles, with one more ball at its first."""
    edges = np.array([*EDGES, [0, 4]])
    return Complex(np.array([*SQUARE, ball]), edges, np.array(FACES))


@pytest.mark.parametrize(("sticks_out", "stays"), [(0.04, 4), (0.06, 5)])
def test_a_stub_goes_where_it_sticks_out_by_less_than_the_bound(sticks_out, stays):
    """A ball beside a corner, with its cone: its farthest point tells."""
    found = trimmed(with_stub([-0.5, 0, 0, 0.5 + sticks_out]), 0.05)
    assert len(found) == stays
    assert np.array_equal(np.sort(found.faces, axis=1), FACES)


def test_a_triangle_within_others_goes_and_its_ball_with_it():
    """Three smaller balls in a slab; a loop of edges would stay."""
    balls = np.array([*SQUARE, [1.5, 1, 0, 0.5], [2, 1.5, 0, 0.5]])
    edges = np.array([*EDGES, [0, 4], [4, 5], [0, 5]])
    found = trimmed(Complex(balls, edges, np.array([*FACES, [0, 4, 5]])), 1e-6)
    assert (len(found), len(found.edges), len(found.faces)) == (4, 5, 2)
    loop = trimmed(Complex(balls, edges, np.array(FACES)), 1e-6)
    assert betti_numbers(len(loop), loop.edges, loop.faces) == (1, 1, 0)
    assert len(loop) == 6
