"""A slow oracle: sheets, seams and junctions of polyhedra by exact contacts on a fine grid.

It knows nothing of Voronoi cells of samples or of complexes. A polyhedron has as elements its flat
faces, its reflex edges and its reflex vertices; from a place inside, each is as far as its nearest
point, where that point lies in the element itself. Elements that hang together at reflex edges are
one smooth wall as seen from inside: the medial axis between such a wall and another is one smooth
sheet, flat where the contact is on a face and parabolic where it is on an edge. Where that changes
nothing meets, so it is no seam.

The medial axis passes between neighbours on the grid that are nearest to different walls. A place
on it, found by halving, belongs to a sheet if all other walls are farther by more than a cell or
so: sheets are the connected pieces of these. From the other places Newton's method leads to where
three walls or four are as near, exactly. Where directions to all that are touched span a plane is a
seam, where they span space a junction; a seam is what hangs together and touches the same walls.

    python tests/true_structure.py L,T 48 80    # names below, cells along the side
"""

import sys
from itertools import combinations, product

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

GAP = 1.3
"""Cells: walls that are farther by less may be touched, too."""

SPAN = 1e-3
"""The least singular value of directions that are independent."""

STEPS = 12
"""Of Newton's, towards seams and junctions."""

SAME = 1e-6
"""Lengths that differ by less are the same; shapes have a size of about 1."""


class Elements:
    """Faces, reflex edges and reflex vertices of a closed mesh of flat faces, and their walls."""

    def __init__(self, points, faces):
        self.points, self.faces = np.asarray(points, float), np.asarray(faces)
        corner = self.points[self.faces]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        self.normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        owner = {}
        for t, row in enumerate(self.faces):
            for k in range(3):
                owner[row[k], row[(k + 1) % 3]] = t, row[(k + 2) % 3]
        flat, self.reflex = [], []
        for (a, b), (t, _) in owner.items():
            other, far = owner[b, a]
            if a < b:
                height = (self.points[far] - self.points[a]) @ self.normal[t]
                if abs(height) < 1e-9:
                    flat.append((t, other))
                elif height > 0:
                    self.reflex.append((a, b, t, other))
        count = len(self.faces)
        rows = np.array(flat).reshape(-1, 2)
        graph = coo_array((np.ones(len(rows)), rows.T), (count, count))
        self.face_of, self.group = connected_components(graph, directed=False)
        ends = np.array([row[:2] for row in self.reflex]).reshape(-1, 2).astype(int)
        self.ends, self.vertices = ends, np.unique(ends)
        self.count = self.face_of + len(ends) + len(self.vertices)
        self.beside = np.eye(self.count, dtype=bool)
        for k, (a, b, t, other) in enumerate(self.reflex):
            edge = self.face_of + k
            touching = [self.group[t], self.group[other]]
            touching += [
                self.face_of + len(ends) + np.searchsorted(self.vertices, v) for v in (a, b)
            ]
            self.beside[edge, touching] = self.beside[touching, edge] = True

    def ways(self, places):
        """Return vectors (q, e, 3) to the elements, infinite where they are not met straight."""
        result = np.full((len(places), self.count, 3), np.inf)
        for t, row in enumerate(self.faces):
            a, b, c = self.points[row]
            height = (places - a) @ self.normal[t]
            foot = places - height[:, None] * self.normal[t]
            within = np.ones(len(places), bool)
            for p, q in ((a, b), (b, c), (c, a)):
                within &= np.cross(q - p, foot - p) @ self.normal[t] >= -1e-12
            result[within, self.group[t]] = -height[within, None] * self.normal[t]
        for k, (a, b) in enumerate(self.ends):
            start, way = self.points[a], self.points[b] - self.points[a]
            share = (places - start) @ way / (way @ way)
            within = (share >= 0) & (share <= 1)
            foot = start + share[:, None] * way
            result[within, self.face_of + k] = (foot - places)[within]
        result[:, self.face_of + len(self.ends) :] = self.points[self.vertices] - places[:, None]
        return result

    def lengths(self, places):
        """Return distances (q, e)."""
        return np.linalg.norm(self.ways(places), axis=2)

    def inside(self, places):
        """Tell what is inside, by solid angles."""
        total = np.zeros(len(places))
        for row in self.faces:
            a, b, c = (self.points[v] - places for v in row)
            x, y, z = (np.linalg.norm(v, axis=1) for v in (a, b, c))
            top = np.einsum("ij,ij->i", a, np.cross(b, c))
            dots = [np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a))]
            total += np.arctan2(top, x * y * z + dots[0] * z + dots[1] * x + dots[2] * y)
        return total > np.pi

    def alike(self, some, others):
        """Tell whether two sets of elements are of the same walls."""
        both = self.beside[np.ix_(some, others)]
        return bool(both.any(axis=0).all() and both.any(axis=1).all())

    def walls_of(self, some):
        """Return one element of each wall among some elements, the walls told by `some` alone."""
        part = self.beside[np.ix_(some, some)]
        label = connected_components(coo_array(part), directed=False)[1]
        return label


