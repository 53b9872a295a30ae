"""Where sheets meet: each is cut along the others, and what no wall is left of is taken away."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import combinations, permutations

import numpy as np

from medialis.base.arrays import Index, Mask, corner_vectors, twice_areas, unit_rows
from medialis.base.box_tree import NearestTree
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.surface import piece_labels
from medialis.walls.midsurface.remeshing import EditMesh
from medialis.walls.midsurface.sides import AHEAD, CORE, LEAST_AREA, ON_RIM, RawSheet

ACROSS = math.cos(math.radians(20.0))  # halved 100 %, doubled 0 %
"""Cosine: sheets that meet at a smaller angle go on into each other, and do not cut."""

NEAR = 0.1  # halved 0.1 %, doubled 0 %
"""Half thicknesses: how far a place of a cut may lie beyond the border of the other sheet."""

ON_IT = 1e-4
"""Half thicknesses: vertices that lie less far off another sheet are on it."""

SNAP = 0.15  # halved 0.2 %, doubled 0.5 %
"""Share of an edge: a cut so near to its end moves the end there."""

ALONG = 0.1  # halved 0 %, doubled 0 %
"""Share of its length by which the middle of an edge may lie off a sheet that it follows."""

MOVED = 0.3  # halved 0 %, doubled 0 %
"""Share of the shortest side beside it by which a vertex may move to where a cut is to end."""

STEP_BESIDE = 0.9
"""Half thicknesses: how far beside each other sheets may end that a step joins."""

TIDYINGS = 6  # halved 2 %, doubled 3 %
"""Rounds in which ragged borders are smoothed."""

LEAST_CORE = 0.02  # halved 0 %, doubled 0 %
"""Share of the area of a piece that must lie between opposite walls."""


@dataclass(eq=False)
class CutSheet:
    """A sheet that is being cut.

    Attributes
    ----------
    raw : RawSheet
    mesh : EditMesh
        Tags are the kinds of faces. Marks along cuts are rows of `partners`.
    partners : list of frozenset of int
        The other sheets that a cut is made along.
    """

    raw: RawSheet
    mesh: EditMesh
    partners: list[frozenset[int]] = field(default_factory=lambda: [frozenset()])

    def mark_with(self, h: int, other: int) -> None:
        """Add a sheet to those that an edge is cut along."""
        wanted = self.partners[self.mesh.marks[h]] | {other}
        if wanted not in self.partners:
            self.partners.append(wanted)
        self.mesh.mark(h, self.partners.index(wanted))


def cut_sheets(raws: list[RawSheet]) -> list[CutSheet]:
    """Cut all sheets along each other, and take away the pieces that lie between no walls."""
    cut = [CutSheet(raw, EditMesh(raw.points, raw.faces, raw.kind)) for raw in raws]
    boxes = [(raw.points.min(axis=0), raw.points.max(axis=0)) for raw in raws]
    for s, j in permutations(range(len(cut)), 2):
        (low, high), (lowest, highest) = boxes[s], boxes[j]
        if not ((low > highest).any() or (high < lowest).any()):
            cut_along(cut[s], raws[j], j)
    for s, j in combinations(range(len(cut)), 2):
        end_cuts(cut[s], s, cut[j], j)
    for one in cut:
        drop_stubs(one)
    return cut


def cut_along(sheet: CutSheet, other: RawSheet, number: int) -> None:
    """Split the faces of a sheet along its curve of intersection with another one."""
    mesh = sheet.mesh
    h, a, b = mesh.half_edges()
    points = mesh.points
    low, high = other.points.min(axis=0), other.points.max(axis=0)
    margin = NEAR * float(other.half.max())
    near = (np.maximum(points[a], points[b]) >= low - margin).all(axis=1)
    near &= (np.minimum(points[a], points[b]) <= high + margin).all(axis=1)
    h, a, b = h[near], a[near], b[near]
    if len(h) == 0:
        return
    vertices, which = np.unique(np.r_[a, b], return_inverse=True)
    height, distance, _ = other.offsets(points[vertices])
    length = np.linalg.norm(points[a] - points[b], axis=1)
    first, second = which[: len(a)], which[len(a) :]
    reached = np.minimum(distance[first], distance[second]) <= length
    # In a symmetric part vertices lie on the other sheet but for the rounding of its file.
    zero = np.abs(height) <= ON_IT * float(other.half.mean())
    sign = np.where(zero, 0.0, np.sign(height))
    crossing = reached & (sign[first] * sign[second] < 0)
    rows = np.flatnonzero(crossing)
    ends, heights = points[np.stack([a, b])[:, rows]], height[np.stack([first, second])[:, rows]]
    place, share, fits = _crossings(other, ends, heights, _face_normals(mesh, h[rows] // 3))
    rows, place, share = rows[fits], place[fits], share[fits]
    on = set(vertices[zero & (distance <= margin)].tolist())
    moved = _snapped(mesh, h[rows], a[rows], b[rows], place, share, on)
    rows = rows[~moved]
    on.update(mesh.split_between(a[rows], b[rows], place[~moved]).tolist())
    on.discard(-1)
    _mark_cut(sheet, other, number, on)


def _crossings(
    other: RawSheet, ends: FloatArray, heights: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray, Mask]:
    """Return where edges meet the other sheet, at what share of them, and whether they do.

    Of both ends there are places (2, e, 3) and heights (2, e), of one face there the normal (e, 3).
    """
    (a, b), (left, right) = ends, heights
    low, high = np.zeros(len(a)), np.ones(len(a))
    share = left / (left - right)
    for _ in range(4):  # the other sheet is bent: false position, kept within the bracket
        value, _, _ = other.offsets(a + share[:, None] * (b - a))
        same = np.sign(value) == np.sign(left)
        low, left = np.where(same, share, low), np.where(same, value, left)
        high, right = np.where(same, high, share), np.where(same, right, value)
        gap = left - right
        share = low + (high - low) * np.where(gap != 0, left / np.where(gap != 0, gap, 1.0), 0.5)
    place = a + share[:, None] * (b - a)
    _, distance, row = other.offsets(place)
    half = other.half[other.faces[row]].mean(axis=1)
    steep = np.abs(np.einsum("ia,ia->i", normals, other.normals[row])) < ACROSS
    return place, share, steep & (distance <= NEAR * half)


def _face_normals(mesh: EditMesh, rows: Index) -> FloatArray:
    return unit_rows(corner_vectors(mesh.points, mesh.faces[rows]))


def _snapped(
    mesh: EditMesh, h: Index, a: Index, b: Index, place: FloatArray, share: FloatArray, on: set[int]
) -> Mask:
    """Move vertices next to the cut onto it; tell the crossings that need no other vertex."""
    done = np.zeros(len(h), np.bool_)
    for i in np.argsort(np.minimum(share, 1 - share), kind="stable").tolist():
        if int(a[i]) in on or int(b[i]) in on:
            done[i] = True
            continue
        off = min(share[i], 1 - share[i])
        if off > SNAP:
            break
        v = int(a[i] if share[i] < 0.5 else b[i])
        edges, border = mesh.leaving_edges(v)
        marked = any(mesh.marks[e] or mesh.marks[3 * (e // 3) + (e + 2) % 3] for e in edges)
        # On a border or a mark it could slide along a straight line only.
        if not border and not marked and mesh.may_move(v, place[i]):
            mesh.points[v] = place[i]
            on.add(v)
            done[i] = True
    rest = np.array([int(x) in on or int(y) in on for x, y in zip(a, b, strict=True)], np.bool_)
    return done | rest


def _mark_cut(sheet: CutSheet, other: RawSheet, number: int, on: set[int]) -> None:
    """Mark the edges between two vertices of the cut that follow it."""
    if not on:
        return
    mesh = sheet.mesh
    h, a, b = mesh.half_edges()
    chosen = np.zeros(mesh.vertex_count, np.bool_)
    chosen[list(on)] = True
    rows = np.flatnonzero(chosen[a] & chosen[b])
    if len(rows) == 0:
        return
    middle = (mesh.points[a[rows]] + mesh.points[b[rows]]) / 2
    length = np.linalg.norm(mesh.points[a[rows]] - mesh.points[b[rows]], axis=1)
    height, distance, row = other.offsets(middle)
    half = other.half[other.faces[row]].mean(axis=1)
    steep = np.abs(np.einsum("ia,ia->i", _face_normals(mesh, h[rows] // 3), other.normals[row]))
    follows = (distance <= NEAR * half) & (np.abs(height) <= ALONG * length) & (steep < ACROSS)
    for edge in h[rows[follows]].tolist():
        sheet.mark_with(edge, number)


def cut_ends(sheet: CutSheet, other: int) -> list[int]:
    """Return the vertices at which a cut along another sheet ends."""
    mesh = sheet.mesh
    h, a, b = mesh.half_edges()
    along = np.array([other in partners for partners in sheet.partners])
    rows = along[mesh.marks[h]]
    count = np.bincount(np.r_[a[rows], b[rows]], minlength=mesh.vertex_count)
    return [int(v) for v in np.flatnonzero(count == 1)]


def end_cuts(first: CutSheet, s: int, second: CutSheet, j: int) -> None:
    """Let a cut that ends within a sheet end where it does in the other one, at its border."""
    for one, other, number, back in ((first, second, j, s), (second, first, s, j)):
        mesh = one.mesh
        goals = [other.mesh.points[v].copy() for v in cut_ends(other, back)]
        if not goals:
            continue
        for v in cut_ends(one, number):
            edges, border = mesh.leaving_edges(v)
            if border:
                continue
            goal = min(goals, key=lambda g: float(np.linalg.norm(g - mesh.points[v])))
            _end_at(one, v, goal, number, edges)


def _end_at(sheet: CutSheet, v: int, goal: FloatArray, number: int, edges: Index) -> None:
    """Draw a cut on from one of its vertices to a place in the faces around it."""
    mesh = sheet.mesh
    sides = [float(np.linalg.norm(mesh.points[mesh.end(int(e))] - mesh.points[v])) for e in edges]
    away = float(np.linalg.norm(goal - mesh.points[v]))
    if away <= SNAP * min(sides):
        mesh.points[v] = goal
        return
    for e in edges.tolist():
        f = e // 3
        corners = mesh.points[mesh.faces[f]]
        x, y, z = corners
        normal = np.cross(y - x, z - x)
        size = float(normal @ normal)
        if size == 0:
            continue
        weights = [
            float(np.cross(corners[(k + 1) % 3] - goal, corners[(k + 2) % 3] - goal) @ normal)
            / size
            for k in range(3)
        ]
        if min(weights) > 0:
            w = mesh.split_face(f, goal)
            sheet.mark_with(mesh.edge_between(v, w), number)
            return
        # On the edge to a neighbour, or a little beyond it: the neighbour moves there.
        to = mesh.end(e)
        if np.linalg.norm(mesh.points[to] - goal) < MOVED * min(sides):
            around, border = mesh.leaving_edges(to)
            if not border and not any(mesh.marks[k] for k in around):
                mesh.points[to] = goal
                sheet.mark_with(e, number)
                return
    mesh.points[v] = goal if away < max(sides) else mesh.points[v]


def drop_stubs(sheet: CutSheet) -> None:
    """Take away the pieces between cuts that lie between no opposite walls."""
    mesh = sheet.mesh
    label = _pieces(mesh, np.ones(mesh.face_count, np.bool_))
    faces = np.where(mesh.faces[: mesh.face_count] < 0, 0, mesh.faces[: mesh.face_count])
    area = twice_areas(mesh.points, faces) * mesh.alive
    total = np.bincount(label, area)
    core = np.bincount(label, area * (mesh.tags[: mesh.face_count] == CORE))
    mesh = mesh.without((core < LEAST_CORE * total)[label])
    # What was extended and led nowhere: to no surface, and to no other sheet.
    ahead = mesh.tags[: mesh.face_count] == AHEAD
    label = _pieces(mesh, ahead)
    meets = np.zeros(mesh.face_count, np.bool_)
    meets[label[np.flatnonzero(mesh.marks[: 3 * mesh.face_count]) // 3]] = True
    sheet.mesh = mesh.without(ahead & ~meets[label])


def _pieces(mesh: EditMesh, chosen: Mask, *, across_cuts: bool = False) -> IntArray:
    """Give a number to each piece of chosen faces that hang together, across no cut as a rule."""
    h, _, _ = mesh.half_edges()
    twins = mesh.twins[h]
    joined = (twins >= 0) & (across_cuts | (mesh.marks[h] == 0))
    links = np.stack([h[joined] // 3, twins[joined] // 3], axis=1)
    return np.asarray(piece_labels(mesh.face_count, links[chosen[links].all(axis=1)]))


def tidy_borders(sheets: list[CutSheet], surface: NearestTree) -> None:
    """Smooth the borders that are neither rim nor weld: where a wall fades into something thick."""
    for sheet in sheets:
        _drop_scraps(sheet)
        for _ in range(TIDYINGS):
            mesh = sheet.mesh
            inner = _inner_border(sheet, surface)
            count = np.bincount(inner // 3, minlength=mesh.face_count)
            if (count < 2).all():
                break
            sheet.mesh = mesh.without(count >= 2)
        for _ in range(TIDYINGS):
            _smooth_border(sheet, _inner_border(sheet, surface))


def _drop_scraps(sheet: CutSheet) -> None:
    """Take away what hangs together with nothing and is too small for a sheet."""
    mesh = sheet.mesh
    label = _pieces(mesh, np.ones(mesh.face_count, np.bool_), across_cuts=True)
    area = twice_areas(mesh.points, mesh.faces[: mesh.face_count]) / 2
    core = np.bincount(label, area * (mesh.tags[: mesh.face_count] == CORE))
    small = core < LEAST_AREA * sheet.raw.thickness**2
    if small[label].any():
        sheet.mesh = mesh.without(small[label])


def _smooth_border(sheet: CutSheet, border: Index) -> None:
    """Move the vertices between two edges of a border towards their middle, on the sheet."""
    mesh = sheet.mesh
    a, b = mesh.faces[border // 3, border % 3], mesh.faces[border // 3, (border + 1) % 3]
    total, count = np.zeros((mesh.vertex_count, 3)), np.zeros(mesh.vertex_count)
    for one, other in ((a, b), (b, a)):
        np.add.at(total, one, mesh.points[other])
        np.add.at(count, one, 1.0)
    rows = np.flatnonzero(count == 2)
    if len(rows) == 0:
        return
    mesh.points[rows] = sheet.raw.at((mesh.points[rows] + total[rows] / 2) / 2)[0]


def join_steps(sheets: list[CutSheet], surface: NearestTree) -> None:
    """Join sheets of different height that end one above the other, where the thickness steps.

    The borders of both move to the middle between them, and are marked as those of a weld.
    """
    borders = [_inner_border(sheet, surface) for sheet in sheets]
    found: list[tuple[int, int, Index, FloatArray]] = []
    for s, j in permutations(range(len(sheets)), 2):
        if len(borders[s]) and len(borders[j]):
            rows, goals = _facing_border(sheets[s], borders[s], sheets[j], borders[j])
            found.append((s, j, rows, goals))
    for s, j, rows, goals in found:
        mesh = sheets[s].mesh
        mesh.points[rows] = (mesh.points[rows] + goals) / 2
        chosen = np.zeros(mesh.vertex_count, np.bool_)
        chosen[rows] = True
        h, a, b = mesh.half_edges()
        for edge in h[(mesh.twins[h] < 0) & chosen[a] & chosen[b]].tolist():
            sheets[s].mark_with(edge, j)


def _inner_border(sheet: CutSheet, surface: NearestTree) -> Index:
    """Return the border half-edges (e,) of a sheet that lie within the solid, on no cut."""
    mesh = sheet.mesh
    h, a, b = mesh.half_edges()
    rows = (mesh.twins[h] < 0) & (mesh.marks[h] == 0)
    h, a, b = h[rows], a[rows], b[rows]
    if len(h) == 0:
        return h
    middle = (mesh.points[a] + mesh.points[b]) / 2
    return h[surface.distances(middle)[0] > ON_RIM * float(sheet.raw.half.max())]


def _facing_border(
    sheet: CutSheet, border: Index, other: CutSheet, facing: Index
) -> tuple[Index, FloatArray]:
    """Return the vertices of a border above the border of another sheet, and the places there."""
    mesh, there = sheet.mesh, other.mesh
    ends = there.faces[facing // 3, facing % 3], there.faces[facing // 3, (facing + 1) % 3]
    a, along = there.points[ends[0]], there.points[ends[1]] - there.points[ends[0]]
    size = np.maximum(np.einsum("ea,ea->e", along, along), 1e-300)
    across = _face_normals(there, facing // 3)
    limit = max(float(sheet.raw.half.max()), float(other.raw.half.max()))
    vertices, which = np.unique(mesh.faces[border // 3, border % 3], return_index=True)
    last, lines = np.unique(mesh.faces[border // 3, (border + 1) % 3], return_index=True)
    new = ~np.isin(last, vertices)
    vertices, which = np.r_[vertices, last[new]], np.r_[which, lines[new]]
    normals = _face_normals(mesh, border[which] // 3)
    rows, goals = [], []
    for v, normal in zip(vertices.tolist(), normals, strict=True):
        share = np.clip(np.einsum("ea,ea->e", mesh.points[v] - a, along) / size, 0.0, 1.0)
        place = a + share[:, None] * along
        away = np.linalg.norm(place - mesh.points[v], axis=1)
        best = int(away.argmin())
        step = place[best] - mesh.points[v]
        beside = float(np.linalg.norm(step - (step @ normal) * normal))
        if (
            away[best] <= limit
            and beside <= STEP_BESIDE * limit
            and abs(float(normal @ across[best])) > ACROSS
        ):
            rows.append(v)
            goals.append(place[best])
    return np.array(rows, np.int64), np.array(goals).reshape(-1, 3)
