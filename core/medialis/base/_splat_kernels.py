"""Kernels of pictures (thesis 3.4): depth buffers of balls and triangles, and their shading.

Strategy. Everything is in view space: x right, y up, z the distance along the viewing axis. The
image is cut into horizontal bands; `fill_bins` lists for each band the primitives that touch it, in
ascending order, and a band is drawn by one call that writes only its own rows. So there are no
races, and because a pixel changes only for a strictly smaller depth, ties go to the lowest index
whatever the number of threads.

Pixel (row, col) has its center at (col + 0.5, row + 0.5). The depth of a sphere is exact at each;
`shade` turns depths and indices into a lit, anti-aliased picture.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel


class Lens(NamedTuple):
    """A camera as the kernels read it.

    Attributes
    ----------
    scale : float
        Pixels per unit.
    column, row : float
        Center of the picture.
    focal : float
        Focal length in pixels; 0 for orthographic.
    near : float
        Depth of the near plane.
    sign : float
        +1 keeps the nearest surface, -1 the furthest.
    """

    scale: float
    column: float
    row: float
    focal: float
    near: float
    sign: float


class Balls(NamedTuple):
    """Balls seen by one camera.

    Attributes
    ----------
    centers : (k, 3) float64
        In view space.
    radii : (k,) float64
        As they are drawn.
    boxes : (k, 4) int32
        First and last row, first and last column; within the image.
    colors : (k, 3) float32
        In linear light.
    """

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    boxes: NDArray[np.int32]
    colors: NDArray[np.float32]


class Triangles(NamedTuple):
    """Triangles seen by one camera, clipped at its near plane.

    Attributes
    ----------
    screen : (n, 3) float64
        Column, row, and z (orthographic) or 1/z (perspective), which is linear on the screen.
    corners : (t, 3) int32
    names : (t,) int32
        What each piece is known as in the index buffer.
    """

    screen: NDArray[np.float64]
    corners: NDArray[np.int32]
    names: NDArray[np.int32]


class Mesh(NamedTuple):
    """The faces that pieces of triangles belong to.

    Attributes
    ----------
    points : (n, 3) float64
        In view space.
    faces : (m, 3) int32
    normals, colors : (m, 3, 3) float32
        At the corners; colors in linear light.
    density : (m,) float32
        Optical density of a see-through face, seen along its normal.
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32]
    colors: NDArray[np.float32]
    density: NDArray[np.float32]


class Canvas(NamedTuple):
    """What has been drawn.

    Attributes
    ----------
    depth : (h, w) float64
        sign * z while drawing; +inf for nothing.
    index : (h, w) int32
        The ball or triangle, by its name; -1 for nothing.
    glass : (h, w, 4) or (0, 0, 4) float32
        Light (3) and density of see-through layers, where there are any.
    """

    depth: NDArray[np.float64]
    index: NDArray[np.int32]
    glass: NDArray[np.float32]


@kernel
def fill_bins(first, last, cursor, out_items):
    """List item i in the bins first[i]..last[i]; `cursor` holds each bin's next free slot."""
    for i in range(len(first)):
        for b in range(first[i], last[i] + 1):
            out_items[cursor[b]] = i
            cursor[b] += 1


@kernel
def pixel_of(position):
    """Return the pixel that holds a position; -1 and 10^6 stand for all that is far outside."""
    return math.floor(min(max(position, -1.0), 1e6))


@kernel
def pixel_range(low, high, begin, end):
    """Return first and last pixel of begin..end whose center is in low..high.

    The clamp comes before the rounding: 1e300 has no integer.
    """
    first = math.ceil(min(max(low - 0.5, float(begin)), float(end)))
    last = math.floor(max(min(high - 0.5, end - 1.0), begin - 1.0))
    return first, last


@kernel
def splat_balls(items, balls, lens, begin, end, out):
    """Draw the balls `items` into rows begin..end."""
    for i in items:
        row0, row1 = max(balls.boxes[i, 0], begin), min(balls.boxes[i, 1], end - 1)
        if lens.focal > 0:
            _perspective_ball(i, balls, lens, row0, row1, out)
        else:
            _orthographic_ball(i, balls, lens, row0, row1, out)


