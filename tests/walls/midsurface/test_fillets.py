"""Midsurfaces of parts with fillets and rounded rims, against the parts without them."""

import numpy as np
import pytest

import medialis
from plates import boxes
from rounded import hollow_section, tee


def least_angles(points, faces):
    corners, angles = points[faces], []
    for j in range(3):
        u = corners[:, (j + 1) % 3] - corners[:, j]
        v = corners[:, (j + 2) % 3] - corners[:, j]
        across = np.linalg.norm(np.cross(u, v), axis=1)
        angles.append(np.degrees(np.arctan2(across, np.einsum("ij,ij->i", u, v))))
    return np.min(angles, axis=0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "stem", "fillet", "segments", "rim"),
    [(2, 2, 1, 3, 0), (2, 2, 4, 6, 0.8), (3, 2, 0.5, 12, 0), (2, 1, 2, 6, 0.4)],
)
def test_a_weld_under_fillets_is_where_the_middles_meet(base, stem, fillet, segments, rim):
    """Sides went on up the fillets: 3 to 6 welds for 1, half of its length, and needles."""
    points, faces = tee(base, stem, 60, 40, fillet, 50, segments, rim)
    found = medialis.midsurface(medialis.make_shape(points, faces))
    assert (found.sheets, found.welds) == (2, 1)
    off = np.minimum(np.abs(found.points[:, 1] - base / 2), np.abs(found.points[:, 0]))
    assert off.max() < 1e-3 * 12.5  # balls are good to the tolerance, 1e-3 of the diagonal
    away = np.hypot(found.points[:, 0], found.points[:, 1] - base / 2) > 2 * max(base, stem)
    assert np.quantile(off[away], 0.99) < 1e-3 * min(base, stem)
    ends = found.points[found.weld_edges]
    assert ends[..., :2] == pytest.approx(
        np.broadcast_to([0, base / 2], (*ends.shape[:2], 2)), abs=0.02
    )
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(50, rel=2e-3)
    # Rims end where they would without rounding.
    assert found.areas.sum() == pytest.approx((60 + 40 + base / 2) * 50, rel=2e-3)
    on_base = off == np.abs(found.points[:, 1] - base / 2)
    told = found.thickness[away] / np.where(on_base[away], base, stem)
    assert np.abs(told - 1).max() < 5e-3
    angles = least_angles(found.points, found.faces)
    assert angles.min() > 10 and np.quantile(angles, 0.05) > 25


@pytest.mark.slow
@pytest.mark.parametrize("segments", [3, 6])
def test_bends_of_a_hollow_section_are_walls(segments):
    found = medialis.midsurface(medialis.make_shape(*hollow_section(100, 70, 2, 6, 30, segments)))
    assert (found.sheets, found.welds) == (1, 0)
    x, y = np.abs(found.points[:, :2]).T
    corner = np.maximum(np.stack([x - 44, y - 29], axis=1), 0.0)
    round_ = corner.all(axis=1)
    flat = np.minimum(np.abs(x - 49), np.abs(y - 34))
    off = np.where(round_, np.abs(np.linalg.norm(corner, axis=1) - 5), flat)
    # Half of a hundredth of the thickness on flat walls; in bends of chords of 30 degrees more.
    assert np.quantile(off[~round_], 0.99) < 0.01 and off.max() < 0.08
    around = 2 * (88 + 58) + 2 * np.pi * 5
    assert found.areas.sum() == pytest.approx(30 * around, rel=5e-3)


@pytest.mark.parametrize("rounding", [pytest.param(1e-5, marks=pytest.mark.slow), 1e-6])
def test_rounding_of_a_symmetric_part_makes_no_sliver(rounding):
    """Vertices that lay on a weld but for rounding got others beside them, 0 mm off, and a weld
    of its own began there."""
    points, faces = boxes(
        (0, 70, 0, 60, 0, 3), (8, 62, 29, 31, 3, 15), (34.25, 35.75, 8, 52, 3, 15)
    )
    points = points + np.random.default_rng(2).uniform(-rounding, rounding, points.shape)
    result = medialis.run("midsurface", medialis.make_shape(points, faces))
    lengths = [weld["length"] for weld in result.values["weld_list"]]
    assert sorted(lengths) == pytest.approx([13.5, 44.0, 54.0], rel=1e-4)
    layer = result.layers[0]
    assert least_angles(layer.points, layer.faces).min() > 10
