"""Kernel of the views (thesis 3.7): nearest and furthest depth of triangles in one pass.

Pixels are hit by their centers, with the shared-edge rule of `edge`: neighbouring triangles leave
no gap. Positions are columns and rows of the picture; one view is drawn by one call.
"""

import math

from medialis._kernels.jit import kernel
from medialis.render._splat_kernels import covers, edge, orient, pixel_range


@kernel
def project_points(points, center, axes, size, pixel, out_screen):
    """Write column, row and depth of every point."""
    half, scale = 0.5 * size, 1.0 / pixel
    for i in range(len(points)):
        x, y, z = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        out_screen[i, 0] = half + (x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]) * scale
        out_screen[i, 1] = half - (x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]) * scale
        out_screen[i, 2] = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]


@kernel
def _row_span(e, slope, closed, col0, col1):
    # Columns of col0..col1 where e - slope (col - col0) is inside: a first and a last one. The
    # division only proposes; the caller's exact test at both ends decides.
    if slope == 0.0:
        if e < 0 or (e == 0 and not closed):
            return col1 + 1, col1
        return col0, col1
    at = e / slope
    if slope > 0:
        return col0, col0 + math.floor(min(at + 1.0, float(col1 - col0)))
    return col0 + math.ceil(min(max(at - 1.0, 0.0), col1 - col0 + 1.0)), col1


@kernel
def draw_depth_range(faces, screen, out_near, out_far):
    """Draw all triangles; near starts at +inf and far at -inf."""
    size = len(out_near)
    for i in range(len(faces)):
        a, b, c, area = orient(faces[i], screen)
        xa, ya, xb, yb = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        xc, yc = screen[c, 0], screen[c, 1]
        row0, row1 = pixel_range(min(ya, yb, yc), max(ya, yb, yc), 0, size)
        col0, col1 = pixel_range(min(xa, xb, xc), max(xa, xb, xc), 0, size)
        if not area > 0 or row0 > row1 or col0 > col1:
            continue
        ox0, oy0, dx0, dy0, closed0 = edge(xb, yb, xc, yc)
        ox1, oy1, dx1, dy1, closed1 = edge(xc, yc, xa, ya)
        ox2, oy2, dx2, dy2, closed2 = edge(xa, ya, xb, yb)
        za, zb, zc = screen[a, 2], screen[b, 2], screen[c, 2]
        low, high = min(za, zb, zc), max(za, zb, zc)
        unit = 1.0 / area
        x = col0 + 0.5
        for row in range(row0, row1 + 1):
            y = row + 0.5
            s0, s1, s2 = dx0 * (y - oy0), dx1 * (y - oy1), dx2 * (y - oy2)
            first, last = col0, col1
            if col1 - col0 > 3:  # wide: skip what the edges exclude
                f0, l0 = _row_span(s0 - dy0 * (x - ox0), dy0, closed0, col0, col1)
                f1, l1 = _row_span(s1 - dy1 * (x - ox1), dy1, closed1, col0, col1)
                f2, l2 = _row_span(s2 - dy2 * (x - ox2), dy2, closed2, col0, col1)
                first, last = max(f0, f1, f2), min(l0, l1, l2)
            for col in range(first, last + 1):
                e0 = s0 - dy0 * (col + 0.5 - ox0)
                e1 = s1 - dy1 * (col + 0.5 - ox1)
                e2 = s2 - dy2 * (col + 0.5 - ox2)
                if not covers(e0, e1, e2, closed0, closed1, closed2):
                    continue
                z = min(max((e0 * za + e1 * zb + e2 * zc) * unit, low), high)
                if z < out_near[row, col]:
                    out_near[row, col] = z
                if z > out_far[row, col]:
                    out_far[row, col] = z


@kernel
def mark_outside(near, far):
    """Write NaN where nothing was drawn."""
    size = len(near)
    for row in range(size):
        for col in range(size):
            if near[row, col] == math.inf:
                near[row, col] = math.nan
                far[row, col] = math.nan