def structure(points, faces, cells=64):
    """Return the numbers of sheets and seams, and the junctions (j, 3)."""
    points = np.asarray(points, float)
    known = Elements(points, faces)
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max()) / cells
    turned = [np.arange(a + 0.31 * size, b, size) for a, b in zip(low, high, strict=True)]
    shape = tuple(map(len, turned))
    places = np.stack(np.meshgrid(*turned, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest = np.full(len(places), -1)
    for part in np.array_split(np.flatnonzero(known.inside(places)), len(places) // 20000 + 1):
        nearest[part] = known.lengths(places[part]).argmin(axis=1)
    number = np.arange(len(places)).reshape(shape)
    pairs = []
    for way in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
        cut = tuple(slice(None, -1) if w else slice(None) for w in way)
        far = tuple(slice(1, None) if w else slice(None) for w in way)
        pairs.append(np.stack([number[cut].ravel(), number[far].ravel()], axis=1))
    pairs = np.concatenate(pairs)
    a, b = nearest[pairs].T
    pairs = pairs[(a >= 0) & (b >= 0) & ~known.beside[a, b]]
    at, two = _crossings(known, places, pairs)
    lengths = np.concatenate([known.lengths(x) for x in np.array_split(at, len(at) // 20000 + 1)])
    alone, jobs = np.ones(len(at), bool), []
    for q in range(len(at)):
        some = np.flatnonzero(lengths[q] < lengths[q].min() + GAP * size)
        label = known.walls_of(some)
        one, other = (label[np.searchsorted(some, x)] for x in two[q])
        alone[q] = label.max() < 2 and one != other
        if label.max() > 1:
            first = [some[label == k] for k in range(label.max() + 1)]
            first = [x[lengths[q, x].argmin()] for x in first]
            jobs += [(q, *c, -1) for c in combinations(first, 3)]
            jobs += [(q, *c) for c in combinations(first, 4)]
    sheets = _pieces(at[alone], 1.8 * size, two[alone], known.beside)
    jobs = np.array(jobs).reshape(-1, 5)
    seams, junctions = _seams(known, at[jobs[:, 0]], jobs[:, 1:], size)
    return sheets, seams, junctions


def numbers(points, faces, cells=64):
    """Return how many sheets, seams and junctions there are."""
    sheets, seams, junctions = structure(points, faces, cells)
    return int(sheets.max()) + 1, int(seams.max()) + 1, len(junctions)


def _seams(known, start, own, size):
    """Move places to where they are as far from three or four elements, (q, 4), -1 for none.

    Return the seam of each place on one, and the junctions.
    """
    at, has, rows = start.copy(), own >= 0, np.arange(len(start))[:, None]
    for _ in range(STEPS):
        ways = known.ways(at)
        length = np.linalg.norm(ways, axis=2)
        for k in range(4):  # the nearest one of the same wall
            among = np.where(known.beside[own[:, k]], length, np.inf)
            better = has[:, k] & np.isfinite(among.min(axis=1))
            own[better, k] = among.argmin(axis=1)[better]
        d = length[rows, own]
        bad = has & ~np.isfinite(d)
        d = np.where(has & ~bad, d, 0.0)
        slope = -np.where((has & ~bad)[..., None], ways[rows, own], 0.0)
        slope /= np.maximum(d, 1e-300)[..., None]
        system = np.concatenate([slope, -np.where(has & ~bad, 1.0, 0.0)[..., None]], axis=2)
        r = d.sum(axis=1) / np.maximum((has & ~bad).sum(axis=1), 1)
        short = np.where(has & ~bad, r[:, None] - d, 0.0)
        step = np.einsum("qij,qj->qi", np.linalg.pinv(system, rcond=1e-6), short)
        at = at + np.clip(step[:, :3], -size, size)
    length = known.lengths(at)
    r = length.min(axis=1)
    d = length[rows, own]
    good = (np.abs(np.where(has, d - r[:, None], 0.0)) < SAME).all(axis=1) & (r > SAME)
    good &= (np.linalg.norm(at - start, axis=1) < 4 * size) & known.inside(at)
    at, length = at[good], length[good]
    rank, sets = np.zeros(len(at), int), []
    ways = known.ways(at)
    for q in range(len(at)):
        some = np.flatnonzero(length[q] < length[q].min() + SAME)
        label = known.walls_of(some)
        first = some[np.unique(label, return_index=True)[1]]
        unit = ways[q, first] / length[q, first, None]
        rank[q] = (np.linalg.svd(unit[1:] - unit[0], compute_uv=False) > SPAN).sum()
        sets.append(tuple(some))
    junctions = _clusters(at[rank == 3], 100 * SAME)
    rows = np.flatnonzero(rank == 2)
    names = sorted({sets[i] for i in rows})
    which = np.array([names.index(sets[i]) for i in rows])
    alike = np.array([[known.alike(a, b) for b in names] for a in names]).reshape(len(names), -1)
    links = cKDTree(at[rows]).query_pairs(2.5 * size, output_type="ndarray")
    links = links[alike[which[links[:, 0]], which[links[:, 1]]]]
    return _labels(len(rows), links), junctions


def _crossings(known, places, pairs):
    """Halve grid edges to the place where the nearest element changes, and return both there."""
    low, high = places[pairs[:, 0]].copy(), places[pairs[:, 1]].copy()
    ends = [known.lengths(x).argmin(axis=1) for x in (low, high)]
    for _ in range(24):
        middle = 0.5 * (low + high)
        now = known.lengths(middle).argmin(axis=1)
        left = known.beside[now, ends[0]]
        low[left], high[~left] = middle[left], middle[~left]
        ends = [np.where(left, now, ends[0]), np.where(left, ends[1], now)]
    return 0.5 * (low + high), np.stack(ends, axis=1)


def _pieces(places, reach, two, beside):
    """Number what hangs together of places that are between two walls, the same ones."""
    links = cKDTree(places).query_pairs(reach, output_type="ndarray")
    (a, b), (c, d) = two[links[:, 0]].T, two[links[:, 1]].T
    same = (beside[a, c] & beside[b, d]) | (beside[a, d] & beside[b, c])
    return _labels(len(places), links[same])


def _labels(count, links):
    graph = coo_array((np.ones(len(links)), links.T), (count, count))
    return connected_components(graph, directed=False)[1]


def _clusters(places, reach):
    if not len(places):
        return np.empty((0, 3))
    label = _labels(len(places), cKDTree(places).query_pairs(reach, output_type="ndarray"))
    return np.array([places[label == k].mean(axis=0) for k in range(label.max() + 1)])


def solid_of(boxes):
    """The union of boxes (low, high) of whole or broken sizes, as triangles without T-junctions."""
    boxes = np.asarray(boxes, float)
    lines = [np.unique(boxes[:, :, k]) for k in range(3)]
    middles = [0.5 * (x[1:] + x[:-1]) for x in lines]
    full = np.zeros([len(x) + 2 for x in middles], bool)
    centers = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
    for low, high in boxes:
        full[1:-1, 1:-1, 1:-1] |= ((centers > low) & (centers < high)).all(axis=-1)
    return full, lines


def mesh_of(full, lines):
    """The boundary of cells of a rectilinear grid."""
    number, points, faces = {}, [], []

    def vertex(at):
        if at not in number:
            number[at] = len(points)
            points.append([lines[k][at[k]] for k in range(3)])
        return number[at]

    for cell in product(*(range(1, n - 1) for n in full.shape)):
        if not full[cell]:
            continue
        for k, side in product(range(3), (0, 1)):
            beside = list(cell)
            beside[k] += 2 * side - 1
            if full[tuple(beside)]:
                continue
            u, v = (k + 1) % 3, (k + 2) % 3
            quad = []
            for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)):
                at = [c - 1 for c in cell]
                at[k] += side
                at[u] += i
                at[v] += j
                quad.append(vertex(tuple(at)))
            if not side:
                quad.reverse()
            faces += [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]
    return np.array(points), np.array(faces)


SHAPES = {
    "box": [((0, 0, 0), (1, 0.8, 0.6))],
    "L": [((0, 0, 0), (2, 0.7, 1)), ((0, 0, 0), (0.6, 1.6, 1))],
    "T": [((0, 0, 0), (2, 0.6, 0.9)), ((0.7, 0, 0), (1.4, 1.5, 0.9))],
    "U": [((0, 0, 0), (2, 0.55, 0.9)), ((0, 0, 0), (0.6, 1.5, 0.9)), ((1.3, 0, 0), (2, 1.3, 0.9))],
    "cross": [((0, 0.8, 0), (2.2, 1.5, 0.8)), ((0.9, 0, 0), (1.5, 2.0, 0.8))],
    "stairs": [((0, 0, 0), (2.1, 0.5, 1)), ((0, 0, 0), (1.3, 1.1, 1)), ((0, 0, 0), (0.6, 1.6, 1))],
    "even L": [((0, 0, 0), (2, 1, 1)), ((0, 0, 0), (1, 2, 1))],
    "pocket": [
        ((0, 0, 0), (2, 1.6, 0.5)),
        ((0, 0, 0), (0.5, 1.6, 1.1)),
        ((1.4, 0, 0), (2, 1.6, 1.1)),
        ((0, 0, 0), (2, 0.4, 1.1)),
        ((0, 1.2, 0), (2, 1.6, 1.1)),
    ],
}

if __name__ == "__main__":
    for name in sys.argv[1].split(","):
        given = mesh_of(*solid_of(SHAPES[name]))
        for cells in map(int, sys.argv[2:]):
            print(name, cells, *numbers(*given, cells), flush=True)
