"""Seconds of what the Blender adapter does, with `import bpy`: `python benchmarks/blender.py`.

With `--large` also operations on a million triangles, and how long Blender does not answer; with
`--first ZIP` the first clicks after that zip was installed in a new profile, the process that
computes included.
"""

import argparse
import json
import os
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "core")]

import blender_addon  # noqa: E402

import medialis  # noqa: E402

CLOCK = time.perf_counter()
blender_addon.register()
ENABLED = time.perf_counter() - CLOCK

from blender_addon import fields, jobs, layers, reading, writing  # noqa: E402
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


def torus(around, across):
    """Triangles of a bumpy torus with around * across vertices."""
    u, v = np.meshgrid(*(np.linspace(0, 2 * np.pi, n, endpoint=False) for n in (around, across)))
    r = 0.4 + 0.05 * np.sin(7 * u) * np.sin(3 * v)
    points = np.stack(
        [(1 + r * np.cos(v)) * np.cos(u), (1 + r * np.cos(v)) * np.sin(u), r * np.sin(v)], 2
    )
    i, j = np.meshgrid(np.arange(around), np.arange(across))
    a, b = j * around + i, j * around + (i + 1) % around
    c, d = ((j + 1) % across) * around + (i + 1) % around, ((j + 1) % across) * around + i
    quads = np.stack([a, b, c, d], 2).reshape(-1, 4)
    return points.reshape(-1, 3), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def processor_seconds():
    """Processor time of the process that computes (Linux)."""
    fields_of = Path(f"/proc/{jobs.computer()._process.pid}/stat").read_text().rpartition(")")[2]
    return sum(map(int, fields_of.split()[11:13])) / os.sysconf("SC_CLK_TCK")


def answering(name, chosen):
    """Print what an operation takes, and the longest that a timer of 0.05 s has to wait."""
    begin = time.perf_counter()
    source = reading.read_object(bpy.context, chosen)
    read = time.perf_counter()
    job = jobs.Job(source, name, {}, name)
    ticks = [read, time.perf_counter()]
    processor = processor_seconds()
    while not job.look():
        time.sleep(0.05)
        ticks.append(time.perf_counter())
    ticks.append(time.perf_counter())
    processor = processor_seconds() - processor
    jobs.close()
    writing.add_result(bpy.context, source, *job.outcome(), writing.Options())
    written = time.perf_counter() - ticks[-1]
    print(
        f"| {name} of {len(source.faces)} triangles | {processor:.1f} s processor time, "
        f"{ticks[-1] - read:.1f} s | read {read - begin:.3f} s, longest wait "
        f"{np.diff(ticks).max():.3f} s, write {written:.3f} s |"
    )


def large():
    """Print what operations on a million triangles take."""
    small = add("small", *torus(40, 20))
    points, faces = torus(1000, 500)
    for name in ("surface_skeleton", "thickness"):
        answering(name, small)  # the process is there, its kernels are loaded
        bpy.data.batch_remove([o for o in bpy.data.objects if o != small])
        answering(name, add("large", points, faces))
        jobs.stop()


def first(extension):
    """Print what the first click takes in a new profile, in the session that installs, and later.

    The session of the tests imports only bpy and what lies beside it: the core is that of the zip.
    """
    session = ROOT / "tests" / "blender" / "extension_session.py"
    with tempfile.TemporaryDirectory() as folder:
        for name in ("site", "home", "cache", "blender"):
            (Path(folder) / name).mkdir()
        for path in Path(sysconfig.get_path("purelib")).iterdir():
            if not path.name.startswith(
                ("scipy", "numba", "llvmlite", "medialis", "threadpoolctl")
            ):
                (Path(folder) / "site" / path.name).symlink_to(path)
        environment = {
            "PATH": os.environ["PATH"],
            "HOME": f"{folder}/home",
            "XDG_CACHE_HOME": f"{folder}/cache",
            "BLENDER_USER_RESOURCES": f"{folder}/blender",
        }
        print(f"Blender {bpy.app.version_string}\n| | clock | processor time |\n|---|---|---|")
        print(f"| enable, with import of the core | {ENABLED:.2f} s | |")
        for name, step in (("installed", f"install={extension}"), ("next session", "enable")):
            command = [
                sys.executable,
                "-I",
                "-S",
                "-B",
                str(session),
                f"{folder}/site",
                step,
                "click",
            ]
            run = subprocess.run(command, env=environment, capture_output=True, text=True)
            lines = [line for line in run.stdout.splitlines() if line.startswith("RESULT ")]
            if not lines:
                raise SystemExit(run.stdout + run.stderr)
            found = json.loads(lines[-1].removeprefix("RESULT "))
            seconds, processor = found["seconds"], found["processor seconds"]
            print(f"| first click, {name} | {seconds:.2f} s | {processor:.2f} s |")


def main():
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--large", action="store_true", help="only a million triangles")
    parser.add_argument("--first", type=Path, metavar="ZIP", help="only a new profile")
    chosen = parser.parse_args()
    if chosen.large or chosen.first:
        return large() if chosen.large else first(chosen.first.resolve())
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
