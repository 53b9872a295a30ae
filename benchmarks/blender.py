"""Seconds of what the Blender adapter does, with `import bpy`: `python benchmarks/blender.py`."""

import sys
import time
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "core")]

import blender_addon  # noqa: E402

import medialis  # noqa: E402

blender_addon.register()

from blender_addon import fields, layers, reading  # noqa: E402
from blender_addon.changes import Changes  # noqa: E402


def measure(name, function, limit):
    """Print the best of three runs beside the limit."""
    best = np.inf
    for _ in range(3):
        clock = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - clock)
    print(f"| {name} | {best:.3f} s | {limit} s |")


def grid(side):
    """Triangles of a bumpy square with side^2 vertices."""
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    points = np.stack([x, y, 0.1 * np.sin(9 * x) * np.sin(7 * y)], axis=2).reshape(-1, 3)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    quads = np.stack([a, a + 1, a + side + 1, a + side], axis=1)
    return points, quads


def add(name, points, polygons):
    """Add a mesh object and make it active."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    mesh.loops.add(polygons.size)
    mesh.loops.foreach_set("vertex_index", polygons.astype(np.int32).ravel())
    mesh.polygons.add(len(polygons))
    starts = np.arange(0, polygons.size, polygons.shape[1], dtype=np.int32)
    mesh.polygons.foreach_set("loop_start", starts)
    mesh.update(calc_edges=True)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def main():
    """Print a table."""
    print(f"Blender {bpy.app.version_string}\n| | best of 3 | limit |\n|---|---|---|")
    rng = np.random.default_rng(0)
    n = 500_000
    attributes = {name: rng.random(n) for name in ("importance", "radius", "spoke_angle")}
    numbers = {name: rng.integers(0, n, n) for name in ("feature_1", "feature_2", "source")}
    layer = medialis.Layer(
        "cloud", rng.random((n, 3)), attributes={**attributes, **numbers},
        color_by="importance", filter_by="importance",
    )  # fmt: skip

    def cloud():
        with Changes() as changes:
            layers.make_object(layers.plan_layer(layer, "cloud", 0.01), bpy.context.scene, changes)

    measure("point cloud of 500,000 points, 7 attributes, material, modifier", cloud, 1)
    points, quads = grid(450)
    squares = add("quads", points, quads)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    surface = add("triangles", points, triangles)
    for made in (surface, squares):
        measure(
            f"read {len(points)} vertices, {len(triangles)} triangles, from {made.name}",
            lambda made=made: reading.read_object(bpy.context, made),
            0.3,
        )
    labels = rng.integers(0, 50, len(points))
    measure(
        f"50 vertex groups of {len(points)} vertices",
        lambda: fields.write_groups(surface, "part", np.arange(len(points)), labels),
        2,
    )


if __name__ == "__main__":
    main()
