"""Which packages are compared, and with which settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

PACKAGES = (
    *("skeletor", "kimimaro", "scikit-image", "PyGEL3D", "localthickness", "pymeshlab"),
    *("trimesh", "rtree", "matplotlib"),
)
"""What pip installs into the environment of the peers; the last two are needed by others."""

Settings = dict[str, Any]


@dataclass(frozen=True)
class Method:
    """A function of a package.

    Attributes
    ----------
    name : str
        Of the function in `worker.py`.
    label : str
        In the table.
    package : str
        Its distribution; "medialis" and "CGAL" run elsewhere.
    makes : str
        "skeleton" or "thickness".
    default : dict
        Empty: everything is left as the package has it. What has no default is given.
    others : tuple of dict
        Settings among which the best one is looked for, besides the default.
    """

    name: str
    label: str
    package: str
    makes: str = "skeleton"
    default: Settings = field(default_factory=dict)
    others: tuple[Settings, ...] = ()


# Lengths (inv_dist, sampling_dist, const) are in thicknesses of the shape, as a user would tell.
METHODS = (
    Method("medialis_curve", "medialis curve_skeleton", "medialis"),
    Method(
        "wavefront", "skeletor by_wavefront", "skeletor",
        others=({"waves": 5}, {"waves": 10, "step_size": 2}, {"waves": 5, "fix": True}),
    ),
    Method(
        "teasar", "skeletor by_teasar", "skeletor", default={"inv_dist": 1.0},
        others=({"inv_dist": 2.0}, {"inv_dist": 1.0, "contract": True}),
    ),
    Method("edge_collapse", "skeletor contract, by_edge_collapse", "skeletor"),
    Method(
        "mean_curvature", "skeletor by_mean_curvature", "skeletor",
        others=({"epsilon": 0.01}, {"collapse_factor": 0.25}),
    ),
    Method(
        "clusters", "skeletor contract, by_vertex_clusters", "skeletor",
        default={"sampling_dist": 0.5},
        others=({"sampling_dist": 1.0}, {"sampling_dist": 0.5, "fix": True}),
    ),
    Method("tangent_ball", "skeletor by_tangent_ball", "skeletor", others=({"fix": True},)),
    Method(
        "kimimaro", "kimimaro, voxels", "kimimaro",
        others=(
            {"scale": 1.5, "const": 0.5}, {"scale": 3.0, "const": 0.5},
            {"scale": 3.0, "const": 1.0}, {"scale": 3.0, "const": 0.5, "fine": True},
        ),
    ),
    Method("skeletonize", "scikit-image skeletonize, voxels", "scikit-image",
           others=({"fine": True},)),
    Method("local_separators", "PyGEL3D MSLS_skeleton", "PyGEL3D"),
    Method("cgal", "CGAL mean curvature flow", "CGAL", others=({"quality": 0.5},)),
    Method("medialis_thickness", "medialis thickness", "medialis", "thickness"),
    Method("spheres", "trimesh thickness", "trimesh", "thickness", others=({"method": "ray"},)),
    Method(
        "diameters", "pymeshlab shape diameter", "pymeshlab", "thickness",
        others=({"rays": 128, "cone_amplitude": 45.0}, {"rays": 64, "cone_amplitude": 20.0}),
    ),
    Method("voxel_thickness", "localthickness, voxels", "localthickness", "thickness",
           others=({"fine": True},)),
)  # fmt: skip
