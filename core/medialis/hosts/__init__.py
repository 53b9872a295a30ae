"""What adapters for host programs need; they import this module and `medialis`, nothing else.

An adapter reads the user's data into a shape (`medialis.make_shape` with ``repair=True`` and
`progress`), runs an operation (`medialis.run`), and shows the layers of the result:

Operations and their options
    `Operation`, `Parameter`, `Kind` describe what there is (`medialis.OPERATIONS`); lengths are
    fractions of the diagonal and angles degrees. `as_typed` reads widgets of single precision.
Layers
    A `Result` is an `Outcome` with the record of its run. `Layer`, `FilterUnit` (the unit of its
    slider), `hidden_apart` for hosts without sliders, `polylines` of its edges.
Colours
    `shown` tells the attribute that a layer shows first, with colours and limits (`Shown`);
    `color_table`, `palette`, `label_colors`, `value_range`, `MISSING` and `to_linear` are for
    materials of hosts.
Fields on the input
    `on_input` brings attributes of points and faces to the vertices, triangles or polygons that
    the host gave (`InputFields`); `rig_of` finds bones, their layer and the weights on those
    vertices (`Rig`).
Names
    `title`, `label_name`, `identifier`, `free_name`, `distinct_names`, `value_lines`.
Files
    `write_ply` for one layer, `write_for_host` for a result that another program adds.
Kernels
    `kernels_are_compiled`, `kernel_folder` (``MEDIALIS_CACHE_DIR`` moves it) and `WARMUP`, the
    arguments of a Python that compiles them.
"""

from medialis._kernels.cache_folder import kernels_are_compiled
from medialis._kernels.cache_folder import user_cache as kernel_folder
from medialis.files.ply_attributes import write_ply
from medialis.hosts.fields import InputFields, Rig, on_input, rig_of
from medialis.hosts.handover import write_for_host
from medialis.hosts.shown import Shown, hidden_apart, shown
from medialis.hosts.words import (
    as_typed,
    distinct_names,
    free_name,
    identifier,
    label_name,
    title,
)
from medialis.model.polylines import polylines
from medialis.operations.declaration import Operation
from medialis.operations.quantities import value_lines
from medialis.operations.result import FilterUnit, Layer, Outcome, Result
from medialis.options import Kind, Parameter
from medialis.render.colors import (
    MISSING,
    color_table,
    label_colors,
    palette,
    to_linear,
    value_range,
)

WARMUP = ("-m", "medialis", "warmup", "--progress", "lines")
"""Arguments of a Python that compiles all kernels; it prints lines "PROGRESS fraction text"."""

__all__ = [
    "MISSING",
    "WARMUP",
    "FilterUnit",
    "InputFields",
    "Kind",
    "Layer",
    "Operation",
    "Outcome",
    "Parameter",
    "Result",
    "Rig",
    "Shown",
    "as_typed",
    "color_table",
    "distinct_names",
    "free_name",
    "hidden_apart",
    "identifier",
    "kernel_folder",
    "kernels_are_compiled",
    "label_colors",
    "label_name",
    "on_input",
    "palette",
    "polylines",
    "rig_of",
    "shown",
    "title",
    "to_linear",
    "value_lines",
    "value_range",
    "write_for_host",
    "write_ply",
]
