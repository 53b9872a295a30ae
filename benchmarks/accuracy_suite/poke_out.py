"""How many balls poke out of the triangles of the surface, by more than facets explain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import medialis
from medialis.base.box_tree import NearestTree, nearest_on_triangles
from medialis.shape.surface import piece_labels
from medialis.skeleton.medial_cloud import DEFAULT_TOLERANCE

CREASE = 30.0
"""Degrees: an edge that bends by more is a crease, and its faces are walls of each other."""

SLACK = 1.1
"""Tolerances that a ball may poke out by."""


@dataclass(frozen=True)
class PokeOut:
    """How far balls poke out of a surface.

    Attributes
    ----------
    balls : int
        Inner balls with two contacts: all that are judged.
    share : float
        Per cent of them that poke out by more than 1.1 tolerances and the sagitta at their two
        contacts, the angle a taken from the vertex normal.
    share_at_creases : float
        The same, where creases are walls: a is taken from the normal of the smooth fan that the
        face belongs to. At least `share`, but for normals that differ by the split.
    tenth : float
        Per cent that poke out by more than a tenth of their radius, and more than 1.1 tolerances
        and the sagitta.
    worst : float
        The largest excess over what `share` allows, per cent of the diagonal; 0 where none is.
    rows : (p,) int
        The balls that `share` counts, as rows of the cloud.
    """

    balls: int
    share: float
    share_at_creases: float
    tenth: float
    worst: float
    rows: np.ndarray


def poke_out(cloud: medialis.MedialCloud, tolerance: float = DEFAULT_TOLERANCE) -> PokeOut:
    """Measure how many inner balls poke out of the surface that they were computed from.

    Parameters
    ----------
    cloud : MedialCloud
        Of a triangle mesh.
    tolerance : float
        Fraction of the diagonal: the one that the balls were shrunk with.

    Returns
    -------
    PokeOut

    Notes
    -----
    A ball (c, r) pokes out by r - |c - S|, |c - S| the exact distance of its center to the nearest
    triangle of S = ``cloud.surface``. It may do so by 1.1 tolerances, and by the sagitta: a ball
    that touches a smooth surface at a vertex of its mesh, with the center on the normal there, is
    r cos a away from the plane of a face at an angle a to that normal, so it pokes through that
    face by r (1 - cos a), however good it is. Both contacts (feature points) count, and at each
    those of the faces round the vertex that the ball pokes through; the largest of these sagittas
    is what the ball is allowed. Where a contact is a place between the corners of a face, that
    face counts with the normal there, interpolated from its corners, and so do the faces round the
    corner nearest to it, which is the feature point.
    """
    balls = cloud.subset(cloud.valid & (cloud.side > 0))
    surface, radii = balls.surface, balls.radii
    tree = NearestTree.of_triangles(surface.points, surface.faces)
    out = radii - tree.distances(balls.centers)[0]
    corner, ball = _corners_at_contacts(balls)
    by_vertex = surface.normals[surface.faces.ravel()]
    slack = SLACK * tolerance * surface.diagonal
    excess = out - slack - _sagitta(balls, corner, ball, by_vertex)
    strict = out - slack - _sagitta(balls, corner, ball, fan_normals(surface))
    given = np.flatnonzero(cloud.valid & (cloud.side > 0))
    return PokeOut(
        len(radii),
        100 * float((excess > 0).mean()),
        100 * float((strict > 0).mean()),
        100 * float(((excess > 0) & (out > 0.1 * radii)).mean()),
        100 * max(0.0, float(excess.max())) / surface.diagonal,
        given[excess > 0],
    )


def fan_normals(surface: medialis.Surface, crease: float = CREASE) -> np.ndarray:
    """Return the normal of each corner of a mesh, (3m, 3), not averaged across creases.

    The corners of a vertex that are joined by edges that bend by at most `crease` degrees share the
    sum of their face normals, weighted by their angles, or the normal of the vertex where these are
    all of its corners; corner 3 f + j is corner j of face f.
    """
    edge = np.arange(3 * surface.face_count)
    twin = surface.edge_twins
    edge = edge[twin >= 0]
    twin = twin[edge]
    normals = np.repeat(surface.face_normals, 3, axis=0)
    smooth = (normals[edge] * normals[twin]).sum(axis=1) >= np.cos(np.radians(crease))
    edge, twin = edge[smooth], twin[smooth]
    after = 3 * (twin // 3) + (twin + 1) % 3  # half-edges of a pair run in opposite directions
    fan = piece_labels(len(normals), np.stack([edge, after], axis=1))
    corners = surface.points[surface.faces]
    ahead = np.roll(corners, -1, axis=1) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(ahead, behind), axis=2)
    weight = np.arctan2(sine, (ahead * behind).sum(axis=2)).ravel()
    total = np.zeros((int(fan.max()) + 1, 3))
    np.add.at(total, fan, normals * weight[:, None])
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    vertex, fans = surface.faces.ravel(), np.zeros(surface.point_count, np.int64)
    np.add.at(fans, vertex[np.unique(fan, return_index=True)[1]], 1)
    return np.where(fans[vertex, None] == 1, surface.normals[vertex], total[fan])


def _corners_at_contacts(balls: medialis.MedialCloud) -> tuple[np.ndarray, np.ndarray]:
    """Corners of faces at the two contacts of each ball, and the ball; only faces poked through."""
    surface = balls.surface
    fans = surface.fans
    vertex = balls.features.ravel()
    count = np.diff(fans.offsets)[vertex]
    first = np.repeat(fans.offsets[vertex] - np.r_[0, np.cumsum(count)[:-1]], count)
    corner = fans.indices[first + np.arange(len(first))]
    ball = np.repeat(np.arange(len(vertex)) // 2, count)
    triangles = surface.points[surface.faces[corner // 3]]
    weights = nearest_on_triangles(balls.centers[ball], triangles)
    place = np.einsum("ij,ijk->ik", weights, triangles)
    distance = np.linalg.norm(balls.centers[ball] - place, axis=1)
    through = distance < balls.radii[ball] * (1 - 1e-9)
    return corner[through], ball[through]


def _sagitta(
    balls: medialis.MedialCloud, corner: np.ndarray, ball: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Largest r (1 - cos a) at the contacts of each ball.

    `corner` and `ball` are the corners of faces that are poked through, `normals` (3m, 3) those of
    the smooth surface at all corners.
    """
    faces = balls.surface.face_normals
    cosine = np.clip((normals[corner] * faces[corner // 3]).sum(axis=1), -1, 1)
    largest = np.zeros(len(balls))
    np.maximum.at(largest, ball, balls.radii[ball] * (1 - cosine))
    between = np.flatnonzero(balls.contact_faces >= 0)
    face = balls.contact_faces[between]
    there = np.einsum("ij,ijk->ik", balls.contact_weights[between], normals.reshape(-1, 3, 3)[face])
    length = np.maximum(np.linalg.norm(there, axis=1), 1e-300)
    cosine = np.clip((there * faces[face]).sum(axis=1) / length, -1, 1)
    largest[between] = np.maximum(largest[between], balls.radii[between] * (1 - cosine))
    return largest


def judged_files(paths: list[Path]) -> Iterator[tuple[Path, medialis.Shape]]:
    """Read the meshes among some files and those in some folders that are closed and do not cross.

    Files that are named are taken as they are. Crossing faces are counted by pymeshlab.
    """
    for path in paths:
        if not path.is_dir():
            yield path, medialis.read_shape(path)
            continue
        for file in sorted(path.glob("*.ply"), key=lambda one: one.stat().st_size):
            shape = medialis.read_shape(file)
            if shape.face_count and shape.closed_components.all() and not crossing_faces(shape):
                yield file, shape


def crossing_faces(shape: medialis.Shape) -> int:
    """Count the faces of a mesh that pass through others."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(shape.points, shape.faces))
    meshes.compute_selection_by_self_intersections_per_face()
    return int(meshes.current_mesh().selected_face_number())


def print_poke_out(paths: list[Path], refine: float | None = None) -> None:
    """Print the poke-out of meshes at the defaults, or refined to a fraction of the diagonal."""
    print("| shape | samples | balls | poke out % | creases as walls % | by r/10 % | worst % |")
    print("|---|---|---|---|---|---|---|")
    options = {} if refine is None else {"refine": refine}
    for path, shape in judged_files(paths):
        cloud = medialis.surface_skeleton(shape, **options)
        found = poke_out(cloud)
        print(
            f"| {path.stem} | {cloud.surface.point_count} | {found.balls} | {found.share:.2f} "
            f"| {found.share_at_creases:.2f} | {found.tenth:.2f} | {found.worst:.3f} |",
            flush=True,
        )
