"""Files that are no mesh, known by how they begin: packed ones, pictures, volumes."""

from __future__ import annotations

import re

UNPACK = "unpack it first"
EXPORT = "export PLY, OBJ or STL from a program that opens it"

LABELS = "medialis.label_surfaces makes shapes of its labels"

_MARKS = (
    (rb"\x1f\x8b", "is packed with gzip", UNPACK),
    (rb"PK\x03\x04", "is a zip archive", UNPACK),
    (rb"BZh\d", "is packed with bzip2", UNPACK),
    (rb"\xfd7zXZ\0", "is packed with xz", UNPACK),
    (rb"7z\xbc\xaf\x27\x1c", "is a 7z archive", UNPACK),
    (rb"\x28\xb5\x2f\xfd", "is packed with zstd", UNPACK),
    (rb"\xff\xfe|\xfe\xff", "is text in UTF-16", "save it as UTF-8"),
    (rb"version https://git-lfs", "is only a pointer of Git LFS", "get the file with git lfs pull"),
    (rb"(?i)\s*<(!doctype html|html)", "is a web page", "download the mesh itself"),
    (rb"\x89PNG|\xff\xd8\xff|GIF8|%PDF", "is a picture or document", "name the mesh file"),
    (rb"BLENDER", "is a Blender file", "export PLY, OBJ or STL, or use the Blender extension"),
    (rb"Kaydara FBX|; FBX", "is an FBX file", EXPORT),
    (rb"(?s).{344}(n[+i]1)\0|NRRD\d|ObjectType *= *Image", "is a volume of voxels", LABELS),
)


def foreign(data: bytes) -> str | None:
    r"""Return what a file is instead of a mesh and what to do, or None.

    Examples
    --------
    >>> foreign(b"PK\x03\x04..."), foreign(b"ply\n")
    ('it is a zip archive: unpack it first.', None)
    """
    for mark, what, advice in _MARKS:
        if re.match(mark, data[:400]):
            return f"it {what}: {advice}."
    return None
