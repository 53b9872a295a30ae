"""The midsurface of a solid of walls: sheets for shell elements, welded where they meet."""

from __future__ import annotations

import math
from dataclasses import dataclass

from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, algorithm, angle, length
from medialis.base.progress import Progress
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import Preparation, as_cloud
from medialis.walls.midsurface.sheets import Midsurface


@dataclass(frozen=True, kw_only=True)
class MidsurfaceOptions(Options):
    """Options of `midsurface`."""

    edge: float = length(
        0.02,
        "Edge length",
        "Length of the edges of the triangles, as a share of the size.",
        low=1e-4,
        high=0.5,
    )
    angle: float = angle(
        150.0,
        "Least angle",
        "Walls lie between balls that touch both of their sides at a wider angle than this, seen "
        "from the center of the ball: two flat walls may be inclined by 180 degrees less this.",
        low=90.0,
        high=179.0,
        advanced=True,
    )


@algorithm(MidsurfaceOptions, door=as_cloud)
def midsurface(cloud: MedialCloud, options: MidsurfaceOptions, progress: Progress) -> Midsurface:
    """Compute the midsurface of a solid of walls, as an even triangle mesh.

    Parameters
    ----------
    cloud : MedialCloud
        Inner balls of a closed mesh.

    Returns
    -------
    Midsurface

    Raises
    ------
    InvalidShapeError
        When the balls do not lie in a mesh.

    See Also
    --------
    thickness : how thick walls are, on the surface.
    medial_mesh : the medial axis with its branches into edges.

    Notes
    -----
    Where the ball of a sample touches the opposite wall, its center is a point of the midsurface.
    The faces on one side of a wall are moved to these centers, and go on over ribs and up to the
    edges of the side with a linear thickness, so rims are where they should be. Sheets are extended
    straight on where they end within the solid, cut along each other, and what lies between no
    opposite walls is taken away. Curves get even vertices that all sheets share, and the rest of
    each sheet even triangles (Botsch and Kobbelt 2004). Not in the thesis.

    Examples
    --------
    >>> import medialis
    >>> x = [[x, y, z] for x in (0, 40) for y in (0, 30) for z in (0, 2)]
    >>> q = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> faces = [t for a, b, c, d in q for t in ((a, b, c), (a, c, d))]
    >>> middle = medialis.midsurface(medialis.make_shape(x, faces))
    >>> middle.sheets, round(float(middle.areas.sum()), 6), round(float(middle.thickness.max()), 6)
    (1, 1200.0, 2.0)
    """
    shape = cloud.surface
    if shape.faces is None:
        raise InvalidShapeError("A midsurface is computed from a mesh, got a point cloud.")
    from medialis.walls.midsurface.assembly import middle_of_walls

    crease = next(p.default for p in Preparation.parameters() if p.name == "creases")
    edge = options.edge * shape.diagonal
    return middle_of_walls(cloud.inner.own, math.radians(options.angle), crease, edge, progress)
