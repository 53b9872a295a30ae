"""Tubes of constant radius round given curves: shapes whose curve skeleton is known."""

import numpy as np
from scipy.spatial import cKDTree

from medialis.shape.generate import make_unambiguous, surface_nets
from medialis.shape.normals import vertex_normals
from medialis.shape.shape import Shape

AXES = np.concatenate([np.eye(3), -np.eye(3)])
FORK = np.array([[1, 0, 0], [-0.5, 0.75**0.5, 0], [-0.5, -(0.75**0.5), 0]])


def tube(curves, radius, cell):
    """Surface at a distance from curves, each (p, 3), with the cell of its grid as spacing.

    The curves are sampled so densely that the distance is right to 1e-4 of the radius.
    """
    dense = np.concatenate([dense_curve(np.asarray(c, float), radius / 70) for c in curves])
    tree = cKDTree(dense)
    low = dense.min(axis=0) - radius - 2.31 * cell
    count = np.ceil((np.ptp(dense, axis=0) + 2 * radius + 4.7 * cell) / cell).astype(int)
    axes = [low[k] + cell * np.arange(count[k] + 1) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = tree.query(grid.reshape(-1, 3))[0].reshape(grid.shape[:3]) - radius
    make_unambiguous(distance)
    points, faces = surface_nets(distance, low, cell)
    for _ in range(2):
        nearest = dense[tree.query(points)[1]]
        away = points - nearest
        points = nearest + radius * away / np.linalg.norm(away, axis=1, keepdims=True)
    return Shape(points, vertex_normals(points, faces), faces)


def dense_curve(points, step):
    """Points along a polyline, at most `step` apart."""
    reach = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0], np.cumsum(reach)])
    wanted = np.linspace(0, along[-1], int(np.ceil(along[-1] / step)) + 1)
    return np.stack([np.interp(wanted, along, points[:, k]) for k in range(3)], axis=1)


def segment(a, b):
    return np.array([a, b], float)


def arc(center, radius, start, stop, count=400):
    """Part of a circle in the plane z = center z, angles in radians."""
    turn = np.linspace(start, stop, count)
    zero = np.zeros(count)
    return np.asarray(center) + radius * np.stack([np.cos(turn), np.sin(turn), zero], axis=1)


def circle(center, radius):
    return arc(center, radius, 0, 2 * np.pi)


def distance_to(points, curves, step=1e-3):
    """Distance of points to the nearest of the curves."""
    dense = np.concatenate([dense_curve(np.asarray(c, float), step) for c in curves])
    return cKDTree(dense).query(points)[0]


def hub(directions, cell, *, ball, arm=0.25, length=2.0):
    """Arms, capsules from the origin, joined with a ball: mesh, and the body of each vertex.

    0 is the ball, 1 + i arm i: that whose surface is nearest.
    """
    side = np.arange(-length - 4.2 * cell, length + 4.2 * cell, cell)
    grid = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1)

    def distances(at):
        found = [np.linalg.norm(at, axis=-1) - ball]
        for one in directions:
            along = np.clip(at @ one, 0, length - arm)[..., None]
            found.append(np.linalg.norm(at - along * one, axis=-1) - arm)
        return np.stack(found)

    field = distances(grid).min(axis=0)
    make_unambiguous(field)
    points, faces = surface_nets(field, np.full(3, side[0]), cell)
    shape = Shape(points, vertex_normals(points, faces), faces)
    return shape, distances(points).argmin(axis=0)


def capsules(curves, radii, cell):
    """Surface of the union of tubes, each with its own radius; creases where they meet."""
    dense = [
        dense_curve(np.asarray(c, float), 0.05 * r) for c, r in zip(curves, radii, strict=True)
    ]
    trees = [cKDTree(rows) for rows in dense]
    low = np.min([d.min(axis=0) - r for d, r in zip(dense, radii, strict=True)], axis=0)
    high = np.max([d.max(axis=0) + r for d, r in zip(dense, radii, strict=True)], axis=0)
    low = low - 2.31 * cell
    count = np.ceil((high - low + 2.4 * cell) / cell).astype(int)
    axes = [low[k] + cell * np.arange(count[k] + 1) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    each = [t.query(grid)[0] - r for t, r in zip(trees, radii, strict=True)]
    distance = np.min(each, axis=0).reshape([len(axis) for axis in axes])
    make_unambiguous(distance)
    points, faces = surface_nets(distance, low, cell)
    return Shape(points, vertex_normals(points, faces), faces)
