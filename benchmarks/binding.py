"""Weights of `bind` beside Blender's automatic ones, on whole and on broken meshes.

    python benchmarks/binding.py [--whole] BLENDER_PYTHON SHAPE ...

Each shape gets its own armature (operation `armature`), and is then bound as it is and broken in
six ways (with --whole only as it is). Blender's weights come from `parent_set` with ARMATURE_AUTO
in the Python given, which has bpy. Printed for each: vertices without weights; the mean change of
edge length in per cent over six poses (all bones turned by up to 40 degrees about random axes, the
same poses for all), of `bind` with four and eight bones a vertex, of Blender's weights limited to
four, and of all of them; and the processor seconds of `bind`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import medialis

POSES, LARGEST = 6, np.radians(40.0)

SOFTNESS = 1.0
"""Softer than the default, which follows artists: edge lengths change least."""

BLENDER = """
import sys, numpy as np, bpy
for path in sys.argv[1:]:
    given = np.load(path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("mesh")
    mesh.from_pydata(given["points"].tolist(), [], given["faces"].tolist())
    body = bpy.data.objects.new("body", mesh)
    bones = bpy.data.armatures.new("bones")
    rig = bpy.data.objects.new("rig", bones)
    for one in (body, rig):
        bpy.context.scene.collection.objects.link(one)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for row, (head, tail) in enumerate(zip(given["heads"].tolist(), given["tails"].tolist())):
        bone = bones.edit_bones.new(str(row))
        bone.head, bone.tail = head, tail
    bpy.ops.object.mode_set(mode="OBJECT")
    body.select_set(True)
    rig.select_set(True)
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    weights = np.zeros((len(mesh.vertices), len(given["heads"])))
    for vertex in mesh.vertices:
        for entry in vertex.groups:
            weights[vertex.index, int(body.vertex_groups[entry.group].name)] = entry.weight
    np.save(path + ".npy", weights)
"""


def broken(points, faces, rng):
    """Yield what is done to a mesh, and the mesh."""
    size = np.linalg.norm(np.ptp(points, axis=0))
    yield "as it is", points, faces, 1.0
    tetra = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    specks = points[rng.choice(len(points), 40)] + rng.normal(0, 0.01 * size, (40, 3))
    corners = (specks[:, None] + 0.002 * size * rng.normal(size=(1, 4, 3))).reshape(-1, 3)
    more = (tetra[None] + 4 * np.arange(40)[:, None, None]).reshape(-1, 3) + len(points)
    yield "specks", np.concatenate([points, corners]), np.concatenate([faces, more]), 1.0
    hole = points[rng.choice(len(points), 5)]
    near = np.linalg.norm(points[faces].mean(axis=1)[:, None] - hole, axis=2).min(axis=1)
    yield "holes", *used(points, faces[near > 0.02 * size]), 1.0
    inner = points.mean(axis=0) + 0.98 * (points - points.mean(axis=0))
    yield (
        "inner faces",
        np.concatenate([points, inner]),
        np.concatenate([faces, faces + len(points)]),
        1.0,
    )
    side = (points[faces].mean(axis=1) @ rng.normal(size=3) // (0.1 * size)).astype(int)
    parts = [used(points, faces[side == one]) for one in np.unique(side)]
    first = np.cumsum([0, *(len(p) for p, _ in parts)])
    rows = np.concatenate([f + n for (_, f), n in zip(parts, first, strict=False)])
    yield "cut in pieces", np.concatenate([p for p, _ in parts]), rows, 1.0
    yield "a thousandth", 0.001 * points, faces, 0.001
    flat = np.concatenate([faces, np.stack([faces[:50, 0], faces[:50, 0], faces[:50, 1]], axis=1)])
    yield "zero faces", points, flat, 1.0


def used(points, faces):
    """Return the points that faces have, and the faces."""
    rows, place = np.unique(faces, return_inverse=True)
    return points[rows], place.reshape(-1, 3)


def stretch(points, faces, heads, parents, weights):
    """Return the mean change of edge length over the poses, in per cent."""
    edges = np.unique(
        np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])), axis=0
    )
    edges = edges[np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1) > 0]
    before = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    found = []
    for pose in range(POSES):
        posed = posed_points(points, heads, parents, weights, np.random.default_rng(pose))
        after = np.linalg.norm(posed[edges[:, 0]] - posed[edges[:, 1]], axis=1)
        found.append(np.abs(after / before - 1).mean())
    return 100 * float(np.mean(found))


def posed_points(points, heads, parents, weights, rng):
    """Return the points as the bones move them, each turned at random."""
    places = []
    for head, parent in zip(heads, parents, strict=True):
        axis, angle = rng.normal(size=3), LARGEST * rng.uniform(-1, 1)
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        own = np.eye(4)
        own[:3, :3], own[:3, 3] = turn, head - turn @ head
        places.append(own if parent < 0 else places[parent] @ own)
    moved = np.einsum("nb,bij->nij", weights, np.array(places))
    rest = weights.sum(axis=1)
    here = np.einsum("nij,nj->ni", moved[:, :3, :3], points) + moved[:, :3, 3]
    return here + (1 - rest)[:, None] * points


def main(python, names, whole):
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        cases = []
        for name in names:
            shape = medialis.read_shape(name)
            rig = medialis.run("armature", shape).extras["bones"]
            for what, points, faces, scale in broken(
                shape.points, shape.faces, np.random.default_rng(1)
            ):
                if whole and what != "as it is":
                    continue
                path = Path(folder, f"{len(cases)}.npz")
                ends = {"heads": scale * rig.heads, "tails": scale * rig.tails}
                np.savez(path, points=points, faces=faces, **ends)
                cases.append((Path(name).stem, what, path, points, faces, ends, rig.parents))
        script = Path(folder, "weights.py")
        script.write_text(BLENDER)
        paths = [str(case[2]) for case in cases]
        subprocess.run(
            [python, str(script), *paths],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        titles = ("vertices", "bones", "no weight", "Blender")
        titles += ("4 bones %", "8 bones %", "Blender 4", "Blender %")
        print(f"{'shape':20} {'mesh':14}", *(f"{title:>10}" for title in (*titles, "seconds")))
        for name, what, path, points, faces, ends, parents in cases:
            shape = medialis.make_shape(points, faces, repair=True)
            armature = medialis.Armature(ends["heads"], ends["tails"], parents)
            clock = time.process_time()
            skin = medialis.bind_weights(shape, armature=armature, softness=SOFTNESS)
            clock = time.process_time() - clock
            more = medialis.bind_weights(
                shape, armature=armature, bones_per_vertex=8, softness=SOFTNESS
            )
            theirs = np.load(f"{path}.npy")
            theirs /= np.maximum(theirs.sum(axis=1, keepdims=True), 1e-12)
            four = np.where(theirs >= np.sort(theirs, axis=1)[:, [-4]], theirs, 0.0)
            four /= np.maximum(four.sum(axis=1, keepdims=True), 1e-12)
            ours = [dense(shape, one, len(parents)) for one in (skin, more)]
            rows = [*ours, four, theirs]
            none = [int((w.sum(axis=1) < 0.5).sum()) for w in rows[::3]]
            change = [stretch(points, faces, ends["heads"], parents, w) for w in rows]
            columns = [
                len(points),
                len(parents),
                *none,
                *(f"{one:.2f}" for one in (*change, clock)),
            ]
            print(f"{name:20} {what:14}", *(f"{one:>10}" for one in columns), flush=True)


def dense(shape, skin, bones):
    """Return the weights of all bones on the vertices that were given."""
    rows, weights = shape.on_input_points(skin.bones, -1), shape.on_input_points(skin.weights, 0.0)
    found = np.zeros((len(rows), bones + 1))
    np.put_along_axis(found, rows, weights, axis=1)
    return found[:, :-1]


if __name__ == "__main__":
    given = [one for one in sys.argv[1:] if one != "--whole"]
    main(given[0], given[1:], "--whole" in sys.argv)
