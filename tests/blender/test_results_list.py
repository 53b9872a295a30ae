"""Results as one set: one is shown, others wait hidden; one legend, drawn over views alone."""

import numpy as np
import pytest

import medialis
from blender_scenes import bpy


@pytest.fixture
def creature(scene):
    from blender_scenes import add_mesh

    shape = medialis.organic_shape(56)
    return add_mesh("creature", shape.points, shape.faces)


def run(chosen, name, **given):
    bpy.context.view_layer.objects.active = chosen
    assert getattr(bpy.ops.medialis, name)(**given) == {"FINISHED"}
    return bpy.context.active_object


def seen():
    """Names of the objects that views show."""
    bpy.context.view_layer.update()
    return {one.name for one in bpy.data.objects if one.visible_get()}


def test_the_last_result_is_shown_and_others_wait(creature):
    run(creature, "surface_skeleton")
    run(creature, "curve_skeleton")
    assert seen() == {"creature", "creature curve skeleton"}
    assert bpy.data.objects["creature surface skeleton"].hide_render
    assert bpy.ops.medialis.show_result(result="surface_skeleton") == {"FINISHED"}
    assert seen() == {"creature", "creature curve skeleton", "creature surface skeleton"}
    assert bpy.ops.medialis.show_result(result="surface_skeleton", solo=True) == {"FINISHED"}
    assert seen() == {"creature", "creature surface skeleton"}
    assert bpy.context.active_object.name == "creature surface skeleton"
    bpy.ops.medialis.remove_result(result="surface_skeleton")
    assert seen() == {"creature", "creature curve skeleton"}
    bpy.ops.medialis.remove_result(result="curve_skeleton")
    assert seen() == {"creature"}


def test_colours_on_the_surface_follow(creature):
    run(creature, "thickness")
    run(creature, "parts")
    colors = creature.data.color_attributes
    assert colors.active_color.name == "parts_color"
    bpy.ops.medialis.show_result(result="thickness", solo=True)
    assert colors.active_color.name == "wall_thickness_color"
    assert creature["medialis_summary"].startswith("Thickness")
    bpy.ops.medialis.show_result(result="thickness")
    assert not creature.modifiers  # nothing is shown: its own look


def test_the_source_is_seen_where_its_copy_is_hidden(creature):
    """A smoothed surface stands in its place; thickness hid that, and nothing was seen (fixed)."""
    run(creature, "smooth")
    assert seen() == {"creature smooth"}
    run(creature, "thickness")
    assert "creature" in seen() and "creature smooth" not in seen() and not creature.hide_render
    bpy.ops.medialis.show_result(result="smooth", solo=True)
    assert seen() == {"creature smooth"} and creature.hide_render


def test_one_legend_of_what_is_looked_at(creature):
    from blender_addon import overlay

    assert overlay.looked_at(bpy.context) is None
    run(creature, "thickness")
    run(creature, "curve_skeleton")
    run(creature, "parts")
    found = []
    for name in ("thickness", "curve_skeleton", "parts"):
        bpy.ops.medialis.show_result(result=name, solo=True)
        source, legend = overlay.looked_at(bpy.context)
        assert source == creature
        found.append(legend["title"])
    assert found[0].startswith("wall thickness") and found[2].startswith("parts: ")
    assert not [one for one in bpy.data.objects if "legend" in one.name]
    bpy.ops.medialis.show_result(result="parts")
    bpy.context.view_layer.objects.active = creature
    assert overlay.looked_at(bpy.context) is None
    for _ in range(3):
        bpy.ops.medialis.remove_result()
    assert overlay.looked_at(bpy.context) is None


def test_no_legend_where_it_is_not_wanted(creature):
    from blender_addon import overlay

    run(creature, "thickness", legend=False)
    assert overlay.looked_at(bpy.context) is None


@pytest.mark.parametrize("name", ["thickness", "parts"])
@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_the_card_is_readable_at_any_scale(creature, name, scale, tmp_path):
    """Its pixels: light letters on dark, the first and the last colour, all of it in the view."""
    from blender_addon import overlay, views

    if views.why_no_gpu() is not None:
        pytest.skip(f"Blender cannot draw here: {views.why_no_gpu()}")
    run(creature, name)
    _, legend = overlay.looked_at(bpy.context)
    width, height = 700, 500
    places = [("1: 0.2 m", (100.0, 300.0), (150.0, 350.0))]
    pixels, card = painted(legend, places, width, height, scale)
    x, y, wide, high = map(int, card)
    assert x > 0 and y > 0 and x + wide < width and y + high < height
    inside = pixels[y : y + high, x : x + wide, :3].astype(int)
    assert (inside.min(axis=2) > 200).sum() > 40 * scale  # letters
    assert (inside.max(axis=2) < 80).mean() > 0.3  # the card
    for color in (legend["colors"][0], legend["colors"][-1]):
        assert (np.abs(inside - 255 * np.array(color)).max(axis=2) < 12).any()
    outside = pixels.copy()
    outside[y : y + high, x : x + wide] = 0
    assert (outside[..., 3] > 0).sum() > 200 * scale  # the number and its line


def painted(legend, places, width, height, scale):
    import gpu
    from blender_addon import overlay
    from mathutils import Matrix

    target = gpu.types.GPUOffScreen(width, height)
    with target.bind():
        gpu.state.active_framebuffer_get().clear(color=(0.0, 0.0, 0.0, 0.0))
        with gpu.matrix.push_pop():
            gpu.matrix.load_matrix(Matrix.Identity(4))
            flat = [[2 / width, 0, 0, -1], [0, 2 / height, 0, -1], [0, 0, -1, 0], [0, 0, 0, 1]]
            gpu.matrix.load_projection_matrix(Matrix(flat))
            card = overlay.paint(legend, places, width, bpy.context.scene, scale)
        read = gpu.state.active_framebuffer_get().read_color(0, 0, width, height, 4, 0, "UBYTE")
    read.dimensions = width * height * 4
    pixels = np.frombuffer(read, np.uint8).reshape(height, width, 4).copy()
    target.free()
    return pixels, card