@kernel
def _orthographic_ball(i, balls, lens, row0, row1, out):
    # Depth at the offset (dx, dy) from the center: z - sqrt(r^2 - dx^2 - dy^2). It wins over the
    # depth d when z < d or when the root exceeds z - d, which mostly spares the square root.
    view, radius, boxes = balls.centers, balls.radii[i], balls.boxes
    scale, out_depth, out_index = lens.scale, out.depth, out.index
    unit = 1.0 / scale
    x, y = lens.column + scale * view[i, 0], lens.row - scale * view[i, 1]
    key = lens.sign * view[i, 2]
    center_row, center_col = pixel_of(y), pixel_of(x)
    for row in range(row0, row1 + 1):
        dy = (row + 0.5 - y) * unit
        chord = radius * radius - dy * dy
        half = math.sqrt(max(chord, 0.0)) * scale
        col0, col1 = pixel_range(x - half, x + half, boxes[i, 2], boxes[i, 3] + 1)
        if row == center_row and boxes[i, 2] <= center_col <= boxes[i, 3]:
            # A ball between pixel centers still covers the pixel that it lies in.
            col0, col1 = min(col0, center_col), max(col1, center_col)
        for col in range(col0, col1 + 1):
            dx = (col + 0.5 - x) * unit
            q = chord - dx * dx
            if q < 0:
                if row != center_row or col != center_col:
                    continue
                q = 0.0
            gap = key - out_depth[row, col]
            if gap < 0 or q > gap * gap:
                depth = key - math.sqrt(q)
                if depth < out_depth[row, col]:
                    out_depth[row, col] = depth
                    out_index[row, col] = i


@kernel
def _perspective_ball(i, balls, lens, row0, row1, out):
    # The ray of a pixel is t (u, v, 1); it meets the sphere where |t d - c|^2 = r^2, that is
    # t = (d.c -+ sqrt(d.d r^2 - |c x d|^2)) / d.d. The cross product avoids the cancellation of
    # (d.c)^2 - d.d (c.c - r^2) for small balls far away.
    view, radius, boxes = balls.centers, balls.radii[i], balls.boxes
    x, y, z = view[i, 0], view[i, 1], view[i, 2]
    focal, near, sign = lens.focal, lens.near, lens.sign
    out_depth, out_index = out.depth, out.index
    center_row, center_col = -1, -1
    if z > near:
        center_row = pixel_of(lens.row - focal * y / z)
        center_col = pixel_of(lens.column + focal * x / z)
    unit = 1.0 / focal
    whole = z - radius >= near
    for row in range(row0, row1 + 1):
        v = (lens.row - row - 0.5) * unit
        a = y - z * v
        rest = a * a
        for col in range(boxes[i, 2], boxes[i, 3] + 1):
            u = (col + 0.5 - lens.column) * unit
            b = z * u - x
            c = x * v - y * u
            dd = u * u + v * v + 1.0
            q = dd * radius * radius - (rest + b * b + c * c)
            if q < 0:
                if row != center_row or col != center_col:
                    continue
                q = 0.0
            along = u * x + v * y + z
            if whole:  # most pixels are hidden: know it without a root and a division
                gap = sign * along - out_depth[row, col] * dd
                if gap >= 0 and q <= gap * gap:
                    continue
            root = math.sqrt(q)
            t = (along - sign * root) / dd
            if t < near:  # the eye is inside the ball: its far side
                t = (along + root) / dd
                if t < near:
                    continue
            if sign * t < out_depth[row, col]:
                out_depth[row, col] = sign * t
                out_index[row, col] = i


@kernel
def edge(ax, ay, bx, by):
    """Return origin, direction and tie flag of the edge a -> b with the triangle at its left.

    The side of p is dx (py - oy) - dy (px - ox). The origin is the same end whichever triangle asks
    and b - a is exactly -(a - b), so two triangles that share the edge get opposite numbers, bit
    for bit; a zero belongs to the one whose tie flag is set. Hence no gaps and no double hits.
    """
    dx, dy = bx - ax, by - ay
    closed = dy > 0 or (dy == 0 and dx < 0)
    if bx < ax or (bx == ax and by < ay):
        return bx, by, dx, dy, closed
    return ax, ay, dx, dy, closed


@kernel
def covers(e0, e1, e2, closed0, closed1, closed2):
    """Tell whether a pixel with these sides of the three edges belongs to the triangle (`edge`)."""
    if e0 < 0 or e1 < 0 or e2 < 0:
        return False
    tie = (e0 == 0 and not closed0) or (e1 == 0 and not closed1) or (e2 == 0 and not closed2)
    return not tie


@kernel
def orient(corners, screen):
    """Return the corners of a triangle in the order of positive area, and twice that area."""
    a, b, c = corners[0], corners[1], corners[2]
    area = (screen[b, 0] - screen[a, 0]) * (screen[c, 1] - screen[a, 1]) - (
        screen[b, 1] - screen[a, 1]
    ) * (screen[c, 0] - screen[a, 0])
    if area < 0:
        return a, c, b, -area
    return a, b, c, area


