"""Slow and obvious versions of the algorithms, in plain numpy."""

from collections import Counter

import numpy as np


def thesis_algorithm_1(points, normals, largest, tau):
    """Thesis 3.2, Algorithm 1, as printed, with brute-force nearest neighbours.

    Returns radii and second features; a ball that nothing stops keeps the radius `largest` and
    feature -1. Samples at the very place of p count as p.
    """
    radii, second = np.full(len(points), np.nan), np.full(len(points), -1)
    for i, (p, n) in enumerate(zip(points, normals, strict=True)):
        if not n.any():
            continue
        same = (points == p).all(axis=1)
        low = high = largest
        while True:
            distance = np.linalg.norm(points - (p - low * n), axis=1)
            f2 = int(distance.argmin())
            if abs(low - distance[f2]) < tau or same[f2]:
                break
            high = low
            second[i] = f2
            gap = points[f2] - p
            low = -(gap @ gap) / (2 * n @ gap)
        if abs(low - distance[f2]) >= tau:  # p itself is nearest: the ball was made too small
            while high - low > tau:
                r = 0.5 * (high + low)
                distance = np.linalg.norm(points - (p - r * n), axis=1)
                if same[distance.argmin()]:
                    low = r
                else:
                    high, second[i] = r, int(distance.argmin())
        radii[i] = low
    return radii, second


def depth_radii(points, normals, i, a, near):
    """r_a(q) for all q: the radius at which q lies a deep in the ball of sample i (inf: never)."""
    d = points[i] - points
    num, den = (d * d).sum(axis=1), 2 * d @ normals[i]
    radii = np.full(len(points), np.inf)
    far = (num > near**2) & (den > 2 * a)
    radii[far] = (num[far] - a * a) / (den[far] - 2 * a)
    return radii


def brute_force_balls(points, normals, a, near):
    """Smallest r_a(q) of each sample and its q (inf and -1 without one; NaN without a normal)."""
    radii, second = np.full(len(points), np.nan), np.full(len(points), -1)
    for i in np.flatnonzero(normals.any(axis=1)):
        all_radii = depth_radii(points, normals, i, a, near)
        radii[i] = all_radii.min()
        second[i] = all_radii.argmin() if np.isfinite(radii[i]) else -1
    return radii, second


def deepest(points, centers, radii):
    """How deep the deepest sample lies in each ball (0 or below: empty)."""
    distance = np.linalg.norm(points[None] - centers[:, None], axis=2)
    return radii - distance.min(axis=1)


def greedy_subsample(points, priority, distance):
    """Take points by falling priority, keep each one that is `distance` from all kept ones."""
    keep = []
    for i in np.argsort(-np.asarray(priority), kind="stable"):
        if all(np.sqrt(((points[i] - points[j]) ** 2).sum()) >= distance for j in keep):
            keep.append(i)
    mask = np.zeros(len(points), bool)
    mask[keep] = True
    return mask


def edge_uses(faces):
    """How many faces use each undirected edge."""
    uses = Counter()
    for face in np.asarray(faces).tolist():
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            uses[min(a, b), max(a, b)] += 1
    return uses


def face_neighbours(faces):
    """The face across each edge of each face, by a search over all faces; -1 unless exactly one."""
    result = np.full((len(faces), 3), -1)
    for f, face in enumerate(faces):
        for j in range(3):
            ends = {int(face[j]), int(face[(j + 1) % 3])}
            others = [
                g
                for g, other in enumerate(faces)
                for k in range(3)
                if {int(other[k]), int(other[(k + 1) % 3])} == ends and (g, k) != (f, j)
            ]
            if len(others) == 1 and others[0] != f:
                result[f, j] = others[0]
    return result


def euler_number(faces):
    """Vertices - edges + faces, counting used vertices only."""
    return len(np.unique(faces)) - len(edge_uses(faces)) + len(faces)


def component_labels(count, faces):
    """Components numbered by their lowest vertex, by repeated spreading of the lowest number."""
    label = np.arange(count)
    while True:
        before = label.copy()
        for face in faces:
            label[face] = label[face].min()
        if (label == before).all():
            return np.unique(label, return_inverse=True)[1]


def feature_sets(shape, cloud, reach):
    """Thesis 6.2.1.1: for each ball its samples as clusters, a set of sets of samples.

    Samples are linked when they share an edge or a neighbour; the spacing is the mean length of the
    edges at the two feature points.
    """
    near = [set() for _ in shape.points]
    for face in shape.faces:
        for a in face:
            near[a] |= set(face.tolist()) - {a}
    spacing = [
        np.mean([np.linalg.norm(shape.points[a] - shape.points[b]) for b in near[a]])
        for a in range(len(near))
    ]
    result = []
    for row in range(len(cloud)):
        if not cloud.valid[row]:
            result.append(set())
            continue
        tau = reach * np.mean([spacing[f] for f in cloud.features[row]])
        distance = np.linalg.norm(shape.points - cloud.centers[row], axis=1)
        left = set(np.flatnonzero(distance <= cloud.radii[row] + tau).tolist())
        left |= set(cloud.features[row].tolist())
        clusters = set()
        while left:
            cluster, front = set(), {min(left)}
            while front:
                cluster |= front
                around = front.union(*(near[a] for a in front))
                front = around.union(*(near[a] for a in around)) & left - cluster
            clusters.add(frozenset(cluster))
            left -= cluster
        result.append(clusters)
    return result


def winding_numbers(points, faces, queries):
    """How often a closed mesh surrounds each query, by solid angles: 1 inside, 0 outside."""
    result = []
    for query in queries:
        a, b, c = (points[faces[:, j]] - query for j in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a)))
        solid = np.einsum("ij,ij->i", a, np.cross(b, c))
        angle = np.arctan2(solid, la * lb * lc + ab * lc + bc * la + ca * lb)
        result.append(angle.sum() / (2 * np.pi))
    return np.array(result)
