"""Views rendered by Blender against the core's rasterizer."""

import math
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

from blender_addon import views

import medialis
from medialis.curves.from_views.views import camera_pairs, sphere_of

REAL = Path(__file__).resolve().parents[3] / "shared" / "shapes"


@pytest.fixture(scope="module")
def creature():
    return medialis.organic_shape(56)


@pytest.fixture(scope="module")
def gpu_works():
    reason = views.why_no_gpu()
    if reason is not None:
        pytest.skip(f"Blender cannot draw on this machine: {reason}")


def cameras_of(shape, count, size):
    center, radius = sphere_of(shape.points)
    pairs = camera_pairs(center, radius, pairs=count, angle=math.radians(20), size=size)
    return [camera for pair in pairs for camera in pair]


def shapes():
    names = [name for name in ("hand", "fertility") if (REAL / f"{name}.ply").exists()]
    return ["creature", "cloud", "far away", *names]


@pytest.mark.parametrize("name", shapes())
def test_agrees_with_the_rasterizer(name, creature, gpu_works):
    """Masks agree on 99.9 % of the pixels; depths, where surfaces are not steep, to a thousandth.

    Graphics snap corners to 1/256 of a pixel, so the borders of silhouettes may differ, and a depth
    by the slope over as much.
    """
    if name == "creature":
        shape = creature
    elif name == "cloud":
        shape = medialis.Shape(creature.points, creature.normals)
    elif name == "far away":
        shape = medialis.Shape(creature.points + 1000.0, creature.normals, creature.faces)
    else:
        shape = medialis.read_shape(REAL / f"{name}.ply")
    cameras = cameras_of(shape, 4, 256)
    triangles = medialis.rasterizer(shape)
    expected = triangles(cameras)
    found = views.render_views(triangles.points, triangles.faces, cameras)
    for one, other in zip(expected, found, strict=True):
        assert (one.mask == other.mask).mean() >= 0.999
        both = one.mask & other.mask
        assert both.mean() > 0.02
        for a, b in ((one.near, other.near), (one.far, other.far)):
            gap = np.abs(a - b)[both] / shape.diagonal
            assert np.median(gap) < 1e-5 and np.quantile(gap, 0.99) < 1e-3


def test_curve_skeletons_agree(creature, gpu_works):
    """Within 1 % of the diagonal, with the same number of components, loops and ends."""
    from scipy.spatial import cKDTree

    quick = {"pairs": 60, "size": 256}
    own = medialis.view_curve_skeleton(creature, **quick)
    source = views.renderer(creature.points, creature.faces)
    blender = medialis.view_curve_skeleton(creature, source=source, **quick)
    assert (own.component_count, own.loops) == (blender.component_count, blender.loops)
    assert len(own.end_points) == len(blender.end_points)
    lines = []
    for curve in (own, blender):
        a, b = curve.nodes[curve.edges[:, 0]], curve.nodes[curve.edges[:, 1]]
        lines.append(np.concatenate([a + t * (b - a) for t in np.linspace(0, 1, 9)]))
    for one, other in (lines, lines[::-1]):
        assert cKDTree(one).query(other)[0].max() < 0.01 * creature.diagonal


def test_no_data_is_left(gpu_works):
    """The tiny render that starts the graphics leaves no scene, camera or object behind."""
    for data in (bpy.data.scenes, bpy.data.cameras, bpy.data.objects):
        assert not any("medialis views" in item.name for item in data)


def test_the_operator_renders_with_the_gpu(creature, scene, gpu_works, monkeypatch):
    """The views come from `GpuViews`, and the nodes are those that they give."""
    from blender_scenes import add_mesh, read_back

    made = []
    real = views.GpuViews

    def recorded(*arguments):
        made.append(real(*arguments))
        return made[-1]

    monkeypatch.setattr(views, "GpuViews", recorded)
    points = creature.points.astype(np.float32).astype(float)
    chosen = add_mesh("creature", points, creature.faces)
    quick = {"pairs": 10, "size": 64}
    assert bpy.ops.medialis.view_curve_skeleton(views_by="GPU", **quick) == {"FINISHED"}
    assert len(made) == 1
    shape = medialis.make_shape(points, creature.faces, repair=True)
    with medialis.view_source(lambda s: views.renderer(s.points, s.faces)):
        expected = medialis.run("view_curve_skeleton", shape, **quick).layers[0]
    found = read_back(bpy.context.active_object.data, "position")
    assert np.array_equal(found, expected.points.astype(np.float32))
    bpy.context.view_layer.objects.active = chosen
    count = len(made)
    bpy.ops.medialis.view_curve_skeleton(views_by="CPU", **quick)
    assert len(made) == count
    bpy.ops.medialis.view_curve_skeleton(**quick)  # without a window Blender renders as well
    assert len(made) == count + 1


def test_the_operator_falls_back_and_says_so(creature, scene, monkeypatch):
    from blender_scenes import add_mesh

    monkeypatch.setattr(views, "why_no_gpu", lambda: "no driver")
    add_mesh("creature", creature.points, creature.faces)
    bpy.ops.medialis.view_curve_skeleton(views_by="GPU", pairs=10, size=64)
    said = bpy.context.active_object["medialis_summary"]
    assert "Blender cannot render views here (no driver): the core's rasterizer does." in said


@pytest.mark.parametrize(("device", "gpu"), [("NVIDIA", True), ("SOFTWARE", False)])
def test_automatic_takes_graphics_cards_only(device, gpu, monkeypatch):
    import sys
    from types import SimpleNamespace

    assert views.chosen("AUTO") and views.chosen("GPU") and not views.chosen("CPU")
    monkeypatch.setattr(views, "bpy", SimpleNamespace(app=SimpleNamespace(background=False)))
    platform = SimpleNamespace(device_type_get=lambda: device)
    monkeypatch.setitem(sys.modules, "gpu", SimpleNamespace(platform=platform))
    assert views.chosen("AUTO") == gpu
