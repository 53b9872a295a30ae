"""From a solid to shell elements to a deflection: the closed forms of beams, by CalculiX."""

import numpy as np
import pytest

import medialis
from calculix import YOUNG, deflection, needs_ccx, nodes_of
from plates import boxes, i_beam, shape_of

LOAD, POISSON = 1000.0, 0.3
SHEAR = YOUNG / (2 * (1 + POISSON))


def shells(tmp_path, mesh, **options):
    """The midsurface of a solid as a file for CalculiX, and where its nodes are."""
    result = medialis.run("midsurface", shape_of(mesh), **options)
    path = tmp_path / "part.ccx.inp"
    medialis.write_mesh(path, result)
    return result, path, nodes_of(path)


@pytest.mark.slow
@needs_ccx
@pytest.mark.parametrize("edge", [4.0, 8.0])
def test_a_clamped_strip_bends_as_far_as_a_beam(tmp_path, edge):
    """F L^3 / (3 E I); the clamp holds its width as well, which makes it a little stiffer."""
    long, wide, thick = 200.0, 20.0, 2.0
    mesh = boxes((0, long, 0, wide, 0, thick))
    diagonal = shape_of(mesh).diagonal
    result, path, nodes = shells(tmp_path, mesh, refine=0.01, edge=edge / diagonal)
    assert result.values["sheets"] == 1
    ends = [np.flatnonzero(np.abs(nodes[:, 0] - x) < 1e-3 * long) for x in (0.0, long)]
    found = deflection(path, *ends, axis=2, load=LOAD / 100, poisson=POISSON)
    inertia = wide * thick**3 / 12
    assert found == pytest.approx(LOAD / 100 * long**3 / (3 * YOUNG * inertia), rel=0.03)


@needs_ccx
@pytest.mark.slow
def test_an_i_beam_bends_as_far_as_timoshenko_says(tmp_path):
    """F L^3 / (3 E I) + F L / (G A): A is the web between the middles of the flanges.

    Sheets overlap by half a wall at the welds, which adds 2.1 % to I here.
    """
    long, high, thick = 1000.0, 100.0, 5.0
    mesh = i_beam(length=long, width=high, height=high, web=thick, flange=thick)
    diagonal = shape_of(mesh).diagonal
    result, path, nodes = shells(tmp_path, mesh, refine=0.006, edge=12 / diagonal)
    assert (result.values["sheets"], result.values["welds"]) == (3, 2)
    clamped, free = (np.flatnonzero(np.abs(nodes[:, 2] - z) < 1e-3 * long) for z in (0.0, long))
    web = free[np.abs(nodes[free, 0]) < 1e-2 * high]
    found = deflection(path, clamped, web, axis=1, load=LOAD, poisson=POISSON)
    inertia = (high * high**3 - (high - thick) * (high - 2 * thick) ** 3) / 12
    bent = LOAD * long**3 / (3 * YOUNG * inertia)
    sheared = LOAD * long / (SHEAR * thick * (high - thick))
    assert found == pytest.approx(bent + sheared, rel=0.03)
