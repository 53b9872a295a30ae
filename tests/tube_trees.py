"""Generated trees and nets of tubes: closed meshes of any slenderness, with their axes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree


@dataclass
class TubeTree:
    """A mesh of tubes and its true axis: nodes with radii, and edges."""

    points: list = field(default_factory=list)
    faces: list = field(default_factory=list)
    nodes: list = field(default_factory=list)
    radii: list = field(default_factory=list)
    edges: list = field(default_factory=list)
    quads: dict = field(default_factory=dict)
    """Quads that may still be cut out: the grid (tube, ring, side) of each."""
    tubes: list = field(default_factory=list)

    def arrays(self):
        faces = [f for f in self.faces if f is not None]
        return np.array(self.points), np.array(faces, np.int32)

    @property
    def tips(self):
        """Number of ends of the axis."""
        return int((np.bincount(np.ravel(self.edges), minlength=len(self.nodes)) == 1).sum())

    @property
    def loops(self):
        """Number of loops of the axis, which is connected."""
        return len(self.edges) - len(self.nodes) + 1

    def axis(self, step):
        """Return points along the axis at most `step` radii apart, and the radius of each."""
        nodes, radii = np.array(self.nodes), np.array(self.radii)
        found, size = [], []
        for a, b in self.edges:
            long = np.linalg.norm(nodes[a] - nodes[b])
            share = np.linspace(0, 1, 2 + int(long / (step * min(radii[a], radii[b]))))
            found.append(nodes[a] + share[:, None] * (nodes[b] - nodes[a]))
            size.append(radii[a] + share * (radii[b] - radii[a]))
        return np.concatenate(found), np.concatenate(size)


def _across(way, hint):
    first = hint - (hint @ way) * way
    first /= np.linalg.norm(first)
    return first, np.cross(way, first)


def _path(rng, start, way, length, steps, bend):
    """Return a wiggling polyline and its direction at each point."""
    places, ways = [np.array(start)], [way]
    for _ in range(steps):
        way = way + bend * rng.normal(size=3)
        way /= np.linalg.norm(way)
        places.append(places[-1] + length / steps * way)
        ways.append(way)
    return np.array(places), np.array(ways)


def _add_tube(tree, rng, ring, places, ways, radii, hint, closed_start):
    """Sweep a tube along a path; `ring` are the rows of a first ring that is there, or None.

    Return the rows of its rings.
    """
    count = len(ring) if ring is not None else closed_start
    number = len(tree.tubes)
    rings = [] if ring is None else [list(ring)]
    first = np.array(tree.points[ring[0]]) - places[0] if ring is not None else hint
    for k in range(0 if ring is None else 1, len(places)):
        u, v = _across(ways[k], first)
        first = u
        angle = 2 * np.pi * np.arange(count) / count
        at = places[k] + radii[k] * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
        rings.append(list(range(len(tree.points), len(tree.points) + count)))
        tree.points.extend(at)
    for k in range(len(rings) - 1):
        for j in range(count):
            a, b = rings[k][j], rings[k][(j + 1) % count]
            c, d = rings[k + 1][j], rings[k + 1][(j + 1) % count]
            tree.quads[number, k, j] = len(tree.faces)
            tree.faces.extend([[a, b, d], [a, d, c]])
    for end in ([0] if ring is None else []) + [-1]:
        row = rings[end]
        middle = len(tree.points)
        push = -1.0 if end == 0 else 1.0
        tree.points.append(places[end] + push * 0.8 * radii[end] * ways[end])
        for j in range(count):
            a, b = row[j], row[(j + 1) % count]
            tree.faces.append([a, b, middle] if end == -1 else [b, a, middle])
    tree.tubes.append((rings, places, ways, radii, None))
    return rings


def _add_axis(tree, places, radii, after=None):
    first = len(tree.nodes)
    tree.nodes.extend(places)
    tree.radii.extend(radii)
    rows = list(range(first, first + len(places)))
    tree.edges.extend(itertools.pairwise(rows))
    if after is not None:
        tree.edges.append((after, rows[0]))
    return rows


def _patch(tree, rng, number, wide, high):
    """Cut a patch of quads out of a tube; return the rows round it, its middle, and its ring."""
    rings = tree.tubes[number][0]
    count = len(rings[0])
    for _ in range(200):
        k = int(rng.integers(1, max(len(rings) - high - 1, 2)))
        j = int(rng.integers(count))
        cells = [(number, k + y, (j + x) % count) for x in range(wide) for y in range(high)]
        if all(cell in tree.quads for cell in cells):
            break
    else:
        return None
    for cell in cells:  # and those beside may not be cut out any more
        at = tree.quads[cell]
        tree.faces[at] = tree.faces[at + 1] = None
    for x in range(-1, wide + 1):
        for y in range(-1, high + 1):
            tree.quads.pop((number, k + y, (j + x) % count), None)
    row = [rings[k][(j + x) % count] for x in range(wide)]
    row += [rings[k + y][(j + wide) % count] for y in range(high)]
    row += [rings[k + high][(j + wide - x) % count] for x in range(wide)]
    row += [rings[k + high - y][j] for y in range(high)]
    return row, k + high // 2


def tube_tree(
    rng,
    *,
    limbs=8,
    slender=100.0,
    round_=8,
    elongation=1.5,
    taper=0.5,
    bend=0.05,
    soma=1.0,
    loops=0,
    spines=0,
):
    """Return a tree of tubes, each `slender` radii long, cut and closed as one manifold.

    Parameters
    ----------
    limbs : int
        Tubes besides the trunk.
    slender : float
        Length of the trunk over its radius; limbs have between a third of it and the whole.
    round_ : int
        Vertices round the trunk, an even number.
    elongation : float
        Length of triangles over their width.
    taper : float
        Radius of the ends over that of the bases.
    soma : float
        How many times as thick the trunk is in its middle.
    loops, spines : int
        Limbs that lead back to another one; thin short ones.
    """
    tree = TubeTree()

    def tube(base, way, radius, length, count, ring, after, hint, thick=1.0):
        step = elongation * 2 * np.pi * radius / count
        steps = int(max(8, np.ceil(length / step)))
        places, ways = _path(rng, base, way, length, steps, bend / np.sqrt(steps))
        share = np.linspace(0, 1, steps + 1)
        radii = radius * (1 + (taper - 1) * share)
        radii *= 1 + (thick - 1) * np.exp(-(((share - 0.5) * length / (2 * thick * radius)) ** 2))
        number = len(tree.tubes)
        _add_tube(tree, rng, ring, places, ways, radii, hint, count)
        rows = _add_axis(tree, places, radii, after)
        tree.tubes[number] = (*tree.tubes[number][:4], rows)
        return number

    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    tube(np.zeros(3), way, 1.0, slender, round_, None, None, np.cross(way, [0.3, 0.5, 0.8]), soma)
    made, tries = 0, 0
    todo = ["limb"] * limbs + ["spine"] * spines
    while made < len(todo) and tries < 20 * len(todo):
        tries += 1
        spine = todo[made] == "spine"
        number = int(rng.integers(len(tree.tubes)))
        rings, places, ways, _, rows = tree.tubes[number]
        count = len(rings[0])
        wide = max(1, count // 4) if not spine else 1
        high = max(1, round(wide / elongation)) if not spine else 1
        found = _patch(tree, rng, number, wide, high)
        if found is None:
            continue
        ring, k = found
        middle = np.mean([tree.points[row] for row in ring], axis=0)
        out = middle - places[k]
        out -= (out @ ways[k]) * ways[k]
        out /= np.linalg.norm(out)
        away = np.array([tree.points[row] for row in ring]) - middle
        radius = float(np.linalg.norm(away - (away @ out)[:, None] * out, axis=1).mean()) * 0.9
        length = (slender * rng.uniform(0.3, 1.0) if not spine else rng.uniform(5, 10)) * radius
        direction = out + 0.5 * ways[k] * rng.uniform(-1, 1)
        direction /= np.linalg.norm(direction)
        hint = np.array(tree.points[ring[0]]) - middle
        tube(middle, direction, radius, length, len(ring), ring[::1], rows[k], hint)
        made += 1
    return tree


def judged(graph, tree, scale=1.0):
    """Return recall of length, excess in radii of the farthest false place, and counts."""
    axis, size = tree.axis(0.5)
    points = []
    for a, b in graph.edges:
        pa, pb = graph.nodes[a] * scale, graph.nodes[b] * scale
        share = np.linspace(0, 1, 2 + int(4 * np.linalg.norm(pa - pb) / size.min()) % 200)
        points.append(pa + share[:, None] * (pb - pa))
    if not points:
        return 0.0, 0.0
    points = np.concatenate(points)
    away = cKDTree(points).query(axis)[0]
    back, near = cKDTree(axis).query(points)
    return float((away < np.maximum(size, 0.0)).mean()), float((back / size[near]).max())
