"""Points on balls, cones and slabs, before those that others hide are taken away."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

TURN = math.pi * (1.0 + math.sqrt(5.0))


@kernel
def count_points(balls, edges, faces, steps, fewest, most, out):
    """How many points each ball, cone and slab gets: about one for the square of its own step."""
    n = len(balls)
    for i in range(n):
        wanted = 4.0 * np.pi * balls[i, 3] ** 2 / steps[i] ** 2
        out[i] = int(min(max(wanted, fewest), most))
    for e in range(len(edges)):
        along, around = _cone_steps(balls, edges[e, 0], edges[e, 1], steps[n + e])
        out[n + e] = (along + 1) * around
    for f in range(len(faces)):
        k = _slab_steps(balls, faces[f], steps[n + len(edges) + f])
        out[n + len(edges) + f] = (k + 1) * (k + 2)


@kernel
def _apart(balls, i, j):
    return np.sqrt(
        (balls[i, 0] - balls[j, 0]) ** 2
        + (balls[i, 1] - balls[j, 1]) ** 2
        + (balls[i, 2] - balls[j, 2]) ** 2
    )


@kernel
def _cone_steps(balls, i, j, step):
    length = _apart(balls, i, j)
    if length <= abs(balls[i, 3] - balls[j, 3]) * (1.0 + 1e-9) + 1e-12:
        return -1, 0
    widest = max(balls[i, 3], balls[j, 3])
    return min(max(int(np.ceil(length / step)), 2), 400), min(
        max(int(np.ceil(2 * np.pi * widest / step)), 8), 400
    )


@kernel
def _slab_steps(balls, face, step):
    longest = max(
        _apart(balls, face[0], face[1]),
        _apart(balls, face[1], face[2]),
        _apart(balls, face[0], face[2]),
    )
    return min(max(int(np.ceil(longest / step)), 2), 300)


@kernel
def put_points(balls, edges, faces, steps, starts, out):
    """Fill out (p, 3); starts (b + e + f + 1,) are the counts summed up."""
    n = len(balls)
    for i in range(n):
        _on_ball(balls[i], starts[i], starts[i + 1], out)
    for e in range(len(edges)):
        if starts[n + e + 1] > starts[n + e]:
            _on_cone(steps[n + e], balls, edges[e], starts[n + e], out)
    for f in range(len(faces)):
        row = n + len(edges) + f
        _on_slab(balls, faces[f], steps[row], starts[row], out)


@kernel
def _on_ball(ball, begin, end, out):
    count = end - begin
    for k in range(count):
        z = 1.0 - (2.0 * k + 1.0) / count
        ring = np.sqrt(1.0 - z * z)
        turn = TURN * (k + 0.5)
        out[begin + k, 0] = ball[0] + ball[3] * ring * np.cos(turn)
        out[begin + k, 1] = ball[1] + ball[3] * ring * np.sin(turn)
        out[begin + k, 2] = ball[2] + ball[3] * z


@kernel
def _on_cone(step, balls, edge, begin, out):
    first, second = balls[edge[0]], balls[edge[1]]
    along, around = _cone_steps(balls, edge[0], edge[1], step)
    axis = second[:3] - first[:3]
    length = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    axis = axis / length
    least = 0
    for d in range(1, 3):
        if abs(axis[d]) < abs(axis[least]):
            least = d
    side = -axis[least] * axis
    side[least] += 1.0
    side = side / np.sqrt(side[0] ** 2 + side[1] ** 2 + side[2] ** 2)
    up = np.empty(3)
    for d in range(3):
        a, b = (d + 1) % 3, (d + 2) % 3
        up[d] = axis[a] * side[b] - axis[b] * side[a]
    back = (second[3] - first[3]) / length  # the normal leans back where the cone grows
    lean = np.sqrt(1.0 - back * back)
    for i in range(along + 1):
        t = i / along
        r = first[3] + t * (second[3] - first[3])
        for j in range(around):
            turn = 2.0 * np.pi * j / around
            for d in range(3):
                normal = lean * (np.cos(turn) * side[d] + np.sin(turn) * up[d]) - back * axis[d]
                out[begin + i * around + j, d] = first[d] + t * length * axis[d] + r * normal


@kernel
def _on_slab(balls, face, step, begin, out):
    k = _slab_steps(balls, face, step)
    a, b, c = balls[face[0]], balls[face[1]], balls[face[2]]
    u, v = b[:3] - a[:3], c[:3] - a[:3]
    uu, uv, vv = (u * u).sum(), (u * v).sum(), (v * v).sum()
    area = uu * vv - uv * uv
    normal, gradient = np.zeros(3), np.zeros(3)
    if area > 1e-14 * uu * vv:
        ur, vr = b[3] - a[3], c[3] - a[3]
        gradient = ((ur * vv - vr * uv) * u + (vr * uu - ur * uv) * v) / area
        for d in range(3):
            p, q = (d + 1) % 3, (d + 2) % 3
            normal[d] = (u[p] * v[q] - u[q] * v[p]) / np.sqrt(area)
    steep = (gradient * gradient).sum()
    if steep >= 1.0:
        normal[:], gradient[:] = 0.0, 0.0  # no side of its own: the middle, which others hide
    height = np.sqrt(max(1.0 - steep, 0.0))
    at = begin
    for i in range(k + 1):
        for j in range(k + 1 - i):
            s, t = i / k, j / k
            r = a[3] + s * (b[3] - a[3]) + t * (c[3] - a[3])
            for sign in (-1.0, 1.0):
                for d in range(3):
                    out[at, d] = (
                        a[d] + s * u[d] + t * v[d] + r * (sign * height * normal[d] - gradient[d])
                    )
                at += 1
