# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the silhouettes of every mesh of a folder, from all round: black on white PNG files.

    blender --background --python silhouettes.py -- MESHES PICTURES --views 8 --size 256

For MESHES/hand.ply it writes PICTURES/hand_0.png to hand_7.png, and nothing else. All pictures of a
mesh have the same scale. It needs no graphics card, and of medialis only the core. A file that
cannot be drawn is named, the others go on. Exit status: 0 all drawn, 1 some not, 2 wrong arguments.
"""

import argparse
import sys
from pathlib import Path

import bpy
import numpy as np

import medialis

READERS = {
    ".ply": bpy.ops.wm.ply_import,
    ".obj": bpy.ops.wm.obj_import,
    ".stl": bpy.ops.wm.stl_import,
}


def main() -> int:
    """Draw all files and return the exit status."""
    parser = argparse.ArgumentParser("silhouettes.py", description=__doc__.partition("\n")[0])
    parser.add_argument("meshes", type=Path, help="folder with PLY, OBJ or STL files")
    parser.add_argument("pictures", type=Path, help="folder for the PNG files")
    parser.add_argument("--views", type=int, default=8, help="directions, at even angles")
    parser.add_argument("--size", type=int, default=256, help="pixels of an edge")
    after = sys.argv.index("--") + 1 if "--" in sys.argv else 1
    options = parser.parse_args(sys.argv[after:])
    files = sorted(f for f in options.meshes.glob("*") if f.suffix.lower() in READERS)
    if not files or options.views < 1:
        parser.error(f"needs a PLY, OBJ or STL file in {options.meshes}, and 1 view or more")
    failed = 0
    for file in files:
        try:
            shape = read(file)
            views = medialis.rasterizer(shape)(cameras(shape, options.views, options.size))
            for number, view in enumerate(views):
                save(view.mask, options.pictures / f"{file.stem}_{number}.png")
        except (medialis.MedialisError, RuntimeError, OSError) as error:
            print(f"{file.name}: {' '.join(str(error).split())}", file=sys.stderr)
            failed += 1
        else:
            print(f"{file.name}: {len(views)} pictures")
    return 1 if failed else 0


def read(file: Path) -> medialis.Shape:
    """Read a mesh by Blender, as the triangles that are seen; all objects of a file are one."""
    bpy.ops.wm.read_homefile(use_empty=True)
    READERS[file.suffix.lower()](filepath=str(file))
    points, faces = [np.empty((0, 3))], [np.empty((0, 3), int)]
    for made in bpy.context.scene.objects:
        turn, mesh = np.array(made.matrix_world), made.data
        mesh.calc_loop_triangles()
        corners = np.array([triangle.vertices for triangle in mesh.loop_triangles], int)
        faces.append(corners.reshape(-1, 3) + sum(map(len, points)))
        places = np.array([vertex.co for vertex in mesh.vertices], float).reshape(-1, 3)
        points.append(places @ turn[:3, :3].T + turn[:3, 3])
    return medialis.make_shape(np.concatenate(points), np.concatenate(faces), repair=True)


def cameras(shape: medialis.Shape, count: int, size: int) -> list[medialis.OrthographicCamera]:
    """Return cameras round the upright axis, the first in front; each sees the shape whole."""
    middle = (shape.points.min(axis=0) + shape.points.max(axis=0)) / 2
    extent = 2.1 * np.linalg.norm(shape.points - middle, axis=1).max()
    turns = [(np.cos(a), np.sin(a)) for a in 2 * np.pi * np.arange(count) / count]
    axes = [[(c, s, 0), (0, 0, 1), (-s, c, 0)] for c, s in turns]  # right, up, forward
    return [medialis.OrthographicCamera(middle, three, extent, size) for three in axes]


def save(mask: np.ndarray, path: Path) -> None:
    """Write a silhouette as a picture."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = bpy.data.images.new(path.stem, *mask.shape[::-1])
    pixels = np.ones((*mask.shape, 4), np.float32)
    pixels[mask[::-1], :3] = 0.0  # Blender begins with the lowest row
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = str(path.resolve()), "PNG"
    image.save()


if __name__ == "__main__":
    sys.exit(main())
