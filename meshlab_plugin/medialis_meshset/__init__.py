# SPDX-License-Identifier: GPL-3.0-or-later
"""A pymeshlab MeshSet with the operations of medialis as filters; pymeshlab stays as it is.

    from medialis_meshset import MeshSet

    ms = MeshSet()
    ms.load_new_mesh("bunny.ply")
    ms.generate_surface_skeleton()

``import medialis_meshlab`` adds the same filters to pymeshlab's own class instead.
"""

from medialis_meshset.needs import require_pymeshlab

require_pymeshlab()

from medialis_meshset.listing import (  # noqa: E402
    filter_list,
    filter_parameter_values,
    print_filter_list,
    print_filter_parameter_list,
    search,
)
from medialis_meshset.mesh_set import MeshSet  # noqa: E402

__all__ = [
    "MeshSet",
    "filter_list",
    "filter_parameter_values",
    "print_filter_list",
    "print_filter_parameter_list",
    "search",
]
