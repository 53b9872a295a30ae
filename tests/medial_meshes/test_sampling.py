"""Samples of surfaces: how many, and of what."""

import numpy as np
import pytest

from medialis.medial_meshes.sampling import CANDIDATES, FINEST, PIECES, Solid, _cut, take_samples


def needle(width):
    """A closed prism of length 1 and this width, of 8 faces as long as it."""
    ring = width * np.array([[0, 0], [1, 0], [0, 1]])
    points = np.concatenate([np.column_stack([ring, np.full(3, z)]) for z in (0.0, 1.0)])
    sides = [(i, (i + 1) % 3) for i in range(3)]
    faces = [(0, 2, 1), (3, 4, 5)]
    faces += [face for a, b in sides for face in ((a, b, b + 3), (a, b + 3, a + 3))]
    return Solid(points, np.array(faces, np.int32))


@pytest.mark.parametrize("width", [0.1, 1e-3, 1e-6])
def test_needles_are_cut_into_few_pieces(width):
    """Halved across their longest sides only, needles have no more pieces than samples need."""
    solid = needle(width)
    pieces = _cut(solid, 0.1 * np.sqrt(solid.surface.area), PIECES * 1000)
    assert len(pieces.face) <= len(solid.faces) + PIECES * 1000
    assert np.allclose(np.bincount(pieces.face, pieces.areas), solid.surface.face_areas)
    corners = np.einsum("pij,pjk->pik", pieces.weights, solid.points[solid.faces[pieces.face]])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.allclose(np.linalg.norm(cross, axis=1) / 2, pieces.areas, rtol=1e-6, atol=1e-18)
    samples = take_samples(solid, 1000, 0)
    most = 1.5 * CANDIDATES * 1000 * FINEST**2  # all candidates, with the smallest spacing
    assert 300 < (samples.owner == np.arange(len(samples.owner))).sum() < most
