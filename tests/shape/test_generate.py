"""The generated creature is a clean closed surface."""

import numpy as np
import pytest

from medialis.base.errors import InvalidOptionError
from medialis.base.threads import thread_limit
from medialis.shape.generate import organic_shape
from oracles import edge_uses, euler_number


@pytest.mark.slow
@pytest.mark.parametrize("resolution", [56, 64, 77, 101])
def test_creature_is_a_closed_manifold_of_genus_0(resolution):
    shape = organic_shape(resolution)
    faces = shape.faces
    assert set(edge_uses(faces).values()) == {2}
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed)  # neighbours agree on the outside
    assert (np.unique(faces) == np.arange(shape.point_count)).all()
    assert shape.components.max() == 0
    assert euler_number(faces) == 2
    # With Euler number 2, one component and two faces an edge, a pinched vertex is impossible
    # unless another handle made up for it: each vertex has one fan.
    across = shape.face_adjacency
    for vertex in range(0, shape.point_count, 7):
        fan = set(np.flatnonzero((faces == vertex).any(axis=1)).tolist())
        reached, todo = set(), [next(iter(fan))]
        while todo:
            face = todo.pop()
            reached.add(face)
            todo += [int(g) for g in across[face] if int(g) in fan - reached]
        assert reached == fan


@pytest.mark.slow
def test_faces_and_normals_look_outward():
    """From 100 on: on coarser grids a few faces of the tail, one cell wide, fold over."""
    shape = organic_shape(100)
    a, b, c = np.moveaxis(shape.points[shape.faces], 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0).all()
    assert np.linalg.norm(shape.normals, axis=1) == pytest.approx(1, abs=1e-12)


def test_creature_is_of_the_stated_size():
    shape = organic_shape(64)
    low, high = shape.bounds
    assert 2.4 < (high - low).max() < 3.0
    assert abs(low[1] + high[1]) < 1e-2  # the two sides mirror each other


@pytest.mark.slow
def test_vertices_grow_with_the_square_of_the_resolution():
    few, many = organic_shape(60).point_count, organic_shape(120).point_count
    assert 3 < many / few < 5


@pytest.mark.slow
def test_result_is_deterministic():
    with thread_limit(1):
        one = organic_shape(60)
    two = organic_shape(60)
    assert one.points.tobytes() == two.points.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()


@pytest.mark.parametrize("resolution", [55, 601, 60.5, "64", None])
def test_bad_resolution(resolution):
    with pytest.raises(InvalidOptionError, match="resolution"):
        organic_shape(resolution)
