"""Kernels that turn depth and index buffers into a shaded, anti-aliased picture (thesis 3.4)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._splat_kernels import ball_normal, hit_point, triangle_hit
from medialis.base.jit import kernel


class Light(NamedTuple):
    """How a picture is lit: the Phong model, and shadows of what stands closely in front.

    Attributes
    ----------
    lamps : (l, 4) float64
        Unit direction to each lamp, and its intensity.
    ambient, diffuse, specular : float
        Weights, in linear light.
    shadow : float
        Darkening 0..1.
    shadow_depth : float
        Length from which on what stands in front darkens wholly.
    background : float
        Grey, in linear light.
    curve : (steps,) uint8
        The table linear light 0..1 -> 8 bits.
    """

    lamps: NDArray[np.float64]
    ambient: float
    diffuse: float
    specular: float
    shadow: float
    shadow_depth: float
    background: float
    curve: NDArray[np.uint8]


@kernel
def sum_normals(points, faces, flat, out_normals):
    """Add the normal of each face, times its angle there, at each of its corners.

    An angle of a face without an area is 0.
    """
    angles = np.empty(3)
    for f in range(len(faces)):
        for j in range(3):
            v, after, before = faces[f, j], faces[f, (j + 1) % 3], faces[f, (j + 2) % 3]
            dot, one, other = 0.0, 0.0, 0.0
            for axis in range(3):
                x = points[after, axis] - points[v, axis]
                y = points[before, axis] - points[v, axis]
                dot, one, other = dot + x * y, one + x * x, other + y * y
            scale = math.sqrt(one) * math.sqrt(other)
            angles[j] = math.acos(min(max(dot / scale, -1.0), 1.0)) if scale > 0 else 0.0
        for j in range(3):
            for axis in range(3):
                out_normals[faces[f, j], axis] += angles[j] * flat[f, axis]


@kernel
def pick_normals(begin, end, faces, flat, normals, cosine, out_corners):
    """Give each corner the normal of its vertex, or of the face where that leans too far."""
    for f in range(begin, end):
        for j in range(3):
            x, y, z = normals[faces[f, j], 0], normals[faces[f, j], 1], normals[faces[f, j], 2]
            if x * flat[f, 0] + y * flat[f, 1] + z * flat[f, 2] > cosine:
                out_corners[f, j, 0], out_corners[f, j, 1], out_corners[f, j, 2] = x, y, z
            else:
                for axis in range(3):
                    out_corners[f, j, axis] = flat[f, axis]


@kernel
def obscurance(row, col, depth, reach, scale):
    """Return 0..1: how far the eight neighbours at `reach` pixels stand in front of this pixel."""
    height, width = depth.shape
    here = depth[row, col]
    total = 0.0
    for dr in range(-1, 2):
        for dc in range(-1, 2):
            r, c = row + dr * reach, col + dc * reach
            if 0 <= r < height and 0 <= c < width:
                total += min(max((here - depth[r, c]) / scale, 0.0), 1.0)
    return total / 8.0


@kernel
def phong(nx, ny, nz, px, py, pz, perspective, light):
    """Return (diffuse factor, specular term); the highlight has the exponent 32, five squarings."""
    vx, vy, vz = 0.0, 0.0, -1.0
    if perspective:
        far = math.sqrt(px * px + py * py + pz * pz)
        vx, vy, vz = -px / far, -py / far, -pz / far
    # A sky slightly brighter than the ground keeps unlit sides readable.
    diffuse = light.ambient * (1.0 + 0.25 * ny)
    specular = 0.0
    lamps = light.lamps
    for k in range(len(lamps)):
        lx, ly, lz = lamps[k, 0], lamps[k, 1], lamps[k, 2]
        diffuse += light.diffuse * lamps[k, 3] * max(nx * lx + ny * ly + nz * lz, 0.0)
        hx, hy, hz = lx + vx, ly + vy, lz + vz
        length = math.sqrt(hx * hx + hy * hy + hz * hz)
        if length > 0:
            s = max((nx * hx + ny * hy + nz * hz) / length, 0.0)
            s *= s
            s *= s
            s *= s
            s *= s
            specular += light.specular * lamps[k, 3] * s * s
    return diffuse, specular


@kernel
def shade(canvas, lens, balls, mesh, light, begin, end, out):
    """Write the picture rows begin..end (uint8): shade n x n samples a pixel, average, encode.

    n is how much larger the canvas is. With a fourth channel in `out` the background is left out
    and the channel says how much of the pixel is covered.
    """
    depth, index, glass, curve = canvas.depth, canvas.index, canvas.glass, light.curve
    count, colors, perspective = len(balls.radii), balls.colors, lens.focal > 0
    n = depth.shape[1] // out.shape[1]
    see_through = len(glass) > 0
    top = len(curve) - 1
    transparent = out.shape[2] == 4
    for row in range(begin, end):
        for col in range(out.shape[1]):
            red = green = blue = cover = x0 = y0 = z0 = 0.0
            first = index[row * n, col * n]
            inside = True  # one triangle or ball covers the pixel: its light is computed once
            for sub in range(1, n * n):
                inside &= index[row * n + sub // n, col * n + sub % n] == first
            for sub in range(n * n):
                r, c = row * n + sub // n, col * n + sub % n
                i = index[r, c]
                if i >= 0 and (sub == 0 or not inside):
                    px, py, pz = hit_point(r, c, depth[r, c], lens)
                    if i < count:
                        nx, ny, nz, _ = ball_normal(i, px, py, pz, perspective, balls)
                        x0, y0, z0 = colors[i, 0], colors[i, 1], colors[i, 2]
                    else:
                        nx, ny, nz, _, x0, y0, z0 = triangle_hit(
                            i - count, px, py, pz, perspective, mesh
                        )
                    part, shine = phong(nx, ny, nz, px, py, pz, perspective, light)
                    part *= 1.0 - light.shadow * obscurance(r, c, depth, 2 * n, light.shadow_depth)
                    x0, y0, z0 = x0 * part + shine, y0 * part + shine, z0 * part + shine
                x = y = z = solid = 0.0
                if i >= 0:
                    x, y, z, solid = x0, y0, z0, 1.0
                if see_through and glass[r, c, 3] > 0:
                    passing = math.exp(-glass[r, c, 3])
                    veil = (1.0 - passing) / glass[r, c, 3]
                    x = x * passing + veil * glass[r, c, 0]
                    y = y * passing + veil * glass[r, c, 1]
                    z = z * passing + veil * glass[r, c, 2]
                    solid = 1.0 - (1.0 - solid) * passing
                cover += solid
                if not transparent:
                    behind = (1.0 - solid) * light.background
                    x, y, z = x + behind, y + behind, z + behind
                # Not min: NaN, from sizes beyond the range of products, must not index the table.
                red += x if x < 1.0 else 1.0
                green += y if y < 1.0 else 1.0
                blue += z if z < 1.0 else 1.0
            share = top / (n * n)
            if transparent:
                share = top / max(cover, 1e-6)
                out[row, col, 3] = int(255.0 * cover / (n * n) + 0.5)
            out[row, col, 0] = curve[min(int(red * share + 0.5), top)]
            out[row, col, 1] = curve[min(int(green * share + 0.5), top)]
            out[row, col, 2] = curve[min(int(blue * share + 0.5), top)]
