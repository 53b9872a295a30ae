"""The same shape, told otherwise: turned, scaled, reordered, remeshed, coarse, noisy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import medialis

TURNS = 3


def rotation(rng: np.random.Generator) -> np.ndarray:
    """Return a rotation by chance, (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, ::-1]


def turned(shape: medialis.Shape, turn: np.ndarray) -> medialis.Shape:
    """Turn a shape."""
    return medialis.make_shape(shape.points @ turn.T, shape.faces)


def reordered(shape: medialis.Shape, rng: np.random.Generator) -> medialis.Shape:
    """Renumber vertices and faces by chance."""
    order = rng.permutation(shape.point_count)
    place = np.argsort(order)
    faces = place[np.asarray(shape.faces)][rng.permutation(shape.face_count)]
    return medialis.make_shape(shape.points[order], faces)


def quartered(shape: medialis.Shape) -> medialis.Shape:
    """Cut each face in four; the surface stays."""
    faces, n = np.asarray(shape.faces, np.int64), shape.point_count
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, place = np.unique(sides, axis=0, return_inverse=True)
    middle = n + place.reshape(-1, 3)
    points = np.concatenate([shape.points, shape.points[edges].mean(axis=1)])
    a, b, c = faces.T
    d, e, f = middle.T
    new = [np.stack(t, axis=1) for t in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))]
    return medialis.make_shape(points, np.concatenate(new))


def decimated(shape: medialis.Shape, faces: int) -> medialis.Shape:
    """Leave so many faces by edge collapses with quadric errors (pymeshlab)."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(shape.points, np.asarray(shape.faces)))
    meshes.meshing_decimation_quadric_edge_collapse(
        targetfacenum=faces, preservetopology=True, preservenormal=True, optimalplacement=True
    )
    mesh = meshes.current_mesh()
    return medialis.make_shape(mesh.vertex_matrix(), mesh.face_matrix())


def noisy(shape: medialis.Shape, share: float, rng: np.random.Generator) -> medialis.Shape:
    """Move each vertex by chance; `share` of the diagonal is the standard deviation an axis."""
    move = share * shape.diagonal * rng.normal(size=shape.points.shape)
    return medialis.make_shape(shape.points + move, shape.faces)


def holed(shape: medialis.Shape, rng: np.random.Generator, holes: int = 5) -> medialis.Shape:
    """Leave out the faces within 0.5 % of the diagonal of five vertices, one ring at least."""
    faces = np.asarray(shape.faces)
    middles = rng.choice(shape.point_count, holes, replace=False)
    gone = np.zeros(shape.point_count, bool)
    for one in middles:
        gone[one] = True
        gone |= np.linalg.norm(shape.points - shape.points[one], axis=1) < 0.005 * shape.diagonal
    return medialis.make_shape(shape.points, faces[~gone[faces].any(axis=1)])


Change = Callable[[medialis.Shape], medialis.Shape]


def changes(seed: int = 0) -> dict[str, tuple[Change, float, np.ndarray]]:
    """Return the changes by name: the function, and the scale and the turn that undo it."""

    def random(number: int) -> np.random.Generator:
        return np.random.default_rng([seed, number])

    same = np.eye(3)
    result: dict[str, tuple[Change, float, np.ndarray]] = {
        "vertices reordered": (lambda s: reordered(s, random(1)), 1.0, same)
    }
    for scale in (1e-3, 1e3):
        result[f"scaled by {scale:g}"] = (
            lambda s, k=scale: medialis.make_shape(k * s.points, s.faces),
            scale,
            same,
        )
    for number in range(TURNS):
        turn = rotation(random(10 + number))
        result[f"turned, {number + 1}"] = (lambda s, t=turn: turned(s, t), 1.0, turn)
    result |= {
        "each face in four": (quartered, 1.0, same),
        "half of the faces": (lambda s: decimated(s, s.face_count // 2), 1.0, same),
        "a fifth of the faces": (lambda s: decimated(s, s.face_count // 5), 1.0, same),
        "noise 0.1 %": (lambda s: noisy(s, 0.001, random(20)), 1.0, same),
        "noise 0.3 %": (lambda s: noisy(s, 0.003, random(21)), 1.0, same),
        "noise 1 %": (lambda s: noisy(s, 0.01, random(22)), 1.0, same),
        "five small holes": (lambda s: holed(s, random(23)), 1.0, same),
    }
    return result
