"""Kernels that change triangle meshes in place: edges split, flipped and collapsed.

A mesh is a few arrays with room to spare: `points` (p, 3), `faces` (f, 3; -1 in all corners of a
face that is gone), `twins` (3f: the half-edge across, -1 at a border), `marks` (3f: what is drawn
along an edge, the same on both sides, 0 nothing), `tags` (f: handed on to what becomes of a face),
`leaving` (p: a half-edge that leaves the vertex, -1 without faces), `sizes` (vertices, faces).
Half-edge 3 f + j runs from corner j of face f to the next one.
"""

from __future__ import annotations

from medialis._kernels.jit import kernel


@kernel
def after(h):
    """Return the next half-edge of the same face."""
    return h - 2 if h % 3 == 2 else h + 1


@kernel
def before(h):
    """Return the half-edge before it in the same face."""
    return h + 2 if h % 3 == 0 else h - 1


@kernel
def around(faces, twins, leaving, v, out):
    """List the half-edges that leave a vertex, in turn; return their number, negative at a border.

    At a border the list begins at the half-edge after which there is none: it covers the fan.
    """
    start = leaving[v]
    if start < 0:
        return 0
    h, count = start, 0
    # Turn back to the border, or once around.
    while True:
        twin = twins[h]
        if twin < 0:
            break
        h = after(twin)
        count += 1
        if h == start or count >= len(out):
            break
    closed = h == start and twins[start] >= 0
    first, count = h, 0
    while count < len(out):
        out[count] = h
        count += 1
        twin = twins[before(h)]
        if twin < 0 or twin == first:
            break
        h = twin
    return count if closed else -count


@kernel
def split_edge(points, faces, twins, marks, tags, leaving, sizes, h, x, y, z):
    """Put a vertex on an edge; return its number. The two parts carry the mark of the edge."""
    w = sizes[0]
    sizes[0] += 1
    points[w, 0], points[w, 1], points[w, 2] = x, y, z
    g = twins[h]
    f1 = sizes[1]
    g1 = f1 + 1
    sizes[1] += 1 if g < 0 else 2
    hn, hp = after(h), before(h)
    f = h // 3
    b, c = faces[f, hn % 3], faces[f, hp % 3]
    mark, outer, outer_mark = marks[h], twins[hn], marks[hn]
    faces[f, hn % 3] = w
    faces[f1, 0], faces[f1, 1], faces[f1, 2] = w, b, c
    tags[f1] = tags[f]
    twins[hn], twins[3 * f1 + 2] = 3 * f1 + 2, hn
    marks[hn] = marks[3 * f1 + 2] = 0
    twins[3 * f1 + 1], marks[3 * f1 + 1] = outer, outer_mark
    if outer >= 0:
        twins[outer] = 3 * f1 + 1
    marks[3 * f1] = mark
    leaving[b], leaving[c], leaving[w] = 3 * f1 + 1, 3 * f1 + 2, 3 * f1
    if g < 0:
        twins[3 * f1] = -1
        return w
    gn, gp = after(g), before(g)
    e = g // 3
    a, d = faces[e, gn % 3], faces[e, gp % 3]
    outer, outer_mark = twins[gn], marks[gn]
    faces[e, gn % 3] = w
    faces[g1, 0], faces[g1, 1], faces[g1, 2] = w, a, d
    tags[g1] = tags[e]
    twins[gn], twins[3 * g1 + 2] = 3 * g1 + 2, gn
    marks[gn] = marks[3 * g1 + 2] = 0
    twins[3 * g1 + 1], marks[3 * g1 + 1] = outer, outer_mark
    if outer >= 0:
        twins[outer] = 3 * g1 + 1
    marks[3 * g1] = mark
    twins[h], twins[3 * g1] = 3 * g1, h
    twins[3 * f1], twins[g] = g, 3 * f1
    leaving[a], leaving[d] = 3 * g1 + 1, 3 * g1 + 2
    return w


@kernel
def split_face(points, faces, twins, marks, tags, leaving, sizes, f, x, y, z):
    """Put a vertex into a face; return its number."""
    w, f1 = sizes[0], sizes[1]
    f2 = f1 + 1
    sizes[0] += 1
    sizes[1] += 2
    points[w, 0], points[w, 1], points[w, 2] = x, y, z
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    tags[f1] = tags[f2] = tags[f]
    faces[f, 2] = w
    faces[f1, 0], faces[f1, 1], faces[f1, 2] = b, c, w
    faces[f2, 0], faces[f2, 1], faces[f2, 2] = c, a, w
    for side, face in ((1, f1), (2, f2)):
        outer = twins[3 * f + side]
        twins[3 * face], marks[3 * face] = outer, marks[3 * f + side]
        if outer >= 0:
            twins[outer] = 3 * face
    for one, other in ((f, f1), (f1, f2), (f2, f)):
        twins[3 * one + 1], twins[3 * other + 2] = 3 * other + 2, 3 * one + 1
        marks[3 * one + 1] = marks[3 * other + 2] = 0
    leaving[a], leaving[b], leaving[c], leaving[w] = 3 * f, 3 * f1, 3 * f2, 3 * f + 2
    return w


