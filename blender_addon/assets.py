# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups of results as assets, so that sliders and looks can be put on other objects.

Blender keeps the names of catalogues in a file beside the .blend file. Nothing is marked or written
unless the operator is run.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import ClassVar

import bpy

from . import own
from .materials import MEANING

CATALOG = "e6a0d1c8-5f0b-4a6b-9d0e-2b7c3f1a8d54"
"""Of all files and versions: assets find their catalogue by it."""
FILE = "blender_assets.cats.txt"
LINE = f"{CATALOG}:Medialis:Medialis"
HEAD = """# This is an Asset Catalog Definition file for Blender.
#
# Empty lines and lines starting with `#` will be ignored.
# The first non-ignored line should be the version indicator.
# Other lines are of the format "UUID:catalog/path/for/assets:simple catalog name"

VERSION 1

"""
AUTHOR = "The medialis developers"


def node_groups() -> list[bpy.types.NodeTree]:
    """Return the node groups that results of the file are shown with."""
    every = bpy.data.node_groups
    return [one for one in every if one.get(MEANING) and not one.library and own.is_own(one, every)]


def mark(group: bpy.types.NodeTree) -> None:
    """Make a node group an asset of the catalogue."""
    group.asset_mark()
    about, look = group.asset_data, group[MEANING].startswith("look ")
    about.catalog_id = CATALOG
    about.author = AUTHOR
    about.description = (
        "Shows a mesh in the colours of a result of medialis, or see-through"
        if look
        else "Shows points, curves or balls of a result of medialis, with its sliders"
    )
    for tag in ("medialis", "look" if look else "slider"):
        about.tags.new(tag, skip_if_exists=True)


def catalogue_folder(blend: Path) -> Path:
    """Return where the catalogues of a .blend file are: its asset library, else beside it."""
    for library in bpy.context.preferences.filepaths.asset_libraries:
        root = Path(bpy.path.abspath(library.path)) if library.path else None
        if root is not None and root.resolve() in blend.resolve().parents:
            return root
    return blend.parent


def write_catalogue(folder: Path) -> bool:
    """Add the catalogue to the file of a folder, which is made when missing; tell whether it was.

    Other lines stay as they are, and the file is never seen half-written.

    Raises
    ------
    OSError
        When it cannot be read or written.
    """
    path = Path(os.path.realpath(folder / FILE))
    before = (path.read_bytes() if path.exists() else b"") or HEAD.encode()
    if any(line.startswith(CATALOG.encode()) for line in before.lower().splitlines()):
        return False
    end = b"\r\n" if b"\r\n" in before else b"\n"
    gap = b"" if before.endswith(b"\n") else end
    handle, name = tempfile.mkstemp(prefix=FILE, dir=path.parent)
    passing = Path(name)
    try:
        with os.fdopen(handle, "wb") as out:
            out.write(before + gap + LINE.encode() + end)
        passing.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o644)
        passing.replace(path)
    except BaseException:
        passing.unlink()
        raise
    return True


class MEDIALIS_OT_add_to_catalogue(bpy.types.Operator):
    """Mark node groups of results as assets."""

    bl_idname = "medialis.add_to_catalogue"
    bl_label = "Add to Asset Catalogue"
    bl_description = (
        "Make the sliders and looks of the results in this file assets, which other objects can "
        "have. Their catalogue is added to the file of catalogues beside this file"
    )
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it for saved files with results."""
        if not bpy.data.filepath:
            cls.poll_message_set("Save the file first: catalogues lie beside it")
        elif not node_groups():
            cls.poll_message_set("No result in this file has sliders or a look")
        else:
            return True
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the catalogue, then mark."""
        folder = catalogue_folder(Path(bpy.data.filepath))
        try:
            new = write_catalogue(folder)
        except OSError as error:
            self.report({"ERROR"}, f"{folder / FILE} cannot be written: {error.strerror}.")
            return {"CANCELLED"}
        groups = node_groups()
        for group in groups:
            mark(group)
        text = f"{len(groups)} node groups are assets of the catalogue Medialis"
        self.report({"INFO"}, f"{text}, which was added to {folder / FILE}." if new else f"{text}.")
        return {"FINISHED"}


def register() -> None:
    """Add the operator."""
    bpy.utils.register_class(MEDIALIS_OT_add_to_catalogue)


def unregister() -> None:
    """Remove the operator; assets stay."""
    bpy.utils.unregister_class(MEDIALIS_OT_add_to_catalogue)
