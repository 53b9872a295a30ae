# SPDX-License-Identifier: GPL-3.0-or-later
"""The operations of medialis as filters of every pymeshlab MeshSet.

    import medialis_meshlab
    import pymeshlab

    ms = pymeshlab.MeshSet()
    ms.load_new_mesh("bunny.ply")
    ms.generate_surface_skeleton(tolerance=pymeshlab.PercentageValue(0.1))

Importing this package adds the filters to `pymeshlab.MeshSet`; `unpatch` takes them away again. To
leave pymeshlab as it is from the start, import the subclass instead, from the package that holds
the code: ``from medialis_meshset import MeshSet``.
"""

from medialis_meshset import (
    MeshSet,
    filter_list,
    filter_parameter_values,
    print_filter_list,
    print_filter_parameter_list,
    search,
)
from medialis_meshset.patching import patch, unpatch

__all__ = [
    "MeshSet",
    "filter_list",
    "filter_parameter_values",
    "patch",
    "print_filter_list",
    "print_filter_parameter_list",
    "search",
    "unpatch",
]

patch()
