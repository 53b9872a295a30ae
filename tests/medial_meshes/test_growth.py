"""The inside of a solid with a wanted topology, from samples that do not give it."""

from dataclasses import replace

import numpy as np
import pytest

from closed_forms import box_mesh, icosphere, torus_mesh
from medialis.medial_meshes.fine_complex import Cells, _build, grown
from medialis.medial_meshes.sampling import Solid, take_samples


def cells_of(shape, samples=800):
    """Delaunay tetrahedra of samples of a shape."""
    solid = Solid(shape.points / shape.diagonal, shape.faces)
    return Cells.of(solid, take_samples(solid, samples, 0))


def betti(cells, inside):
    """Betti numbers of the dual of these tetrahedra, by elimination."""
    return _build(replace(cells, inside=inside), 0.0).betti


@pytest.mark.parametrize("shape", [icosphere(3), box_mesh(), torus_mesh()])
@pytest.mark.parametrize("loops", [0, 1, 3])
def test_as_many_loops_as_wanted(shape, loops):
    """One of 20 inside tetrahedra is taken away: the dual has dozens of loops and hollows.

    What is grown from the rest has one part, no hollow, and the loops asked for: the sets grown
    check every step locally, the numbers come from the whole complex.
    """
    cells = cells_of(shape)
    lost = np.random.default_rng(1).random(len(cells.inside)) < 0.05
    torn = replace(cells, inside=cells.inside & ~lost)
    assert sum(betti(torn, torn.inside)[1:]) > 10
    assert betti(torn, grown(torn, loops)) == (1, loops, 0)


def test_the_loop_of_a_torus_goes_round_it():
    """Of all seams the one that closes the long loop is closed: balls are in all directions."""
    cells = cells_of(torus_mesh())
    lost = np.random.default_rng(2).random(len(cells.inside)) < 0.05
    torn = replace(cells, inside=cells.inside & ~lost)
    cut, closed = (betti_loop(torn, grown(torn, loops)) for loops in (0, 1))
    assert not cut and closed


def betti_loop(cells, inside):
    """Tell whether ways through the tetrahedra wind round the axis: angles that do not add up."""
    a, side = np.nonzero(inside[:, None] & (cells.neighbours >= 0))
    b = cells.neighbours[a, side]
    a, b = a[inside[b]], b[inside[b]]
    turn = np.arctan2(cells.centers[:, 1], cells.centers[:, 0])
    steps = (turn[b] - turn[a] + np.pi) % (2 * np.pi) - np.pi
    angle = np.full(len(inside), np.nan)
    angle[np.flatnonzero(inside)[0]] = 0.0
    for _ in range(len(inside)):
        known = ~np.isnan(angle[a]) & np.isnan(angle[b])
        if not known.any():
            break
        angle[b[known]] = angle[a[known]] + steps[known]
    both = ~np.isnan(angle[a]) & ~np.isnan(angle[b])
    return bool((np.abs(angle[b] - angle[a] - steps)[both] > 3).any())
