"""Kernels of thesis 3.7.5: points dropped that a view sees outside, and moved to where views agree.

A batch of v views is `cameras` (v, 13), each center, axes and pixel as `project` reads them;
`near`, `far` and `field` are (v, h, w). Every point is treated on its own, view by
view in their order, so the threads cannot change the result.
"""

from medialis._kernels.jit import kernel


@kernel
def project(point, camera, size):
    """Return sub-pixel column, row, and depth of a point; camera = center, axes, pixel (13,)."""
    x, y, z = point[0] - camera[0], point[1] - camera[1], point[2] - camera[2]
    right = x * camera[3] + y * camera[4] + z * camera[5]
    up = x * camera[6] + y * camera[7] + z * camera[8]
    depth = x * camera[9] + y * camera[10] + z * camera[11]
    return 0.5 * size + right / camera[12], 0.5 * size - up / camera[12], depth


@kernel
def seen_inside(column, row, depth, near, far):
    """Return the pixel of a position, and whether it lies in the silhouette and depth range."""
    size = len(near)
    if not (1.0 <= column < size - 1.0 and 1.0 <= row < size - 1.0):
        return 0, 0, False
    r, c = int(row), int(column)
    return r, c, near[r, c] <= depth <= far[r, c]  # false for NaN, outside the silhouette


@kernel
def cull_and_sharpen(cameras, near, far, field, steps, begin, end, points, alive):
    """Test and move the points begin..end, in place, by every view of the batch.

    A point moves parallel to the picture by steps[v] pixels times the gradient of the distance
    transform, unless it lies beside the skeleton of the silhouette already. A view in which it lies
    far from the middle of the depth range sees it before or behind something else: it may drop the
    point, not move it.
    """
    size = near.shape[1]
    for v in range(len(cameras)):  # all points of a range by one view: its pixels stay in the cache
        camera = cameras[v]
        for i in range(begin, end):
            if not alive[i]:
                continue
            point = points[i]
            column, row, depth = project(point, camera, size)
            r, c, inside = seen_inside(column, row, depth, near[v], far[v])
            if not inside:
                alive[i] = False
                continue
            if field[v, r, c] < 0:
                continue
            low, high = near[v, r, c], far[v, r, c]
            if abs(depth - 0.5 * (low + high)) > 0.25 * (high - low):
                continue
            gx = 0.5 * (abs(field[v, r, c + 1]) - abs(field[v, r, c - 1])) * steps[v] * camera[12]
            gy = 0.5 * (abs(field[v, r - 1, c]) - abs(field[v, r + 1, c])) * steps[v] * camera[12]
            for j in range(3):
                point[j] += gx * camera[3 + j] + gy * camera[6 + j]


@kernel
def distance_at(field, column, row):
    """Return the distance transform at a sub-pixel position, to the nearest pixel centers outside.

    Bilinear between pixel centers. The field counts to the border of those pixels, half a pixel
    less; but of many pixels along a contour some have their center right behind it.
    """
    x, y = column - 0.5, row - 0.5
    c, r = int(x), int(y)
    s, t = x - c, y - r
    above = (1 - s) * abs(field[r, c]) + s * abs(field[r, c + 1])
    below = (1 - s) * abs(field[r + 1, c]) + s * abs(field[r + 1, c + 1])
    return (1 - t) * above + t * below + 0.5


@kernel
def measure_radii(cameras, near, far, field, begin, end, points, out_radii):
    """Lower out_radii to the distance to the surface that any view shows; 0 where one is outside.

    A ball round a point inside the shape is seen as a disc inside the silhouette and as a depth
    within the range, so the distance to the contour and the ways to both depths are no smaller than
    its radius; over many views the smallest is near it.
    """
    size = near.shape[1]
    for v in range(len(cameras)):
        for i in range(begin, end):
            column, row, depth = project(points[i], cameras[v], size)
            r, c, inside = seen_inside(column, row, depth, near[v], far[v])
            if not inside:
                out_radii[i] = 0.0
                continue
            ways = min(depth - near[v, r, c], far[v, r, c] - depth)
            away = distance_at(field[v], column, row) * cameras[v, 12]
            out_radii[i] = min(out_radii[i], ways, away)
