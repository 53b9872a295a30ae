"""Nested dissection: each vertex once, halves that do not touch, and factors that stay small."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

import closed_forms as forms
import medialis
from medialis.shape.graph import LEAF, dissected
from medialis.shape.surface import link_matrix


def _filled(shape: medialis.Shape, order: np.ndarray) -> int:
    """Count the entries of the factors of the graph's Laplacian plus one."""
    links = link_matrix(shape.point_count, shape.edges)
    matrix = (diags_array(links.sum(axis=1) + 1.0) - links).tocsr()[order][:, order]
    options = {"SymmetricMode": True}
    return splu(csc_array(matrix), permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options).nnz


@pytest.mark.parametrize("levels", [0, 2, 4])
def test_each_vertex_comes_once(levels):
    shape = forms.icosphere(levels)
    order = dissected(shape.points, shape.edges)
    assert np.array_equal(np.sort(order), np.arange(shape.point_count))


@pytest.mark.slow
def test_factors_grow_little_faster_than_the_mesh():
    """Minimum degree took minutes and gigabytes on a scan of 537,000 vertices."""
    small, large = forms.icosphere(3), forms.icosphere(4)
    fills = [_filled(s, dissected(s.points, s.edges)) for s in (small, large)]
    assert fills[1] < 6 * fills[0]  # n log n: 4.6; in the order of the mesh: 8 and more
    assert 4 * fills[1] < _filled(large, np.arange(large.point_count))


def test_a_hub_goes_and_not_its_spokes():
    """The rim of a fan hangs together by its hub alone: cutting all spokes filled the factors."""
    count = 40 * LEAF
    turn = 2 * np.pi * np.arange(count) / count
    points = np.vstack([np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), np.zeros(3)])
    i = np.arange(count)
    faces = np.stack([i, (i + 1) % count, np.full(count, count)], axis=1)
    fan = medialis.make_shape(points, faces)
    assert _filled(fan, dissected(fan.points, fan.edges)) < 40 * count
