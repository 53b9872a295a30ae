# SPDX-License-Identifier: GPL-3.0-or-later
"""A pymeshlab MeshSet with the operations of medialis as filters; pymeshlab stays as it is.

    from medialis_meshset import MeshSet

    ms = MeshSet()
    ms.load_new_mesh("bunny.ply")
    ms.generate_surface_skeleton()

``import medialis_meshlab`` adds the same filters to pymeshlab's own class instead.
"""

try:
    import pymeshlab as _pymeshlab  # noqa: F401 - asked for here, so that its absence is explained
except ModuleNotFoundError as error:
    if error.name != "pymeshlab":
        raise
    raise ModuleNotFoundError(
        "medialis needs pymeshlab for its MeshLab filters, and it is not installed: "
        "pip install 'medialis[meshlab]'",
        name="pymeshlab",
    ) from None

from medialis_meshset.listing import (
    filter_list,
    filter_parameter_values,
    print_filter_list,
    print_filter_parameter_list,
)
from medialis_meshset.mesh_set import MeshSet

__all__ = [
    "MeshSet",
    "filter_list",
    "filter_parameter_values",
    "print_filter_list",
    "print_filter_parameter_list",
]