@kernel
def flip(faces, twins, marks, leaving, h):
    """Replace the edge between two faces by the other diagonal of their four corners."""
    g = twins[h]
    f, e = h // 3, g // 3
    hn, hp, gn, gp = after(h), before(h), after(g), before(g)
    a, b, c, d = faces[f, h % 3], faces[f, hn % 3], faces[f, hp % 3], faces[e, gp % 3]
    t = (twins[hp], twins[gn], twins[gp], twins[hn])
    m = (marks[hp], marks[gn], marks[gp], marks[hn])
    faces[f, 0], faces[f, 1], faces[f, 2] = c, a, d
    faces[e, 0], faces[e, 1], faces[e, 2] = d, b, c
    for k, slot in enumerate((3 * f, 3 * f + 1, 3 * e, 3 * e + 1)):
        twins[slot], marks[slot] = t[k], m[k]
        if t[k] >= 0:
            twins[t[k]] = slot
    twins[3 * f + 2], twins[3 * e + 2] = 3 * e + 2, 3 * f + 2
    marks[3 * f + 2] = marks[3 * e + 2] = 0
    leaving[a], leaving[b], leaving[c], leaving[d] = 3 * f + 1, 3 * e + 1, 3 * f, 3 * e


@kernel
def may_collapse(faces, twins, leaving, h, ring, other):
    """Tell whether the start of an edge may join its end: the mesh stays a surface.

    Both may have no common neighbours but the tips of the faces at the edge, and an edge between
    two places of the border must be one of it.
    """
    a, b = faces[h // 3, h % 3], faces[h // 3, after(h) % 3]
    g = twins[h]
    n = around(faces, twins, leaving, a, ring)
    k = around(faces, twins, leaving, b, other)
    if n < 0 and k < 0 and g >= 0:
        return False
    if abs(n) + abs(k) >= len(ring):
        return False
    if 0 < n <= 3 or 0 < k <= 3:
        return False
    if (n == -1 or k == -1) and g < 0 and abs(n) + abs(k) <= 2:
        return False
    common = 0
    for i in range(abs(n)):
        for s in range(2):
            if s == 1 and not (n < 0 and i == abs(n) - 1):
                continue
            u = faces[ring[i] // 3, after(ring[i]) % 3]
            if s == 1:
                u = faces[ring[i] // 3, before(ring[i]) % 3]
            for j in range(abs(k)):
                q = other[j]
                if faces[q // 3, after(q) % 3] == u:
                    common += 1
                if k < 0 and j == abs(k) - 1 and faces[q // 3, before(q) % 3] == u:
                    common += 1
    return common == (1 if g < 0 else 2)


@kernel
def collapse(faces, twins, marks, leaving, h, ring):
    """Let the start of an edge join its end; two faces go, one at a border."""
    f = h // 3
    a, b = faces[f, h % 3], faces[f, after(h) % 3]
    g = twins[h]
    n = abs(around(faces, twins, leaving, a, ring))
    for i in range(n):
        faces[ring[i] // 3, ring[i] % 3] = b
    for edge in (h, g):
        if edge < 0:
            continue
        one, two = twins[after(edge)], twins[before(edge)]
        mark = max(marks[after(edge)], marks[before(edge)])
        face = edge // 3
        tip = faces[face, before(edge) % 3]
        if one >= 0:
            twins[one], marks[one] = two, mark
            leaving[tip] = one if faces[one // 3, one % 3] == tip else after(one)
            leaving[b] = after(one) if faces[one // 3, one % 3] == tip else one
        if two >= 0:
            twins[two], marks[two] = one, mark
            leaving[tip] = two if faces[two // 3, two % 3] == tip else after(two)
            leaving[b] = after(two) if faces[two // 3, two % 3] == tip else two
        if one < 0 and two < 0:
            leaving[tip] = -1
        for j in range(3):
            faces[face, j] = -1
            twins[3 * face + j] = -1
            marks[3 * face + j] = 0
    leaving[a] = -1


@kernel
def find_edge(faces, twins, leaving, a, b, ring):
    """Return a half-edge from a to b, else one from b to a; -1: there is no such edge."""
    for turn in range(2):
        v, w = (a, b) if turn == 0 else (b, a)
        for i in range(abs(around(faces, twins, leaving, v, ring))):
            if faces[ring[i] // 3, after(ring[i]) % 3] == w:
                return ring[i]
    return -1


@kernel
def split_edges(
    points, faces, twins, marks, tags, leaving, sizes, a, b, places, ring, out_vertices
):  # fmt: skip
    """Put a vertex on each of some edges, given by their ends; out_vertices: -1 without edge."""
    for i in range(len(a)):
        h = find_edge(faces, twins, leaving, a[i], b[i], ring)
        out_vertices[i] = -1
        if h >= 0:
            out_vertices[i] = split_edge(
                points, faces, twins, marks, tags, leaving, sizes, h,
                places[i, 0], places[i, 1], places[i, 2],
            )  # fmt: skip
