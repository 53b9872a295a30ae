"""Kernel that fills long thin faces with triangles between the new vertices on their sides."""

from __future__ import annotations

from medialis._kernels.jit import kernel


@kernel
def _apart(points, a, b):
    return (
        (points[a, 0] - points[b, 0]) ** 2
        + (points[a, 1] - points[b, 1]) ** 2
        + (points[a, 2] - points[b, 2]) ** 2
    )


@kernel
def zip_strips(points, ring, first, below, out_faces):
    """Triangles of each strip: its rim is ring[first[s]:first[s + 1]], its base comes first.

    `below` is the number of pieces of the base, which both other sides face; b pieces there and a
    on the other sides make a + b - 2 triangles. One end after the other moves on, that with the
    shorter way across. No new vertex is needed, and no triangle lies on one side alone.
    """
    at = 0
    for s in range(len(below)):
        base, count, b = first[s], first[s + 1] - first[s], below[s]
        a = count - b
        i, j = 1, 1
        low, up = ring[base + 1], ring[base + count - 1]
        out_faces[at, 0], out_faces[at, 1], out_faces[at, 2] = ring[base], low, up
        at += 1
        while i < b - 1 or j < a - 1:
            next_low, next_up = ring[base + i + 1], ring[base + count - j - 1]
            move_low = i < b - 1 and (
                j == a - 1 or _apart(points, next_low, up) <= _apart(points, low, next_up)
            )
            out_faces[at, 0] = low
            if move_low:
                out_faces[at, 1], out_faces[at, 2] = next_low, up
                low, i = next_low, i + 1
            else:
                out_faces[at, 1], out_faces[at, 2] = next_up, up
                up, j = next_up, j + 1
            at += 1
        out_faces[at, 0], out_faces[at, 1], out_faces[at, 2] = low, ring[base + b], up
        at += 1