@kernel
def triangle_rows(screen, corners, height, width, out_first, out_last):
    """First and last row of the pixels whose centers a triangle may cover; 1 and 0 for none."""
    for i in range(len(corners)):
        a, b, c = screen[corners[i, 0]], screen[corners[i, 1]], screen[corners[i, 2]]
        col0, col1 = pixel_range(min(a[0], b[0], c[0]), max(a[0], b[0], c[0]), 0, width)
        row0, row1 = pixel_range(min(a[1], b[1], c[1]), max(a[1], b[1], c[1]), 0, height)
        none = col0 > col1 or row0 > row1
        out_first[i], out_last[i] = (1, 0) if none else (row0, row1)


@kernel
def draw_triangles(items, triangles, lens, begin, end, mesh, out):
    """Draw the triangles `items` into rows begin..end, by the rule that counts pixel centers.

    On a canvas with glass nothing hides: the optical density of each layer of the `mesh` in front
    of what is drawn is added by `add_layer`.
    """
    screen, corners, names = triangles.screen, triangles.corners, triangles.names
    out_depth, out_index, glass = out.depth, out.index, len(out.glass) > 0
    width = out_depth.shape[1]
    for i in items:
        a, b, c, area = orient(corners[i], screen)
        if not area > 0:
            continue
        xa, ya, xb, yb = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        xc, yc = screen[c, 0], screen[c, 1]
        col0, col1 = pixel_range(min(xa, xb, xc), max(xa, xb, xc), 0, width)
        row0, row1 = pixel_range(min(ya, yb, yc), max(ya, yb, yc), begin, end)
        if col0 > col1 or row0 > row1:
            continue
        ox0, oy0, dx0, dy0, closed0 = edge(xb, yb, xc, yc)
        ox1, oy1, dx1, dy1, closed1 = edge(xc, yc, xa, ya)
        ox2, oy2, dx2, dy2, closed2 = edge(xa, ya, xb, yb)
        wa, wb, wc = screen[a, 2], screen[b, 2], screen[c, 2]
        low, high = min(wa, wb, wc), max(wa, wb, wc)
        for row in range(row0, row1 + 1):
            s0, s1, s2 = (
                dx0 * (row + 0.5 - oy0),
                dx1 * (row + 0.5 - oy1),
                dx2 * (row + 0.5 - oy2),
            )
            entered = False
            for col in range(col0, col1 + 1):
                e0 = s0 - dy0 * (col + 0.5 - ox0)
                e1 = s1 - dy1 * (col + 0.5 - ox1)
                e2 = s2 - dy2 * (col + 0.5 - ox2)
                if not covers(e0, e1, e2, closed0, closed1, closed2):
                    if entered:  # the sides only rise or only fall along a row, rounded too
                        break
                    continue
                entered = True
                w = min(max((e0 * wa + e1 * wb + e2 * wc) / area, low), high)
                depth = lens.sign / w if lens.focal > 0 else lens.sign * w
                if depth < out_depth[row, col]:
                    if glass:
                        add_layer(row, col, depth, names[i], lens, mesh, out.glass)
                    else:
                        out_depth[row, col] = depth
                        out_index[row, col] = names[i]


@kernel
def hit_point(row, col, depth, lens):
    """Return the view-space point at a pixel's center and depth."""
    if lens.focal > 0:
        return (
            depth * (col + 0.5 - lens.column) / lens.focal,
            depth * (lens.row - row - 0.5) / lens.focal,
            depth,
        )
    return (col + 0.5 - lens.column) / lens.scale, (lens.row - row - 0.5) / lens.scale, depth


