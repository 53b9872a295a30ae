"""From a solid to shell elements to a deflection: the closed forms of beams, by CalculiX."""

import numpy as np
import pytest

import medialis
from calculix import YOUNG, deflection, needs_ccx, nodes_of
from plates import boxes, extruded, i_beam, shape_of
from rounded import rounded_outline, tee

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


@needs_ccx
@pytest.mark.parametrize("rim", [pytest.param(0.0, marks=pytest.mark.slow), 0.5])
def test_a_strip_with_rounded_rims_bends_as_one_with_sharp_ones(tmp_path, rim):
    """The sheet goes up to the rim: F L^3 / (3 E I) of the strip as it would be without."""
    long, wide, thick = 200.0, 20.0, 2.0
    outline = rounded_outline([(0, 0), (wide, 0), (wide, thick), (0, thick)], [rim] * 4, 8)
    mesh = extruded(outline, long)
    _, path, nodes = shells(tmp_path, mesh, edge=4.0 / shape_of(mesh).diagonal)
    ends = [np.flatnonzero(np.abs(nodes[:, 2] - z) < 1e-3 * long) for z in (0.0, long)]
    found = deflection(path, *ends, axis=1, load=LOAD / 100, poisson=POISSON)
    inertia = wide * thick**3 / 12
    assert found == pytest.approx(LOAD / 100 * long**3 / (3 * YOUNG * inertia), rel=0.02)


@needs_ccx
@pytest.mark.parametrize("fillet", [pytest.param(0.0, marks=pytest.mark.slow), 4.0])
def test_a_tee_with_fillets_bends_as_far_as_its_section_says(tmp_path, fillet):
    """F L^3 / (3 E I) + F L / (G A), with I of the section and its fillets; A is the stem.

    What the sheets have twice at their weld is about as much as the fillets.
    """
    long, thick, wide, high = 1000.0, 4.0, 100.0, 100.0
    mesh = tee(thick, thick, wide, high - thick, fillet, long, 8)
    result, path, nodes = shells(tmp_path, mesh, edge=20.0 / shape_of(mesh).diagonal)
    assert (result.values["sheets"], result.values["welds"]) == (2, 1)
    corners = [(-50, 0), (50, 0), (50, 4), (2, 4), (2, 100), (-2, 100), (-2, 4), (-50, 4)]
    x, y = rounded_outline(corners, [0, 0, 0, fillet, 0, 0, fillet, 0], 8).T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y2 - x2 * y
    area, first = cross.sum() / 2, ((y + y2) * cross).sum() / 6
    inertia = ((y * y + y * y2 + y2 * y2) * cross).sum() / 12 - first**2 / area
    clamped, free = (np.flatnonzero(np.abs(nodes[:, 2] - z) < 1e-3 * long) for z in (0.0, long))
    stem = free[np.abs(nodes[free, 0]) < 1.0]
    found = deflection(path, clamped, stem, axis=1, load=LOAD, poisson=POISSON)
    bent = LOAD * long**3 / (3 * YOUNG * inertia)
    sheared = LOAD * long / (SHEAR * thick * (high - thick / 2))
    assert found == pytest.approx(bent + sheared, rel=0.02)


@needs_ccx
@pytest.mark.parametrize("rim", [pytest.param(0.0, marks=pytest.mark.slow), 0.9])
def test_a_clamped_plate_bends_under_a_load_in_its_middle(tmp_path, rim):
    """0.00560 F a^2 / D (Timoshenko and Woinowsky-Krieger), also with two rounded rims."""
    wide, thick = 200.0, 2.0
    outline = rounded_outline([(0, 0), (wide, 0), (wide, thick), (0, thick)], [rim] * 4, 8)
    mesh = extruded(outline, wide)
    _, path, nodes = shells(tmp_path, mesh, edge=10.0 / shape_of(mesh).diagonal)
    x, z = nodes[:, 0], nodes[:, 2]
    rim_nodes = np.flatnonzero(np.minimum.reduce([x, wide - x, z, wide - z]) < 1e-3 * wide)
    middle = np.argmin((x - wide / 2) ** 2 + (z - wide / 2) ** 2)[None]
    found = deflection(path, rim_nodes, middle, axis=1, load=LOAD / 100, poisson=POISSON)
    stiffness = YOUNG * thick**3 / (12 * (1 - POISSON**2))
    assert found == pytest.approx(0.00560 * LOAD / 100 * wide**2 / stiffness, rel=0.02)
