"""What adapters for host programs need; they import this module and `medialis`, nothing else.

Hosts only translate: what has to be computed, named or coloured is here, once for all of them. Read
`menu.py` first, then `computing.py`. What another host needs is exported and described below.

An adapter reads the user's data into a shape (`medialis.make_shape` with ``repair=True`` and
`progress`), runs an operation (`medialis.run`), and shows the layers of the result:

Operations and their options
    `Operation`, `Parameter`, `Kind` describe what there is (`medialis.OPERATIONS`); lengths are
    fractions of the diagonal and angles degrees. An option with a number in `Parameter.auto` may be
    `AUTO`: then the operation chooses, and `Result.parameters` has the number. `as_typed` reads
    widgets of single precision, `picked_lines` fills an option that lists vertices from a
    selection.
Layers
    A `Result` is an `Outcome` with the record of its run. `Layer`, `FilterUnit` (the unit of its
    slider), `hidden_apart` for hosts without sliders, `polylines` of its edges, `solid` where lines
    are too thin to see; `host_layers` is all of that at once.
Menus
    `Filter`, `filters` and `menu_entries`: operations, and the selections that they tell, as the
    entries of a menu, with what only a host can do: `HIDE_SOURCE`, `SOLID`, `USE_SELECTION`,
    `AUXILIARY`. `SELECTED` is the field of a selection.
Colours
    `shown` tells the attribute that a layer shows first, with colours and limits (`Shown`);
    `color_table`, `palette`, `label_colors`, `value_range`, `MISSING` and `to_linear` are for
    materials of hosts.
Beside the values
    `drawn_radius` of points and curves, `legend_of` what is shown (`Legend`), `numbers_of` a layer
    (`Numbers`).
Fields on the input
    `on_input` brings attributes of points and faces to the vertices, triangles or polygons that
    the host gave (`InputFields`); `rig_of` finds bones, their layer and the weights on those
    vertices (`Rig`). `test_poses` tells where an armature is bent to try it (`Bend`),
    `figure_parts` which of its bones are those of a figure (`FigureParts`).
Names
    `title`, `label_name`, `identifier`, `free_name`, `distinct_names`, `value_lines`;
    `with_labels` for messages, `nearest_unit` for the unit of a scene.
Edited layers
    `takes_back` names the option of an operation that takes a layer as its user has edited it,
    `write_edited` writes it to a file, and `write_armature_json` the bones of a user's armature;
    `unpacked_levels` are the `Levels` of a layer that was kept.
Files
    `write_ply` for one layer, `write_for_host` for a result that another program adds;
    `complete_file` for any other file, and `reason` says why one cannot be written.
Programs
    `Machine` tells where this system and its user keep Blender and MeshLab; `write_notes` writes
    the menu for a plugin that is no Python, with the Python that it runs.
Computing
    `Computer` runs operations in a process of its own, where what was computed is kept;
    `Computation` is one of them.

Read `menu.py` first: operations as hosts list them; `fields.py` and `drawing.py` show results.
"""

from medialis.base.version import public_names

__all__, __getattr__, __dir__ = public_names(__name__, __file__)
