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
    """The faces that pieces of triangles belong to, as they look.

    Attributes
    ----------
    planes : (m, 3, 6) float32
        Normal (3) and color in linear light (3) at a pixel are q planes[face], where q is
        (x, y, 1) in view space (orthographic), or the place that is seen (perspective).
    density : (m,) float32
        Optical density of a see-through face, seen along its normal.
    """

    planes: NDArray[np.float32]
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
    top : int
        Row of the picture that the first row is: a canvas may be a strip of it.
    """

    depth: NDArray[np.float64]
    index: NDArray[np.int32]
    glass: NDArray[np.float32]
    top: int


SPAN = 16
"""Columns of a line whose largest depth is known: a ball that is behind it passes them at once."""


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
    far = np.empty((end - begin, (out.depth.shape[1] + SPAN - 1) // SPAN))
    for row in range(begin, end):
        for span in range(far.shape[1]):
            far[row - begin, span] = _farthest(out.depth, row - out.top, span)
    for i in items:
        row0, row1 = max(balls.boxes[i, 0], begin), min(balls.boxes[i, 1], end - 1)
        if lens.focal > 0:
            _perspective_ball(i, balls, lens, row0, row1, out)
        else:
            _orthographic_ball(i, balls, lens, row0, row1, out, far[row0 - begin :])


@kernel
def _farthest(depth, line, span):
    """Return the largest depth of a span of a line."""
    result = -np.inf
    for col in range(span * SPAN, min(span * SPAN + SPAN, depth.shape[1])):
        result = max(result, depth[line, col])
    return result


@kernel
def _orthographic_ball(i, balls, lens, row0, row1, out, far):
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
        line, farthest = row - out.top, far[row - row0]
        for span in range(col0 // SPAN, col1 // SPAN + 1):
            first, last = max(col0, span * SPAN), min(col1, span * SPAN + SPAN - 1)
            # Of its pixels none has a larger root, and none a smaller gap.
            dx = max((first + 0.5 - x) * unit, (x - (last + 0.5)) * unit, 0.0)
            gap = key - farthest[span]
            if gap >= 0 and chord - dx * dx <= gap * gap:
                continue
            nearer = False
            for col in range(first, last + 1):
                dx = (col + 0.5 - x) * unit
                q = chord - dx * dx
                if q < 0:
                    if row != center_row or col != center_col:
                        continue
                    q = 0.0
                gap = key - out_depth[line, col]
                if gap < 0 or q > gap * gap:
                    depth = key - math.sqrt(q)
                    if depth < out_depth[line, col]:
                        out_depth[line, col] = depth
                        out_index[line, col] = i
                        nearer = True
            if nearer:
                farthest[span] = _farthest(out_depth, line, span)


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
        rest, line = a * a, row - out.top
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
                gap = sign * along - out_depth[line, col] * dd
                if gap >= 0 and q <= gap * gap:
                    continue
            root = math.sqrt(q)
            t = (along - sign * root) / dd
            if t < near:  # the eye is inside the ball: its far side
                t = (along + root) / dd
                if t < near:
                    continue
            if sign * t < out_depth[line, col]:
                out_depth[line, col] = sign * t
                out_index[line, col] = i


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
            entered, line = False, row - out.top
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
                if depth < out_depth[line, col]:
                    if glass:
                        add_layer(row, col, depth, names[i], lens, mesh, out)
                    else:
                        out_depth[line, col] = depth
                        out_index[line, col] = names[i]


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
def facing(nx, ny, nz, px, py, pz, perspective):
    """Return the unit normal turned to the viewer, and the cosine of its angle to the viewer."""
    vx, vy, vz = 0.0, 0.0, -1.0
    if perspective:
        far = 1.0 / math.sqrt(px * px + py * py + pz * pz)
        vx, vy, vz = -px * far, -py * far, -pz * far
    square = nx * nx + ny * ny + nz * nz
    if not square > 0:
        return vx, vy, vz, 1.0
    share = 1.0 / math.sqrt(square)
    cosine = (nx * vx + ny * vy + nz * vz) * share
    if cosine < 0:
        share, cosine = -share, -cosine
    return nx * share, ny * share, nz * share, cosine


THIN = 0.02
"""Pixels: a face that is lower looks the same everywhere, as float32 cannot tell its corners."""


@kernel
def _cross(x0, y0, z0, x1, y1, z1):
    return y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1


@kernel
def _span(x0, y0, z0, x1, y1, z1):
    return (x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2


@kernel
def fill_planes(begin, end, points, faces, normals, colors, lens, out):
    """Fill `Mesh.planes` of faces from normals and colors (m, 3, 3) at their corners.

    Corner weights are linear in q: rows of the inverse of the matrix that has the corners' own q as
    columns. That holds for corners behind the eye, too.
    """
    perspective = lens.focal > 0
    pixels = lens.focal if perspective else lens.scale
    for f in range(begin, end):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = points[i, 0], points[i, 1], 1.0
        bx, by, bz = points[j, 0], points[j, 1], 1.0
        cx, cy, cz = points[k, 0], points[k, 1], 1.0
        mx, my, mz, far = 0.0, 0.0, 1.0, 1.0
        if perspective:
            az, bz, cz = points[i, 2], points[j, 2], points[k, 2]
            mx, my, mz = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
            far = max(
                _span(0.0, 0.0, 0.0, ax, ay, az),
                _span(0.0, 0.0, 0.0, bx, by, bz),
                _span(0.0, 0.0, 0.0, cx, cy, cz),
            )
        side = max(
            _span(ax, ay, az, bx, by, bz),
            _span(bx, by, bz, cx, cy, cz),
            _span(cx, cy, cz, ax, ay, az),
        )
        x0, y0, z0 = _cross(bx, by, bz, cx, cy, cz)
        x1, y1, z1 = _cross(cx, cy, cz, ax, ay, az)
        x2, y2, z2 = _cross(ax, ay, az, bx, by, bz)
        det = ax * x0 + ay * y0 + az * z0
        share = 1.0 / det if det != 0.0 else 0.0
        if not abs(det) * pixels > THIN * math.sqrt(side) * far:
            square = mx * mx + my * my + mz * mz
            share = 1.0 / (3.0 * square) if square > 0.0 else 0.0
            x0, y0, z0 = mx, my, mz
            x1, y1, z1 = mx, my, mz
            x2, y2, z2 = mx, my, mz
        for k in range(6):
            one, two, three = 0.0, 0.0, 0.0
            if k < 3:
                one, two, three = normals[f, 0, k], normals[f, 1, k], normals[f, 2, k]
            else:
                one, two, three = colors[f, 0, k - 3], colors[f, 1, k - 3], colors[f, 2, k - 3]
            out[f, 0, k] = (one * x0 + two * x1 + three * x2) * share
            out[f, 1, k] = (one * y0 + two * y1 + three * y2) * share
            out[f, 2, k] = (one * z0 + two * z1 + three * z2) * share


@kernel
def triangle_hit(face, px, py, pz, perspective, mesh):
    """Return facing normal, cosine and base color where a face is seen at the point p."""
    g = mesh.planes
    x, y = np.float32(px), np.float32(py)
    z = np.float32(pz) if perspective else np.float32(1.0)
    nx, ny, nz, cosine = facing(
        float(g[face, 0, 0] * x + g[face, 1, 0] * y + g[face, 2, 0] * z),
        float(g[face, 0, 1] * x + g[face, 1, 1] * y + g[face, 2, 1] * z),
        float(g[face, 0, 2] * x + g[face, 1, 2] * y + g[face, 2, 2] * z),
        px,
        py,
        pz,
        perspective,
    )
    red = float(g[face, 0, 3] * x + g[face, 1, 3] * y + g[face, 2, 3] * z)
    green = float(g[face, 0, 4] * x + g[face, 1, 4] * y + g[face, 2, 4] * z)
    blue = float(g[face, 0, 5] * x + g[face, 1, 5] * y + g[face, 2, 5] * z)
    return nx, ny, nz, cosine, max(red, 0.0), max(green, 0.0), max(blue, 0.0)


@kernel
def add_layer(row, col, depth, face, lens, mesh, out):
    """Add one see-through layer: light passes as exp(-density), more density at silhouettes.

    Densities add up, so the order of the layers does not matter. Lighting is a gentle headlight.
    """
    px, py, pz = hit_point(row, col, depth, lens)
    _, ny, _, cosine, red, green, blue = triangle_hit(face, px, py, pz, lens.focal > 0, mesh)
    rim = 1.0 - cosine
    density = mesh.density[face] * (1.0 + 9.0 * rim * rim * rim)
    light = density * (0.45 + 0.45 * cosine + 0.1 * ny)
    glass, line = out.glass, row - out.top
    glass[line, col, 0] += light * red
    glass[line, col, 1] += light * green
    glass[line, col, 2] += light * blue
    glass[line, col, 3] += density


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
    here, share, total = depth[row, col], 1.0 / scale, 0.0
    for down in range(-1, 2):
        for right in range(-1, 2):
            r, c = row + down * reach, col + right * reach
            if 0 <= r < height and 0 <= c < width:
                # As likely as not: a branch would be guessed wrongly at every other one.
                total += min(max(here - depth[r, c], 0.0) * share, 1.0)
    return total / 8.0


@kernel
def _half_way(lamps, k, vx, vy, vz):
    """Return the direction half-way between a lamp and the viewer; 0 where they are opposite."""
    hx, hy, hz = lamps[k, 0] + vx, lamps[k, 1] + vy, lamps[k, 2] + vz
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    share = 1.0 / length if length > 0 else 0.0
    return hx * share, hy * share, hz * share


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
        hx, hy, hz = halves[k, 0], halves[k, 1], halves[k, 2]
        if perspective:
            hx, hy, hz = _half_way(lamps, k, vx, vy, vz)
        s = max(nx * hx + ny * hy + nz * hz, 0.0)
        s *= s
        s *= s
        s *= s
        s *= s
        specular += light.specular * lamps[k, 3] * s * s
    return diffuse, specular


@kernel
def _lit(r, c, i, n, canvas, lens, balls, mesh, light, halves):
    """Return the light that what lies at a place of the canvas sends, in linear light."""
    count, perspective = len(balls.radii), lens.focal > 0
    px, py, pz = hit_point(r + canvas.top, c, canvas.depth[r, c], lens)
    if i < count:
        nx, ny, nz, _ = ball_normal(i, px, py, pz, perspective, balls)
        x, y, z = balls.colors[i, 0], balls.colors[i, 1], balls.colors[i, 2]
    else:
        nx, ny, nz, _, x, y, z = triangle_hit(i - count, px, py, pz, perspective, mesh)
    part, shine = phong(nx, ny, nz, px, py, pz, perspective, light, halves)
    part *= 1.0 - light.shadow * obscurance(r, c, canvas.depth, 2 * n, light.shadow_depth)
    return x * part + shine, y * part + shine, z * part + shine


@kernel
def shade(canvas, lens, balls, mesh, light, begin, end, out):
    """Write the picture rows begin..end (uint8): shade n x n samples a pixel, average, encode.

    n is how much larger the canvas is, which has their rows and 2 n more above and below. With a
    fourth channel in `out` the background is left out and the channel says how much of the pixel is
    covered.
    """
    index, glass, curve = canvas.index, canvas.glass, light.curve
    n = index.shape[1] // out.shape[1]
    see_through, transparent, top = len(glass) > 0, out.shape[2] == 4, len(curve) - 1
    halves = np.empty((len(light.lamps), 3))
    for k in range(len(halves)):
        halves[k, 0], halves[k, 1], halves[k, 2] = _half_way(light.lamps, k, 0.0, 0.0, -1.0)
    for row in range(begin, end):
        for col in range(out.shape[1]):
            red = green = blue = cover = x0 = y0 = z0 = x1 = y1 = z1 = 0.0
            row0, col0 = row * n - canvas.top, col * n
            first, other = index[row0, col0], -1
            empty = first < 0 and not see_through and transparent
            for r in range(row0, row0 + n if empty else row0):
                for c in range(col0, col0 + n):
                    empty &= index[r, c] < 0
            if empty:
                for channel in range(3):
                    out[row, col, channel] = curve[0]
                out[row, col, 3] = 0
                continue
            # Of each triangle or ball in the pixel one sample is lit: most have two, and few three.
            for r in range(row0, row0 + n):
                for c in range(col0, col0 + n):
                    i = index[r, c]
                    if i >= 0 and i != other and (i != first or (r == row0 and c == col0)):
                        x1, y1, z1 = _lit(r, c, i, n, canvas, lens, balls, mesh, light, halves)
                        if i == first:
                            x0, y0, z0 = x1, y1, z1
                        else:
                            other = i
                    x = y = z = solid = 0.0
                    if i >= 0:
                        x, y, z, solid = x1, y1, z1, 1.0
                        if i == first:
                            x, y, z = x0, y0, z0
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
                    # Not min: NaN, from sizes beyond the range of products, is no place of a table.
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