@kernel
def weights(px, py, pz, a, b, c):
    """Return the barycentric coordinates of p in the triangle a, b, c, clipped to it."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = px - a[0], py - a[1], pz - a[2]
    uu, uv, vv = (
        ux * ux + uy * uy + uz * uz,
        ux * vx + uy * vy + uz * vz,
        vx * vx + vy * vy + vz * vz,
    )
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    det = uu * vv - uv * uv
    if not det > 0:
        return 1.0, 0.0, 0.0
    s = min(max((vv * wu - uv * wv) / det, 0.0), 1.0)
    t = min(max((uu * wv - uv * wu) / det, 0.0), 1.0 - s)
    return 1.0 - s - t, s, t


@kernel
def facing(nx, ny, nz, px, py, pz, perspective):
    """Return the unit normal turned to the viewer, and the cosine of its angle to the viewer."""
    vx, vy, vz = 0.0, 0.0, -1.0
    if perspective:
        far = math.sqrt(px * px + py * py + pz * pz)
        vx, vy, vz = -px / far, -py / far, -pz / far
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > 0:
        return vx, vy, vz, 1.0
    cosine = (nx * vx + ny * vy + nz * vz) / length
    if cosine < 0:
        length, cosine = -length, -cosine
    return nx / length, ny / length, nz / length, cosine


@kernel
def triangle_hit(face, px, py, pz, perspective, mesh):
    """Return facing normal, cosine and base color where the point p lies in a triangle."""
    points, normals, colors = mesh.points, mesh.normals, mesh.colors
    a, b, c = mesh.faces[face, 0], mesh.faces[face, 1], mesh.faces[face, 2]
    s, t, u = weights(px, py, pz, points[a], points[b], points[c])
    n, k = normals[face], colors[face]
    nx, ny, nz, cosine = facing(
        s * n[0, 0] + t * n[1, 0] + u * n[2, 0],
        s * n[0, 1] + t * n[1, 1] + u * n[2, 1],
        s * n[0, 2] + t * n[1, 2] + u * n[2, 2],
        px,
        py,
        pz,
        perspective,
    )
    red = s * k[0, 0] + t * k[1, 0] + u * k[2, 0]
    green = s * k[0, 1] + t * k[1, 1] + u * k[2, 1]
    blue = s * k[0, 2] + t * k[1, 2] + u * k[2, 2]
    return nx, ny, nz, cosine, red, green, blue


@kernel
def add_layer(row, col, depth, face, lens, mesh, out_glass):
    """Add one see-through layer: light passes as exp(-density), more density at silhouettes.

    Densities add up, so the order of the layers does not matter. Lighting is a gentle headlight.
    """
    px, py, pz = hit_point(row, col, depth, lens)
    _, ny, _, cosine, red, green, blue = triangle_hit(face, px, py, pz, lens.focal > 0, mesh)
    rim = 1.0 - cosine
    density = mesh.density[face] * (1.0 + 9.0 * rim * rim * rim)
    light = density * (0.45 + 0.45 * cosine + 0.1 * ny)
    out_glass[row, col, 0] += light * red
    out_glass[row, col, 1] += light * green
    out_glass[row, col, 2] += light * blue
    out_glass[row, col, 3] += density


@kernel
def ball_normal(i, px, py, pz, perspective, balls):
    """Return facing normal of a ball at the point p, and its cosine."""
    centers = balls.centers
    x, y, z = px - centers[i, 0], py - centers[i, 1], pz - centers[i, 2]
    return facing(x, y, z, px, py, pz, perspective)


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
                before = here - depth[r, c]
                if before >= scale:
                    total += 1.0
                elif before > 0.0:
                    total += min(before / scale, 1.0)
    return total / 8.0


@kernel
def _half_way(lamps, k, vx, vy, vz):
    """Return the direction half-way between a lamp and the viewer, and its length."""
    hx, hy, hz = lamps[k, 0] + vx, lamps[k, 1] + vy, lamps[k, 2] + vz
    return hx, hy, hz, math.sqrt(hx * hx + hy * hy + hz * hz)


@kernel
def phong(nx, ny, nz, px, py, pz, perspective, light, halves):
    """Return (diffuse factor, specular term); the highlight has the exponent 32, five squarings.

    `halves` has what `_half_way` gives for each lamp and a viewer straight ahead.
    """
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
        hx, hy, hz, length = halves[k, 0], halves[k, 1], halves[k, 2], halves[k, 3]
        if perspective:
            hx, hy, hz, length = _half_way(lamps, k, vx, vy, vz)
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
    halves = np.empty((len(light.lamps), 4))
    for k in range(len(halves)):
        halves[k, 0], halves[k, 1], halves[k, 2], halves[k, 3] = _half_way(
            light.lamps, k, 0.0, 0.0, -1.0
        )
    for row in range(begin, end):
        for col in range(out.shape[1]):
            red = green = blue = cover = x0 = y0 = z0 = 0.0
            first = index[row * n, col * n]
            inside = True  # one triangle or ball covers the pixel: its light is computed once
            for sub in range(1, n * n):
                inside &= index[row * n + sub // n, col * n + sub % n] == first
            if inside and first < 0 and not see_through and transparent:
                out[row, col, :3], out[row, col, 3] = curve[0], 0
                continue
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
                    part, shine = phong(nx, ny, nz, px, py, pz, perspective, light, halves)
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
