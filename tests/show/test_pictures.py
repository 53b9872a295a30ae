"""Colours, text, PNG files and whole pictures."""

import struct
from dataclasses import replace

import make_color_maps
import numpy as np
import pytest
from make_color_maps import lab_of_rgb, rgb_of_lab

import medialis
from medialis.base.errors import FileError, InvalidOptionError, InvalidShapeError
from medialis.base.threads import thread_limit
from medialis.show.annotation import (
    ColorBar,
    contact_sheet,
    draw_text,
    number_text,
    round_steps,
    text_width,
)
from medialis.show.camera import Camera
from medialis.show.colors import (
    MISSING,
    color_table,
    label_colors,
    map_colors,
    palette,
    to_linear,
    to_srgb,
)
from medialis.show.medial_points import disc_mesh, medial_pieces, sheet_discs
from medialis.show.picture import (
    Balls,
    Curves,
    Points,
    Surface,
    draw,
)
from medialis.show.png import encode_png, reduced, write_png
from medialis.show.raster import Style, corner_normals
from png_files import read_png

ORGANIC = medialis.organic_shape(56)
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def camera(width=160, height=120, **options):
    return Camera.framing(CUBE, width=width, height=height, **options)


def ink(image):
    return (image < 250).any(axis=2)


def test_sequential_map_rises_evenly_in_lightness():
    lightness = lab_of_rgb(color_table("sequential"))[:, 0]
    # Evenly: the steps of L* differ only by what clipping to 0..1 rounds.
    np.testing.assert_allclose(np.diff(lightness), 66 / 1023, atol=1e-6)


def test_diverging_map_is_lightest_in_the_middle_and_even_on_both_sides():
    lightness = lab_of_rgb(color_table("diverging"))[:, 0]
    half = len(lightness) // 2
    assert (np.diff(lightness[:half]) > 0).all()
    assert (np.diff(lightness[half:]) < 0).all()
    np.testing.assert_allclose(lightness, lightness[::-1], atol=0.2)


def test_color_spaces_round_trip_and_known_colors():
    rng = np.random.default_rng(0)
    rgb = rng.random((50, 3))
    np.testing.assert_allclose(rgb_of_lab(lab_of_rgb(rgb)), rgb, atol=1e-9)
    np.testing.assert_allclose(to_srgb(to_linear(rgb)), rgb, atol=1e-9)
    np.testing.assert_allclose(lab_of_rgb([1.0, 1, 1]), [100, 0, 0], atol=0.02)
    # Published CIELAB of pure sRGB red under D65.
    np.testing.assert_allclose(lab_of_rgb([1.0, 0, 0]), [53.24, 80.09, 67.20], atol=0.02)


def test_the_tables_are_those_that_the_script_derives():
    """Sines and roots may differ in the last digits from machine to machine."""
    for name in ("sequential", "diverging"):
        derived = getattr(make_color_maps, name)()
        np.testing.assert_allclose(color_table(name), derived, atol=1e-9)
    np.testing.assert_allclose(palette(), make_color_maps.palette(), atol=1e-9)


def test_labels_differ_clearly():
    lab = lab_of_rgb(palette())
    apart = np.linalg.norm(lab[:, None] - lab, axis=2) + 1e9 * np.eye(len(lab))
    assert apart[:12, :12].min() > 30
    assert apart.min() > 10
    assert label_colors([-1, 48])[0].tolist() == list(MISSING)
    np.testing.assert_array_equal(label_colors([48]), label_colors([0]))
    with pytest.raises(InvalidShapeError, match="whole numbers"):
        label_colors([0.5])


def test_values_to_colors():
    table = color_table("sequential")
    colors = map_colors([0.0, 0.5, 1.0, np.nan, -np.inf, np.inf], low=0, high=1)
    np.testing.assert_array_equal(colors[[0, 2, 4, 5]], table[[0, -1, 0, -1]])
    assert colors[3].tolist() == list(MISSING)
    np.testing.assert_array_equal(map_colors([3.0, 3.0]), table[[512, 512]])
    np.testing.assert_array_equal(map_colors([-1e308, 1e308]), table[[0, -1]])
    assert (map_colors([np.nan, np.nan]) == MISSING).all()
    assert len(map_colors([])) == 0
    with pytest.raises(InvalidOptionError, match="cmap must be one of sequential, diverging"):
        map_colors([1.0], "rainbow")
    with pytest.raises(InvalidOptionError, match="low must not be above high"):
        map_colors([1.0], low=2, high=1)


def written(text, size=14, **options):
    """Return a line of text on white."""
    image = np.full((40, 60 + text_width(text, size), 3), 255, np.uint8)
    draw_text(image, text, 10, 30, size, **options)
    return image


def test_values_that_differ_by_rounding_have_one_colour():
    """The wall of a gear, 0.34 thick everywhere, was spotted."""
    values = 0.34 * (1 + 1e-15 * np.arange(-3, 4))
    assert len(np.unique(map_colors(values), axis=0)) == 1
    assert len(np.unique(map_colors(values * [1, 1, 1, 1, 1, 1, 1.01]), axis=0)) == 2


def test_every_character_has_its_own_shape():
    shapes = {written(chr(code)).tobytes() for code in range(33, 127)}
    assert len(shapes) == 94
    assert (written(" ") == 255).all() and (written("") == 255).all()
    np.testing.assert_array_equal(written("漢"), written("□"))
    assert not np.array_equal(written("é"), written("e"))


def test_a_capital_is_as_high_as_asked_for_and_stands_where_asked_for():
    for size in (9, 14, 25):
        rows = np.flatnonzero((written("H", size) < 128).any(axis=(1, 2)))
        assert abs(rows[0] - 10) <= 1 and abs(len(rows) - size) <= 1
    for anchor, share in (("left", 0.0), ("middle", 0.5), ("right", 1.0)):
        image = np.full((30, 400, 3), 255, np.uint8)
        draw_text(image, "HIH", 5, 200, 12, anchor=anchor)
        columns = np.flatnonzero((image < 128).any(axis=(0, 2)))
        width = text_width("HIH", 12)
        assert abs(columns[0] - (200 - share * width)) <= 3 and len(columns) <= np.ptp(columns) + 1
    image = np.full((30, 40, 3), 255, np.uint8)
    draw_text(image, "far too long for this", -4, -20, 12)
    assert ink(image).any()


def test_text_on_a_see_through_picture_has_a_light_rim():
    image = np.zeros((40, 80, 4), np.uint8)
    draw_text(image, "rim", 10, 10, 16)
    dark = (image[..., :3] < 60).all(axis=2) & (image[..., 3] > 250)
    light = (image[..., :3] > 200).all(axis=2) & (image[..., 3] > 150)
    assert dark.sum() > 30 and light.sum() > 30
    assert image[0, 0].tolist() == [0, 0, 0, 0]


def test_steps_of_a_scale_are_round_and_inside():
    rng = np.random.default_rng(0)
    for low, high in np.sort(rng.lognormal(0, 4, (200, 2)), axis=1).tolist():
        steps = round_steps(low, high, 5)
        assert 2 <= len(steps) <= 5 and low < steps[0] and steps[-1] < high
        digits = {f"{x:.9e}"[:3] for x in np.diff(steps)}
        assert digits <= {"1.0", "2.0", "5.0", "9.9", "1.9", "4.9"}
    assert round_steps(1.0, 1.0, 5) == round_steps(np.nan, 1.0, 5) == []


def test_discs_lie_in_sheets_and_leave_curves_alone():
    x, y = (c.ravel() for c in np.mgrid[0:12, 0:12].astype(float))
    plane = np.stack([x, y, 0 * x], axis=1)
    signs = np.where(np.arange(len(plane)) % 2, 1.0, -1.0)
    radii, flat, axes, _ = sheet_discs(plane, signs[:, None] * [[0.0, 0.0, 3.0]])
    assert flat.all()
    np.testing.assert_allclose(np.abs(axes[:, 2]), 1, atol=1e-9)
    corners, faces = disc_mesh(plane, axes, radii)
    assert len(faces) == 5 * len(plane)
    rim = np.linalg.norm(corners.reshape(-1, 7, 3) - plane[:, None], axis=2)
    np.testing.assert_allclose(rim, np.broadcast_to(radii[:, None], rim.shape))
    np.testing.assert_allclose(corners[:, 2], 0, atol=1e-9)
    angle = np.arange(40) * 2.4
    round_a_curve = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    line = np.arange(40.0)[:, None] * [[0, 0, 1]]
    assert not sheet_discs(line, round_a_curve)[1].any()
    assert not sheet_discs(line[:2], round_a_curve[:2])[1].any()


def test_medial_points_are_drawn_as_the_skeleton_mesh():
    """Fixed: where sheets meet they were torn into white slits, and rims were rows of discs."""
    result = medialis.run("surface_skeleton", ORGANIC, fans=False)
    layer = result.layers[0]
    rows = np.flatnonzero(~layer.hidden)
    drawn = medial_pieces(result.shape, layer, rows)
    cloud = medialis.surface_skeleton(ORGANIC)
    limit = layer.filter_default  # the bridge closes the same gaps
    mesh = medialis.skeleton_mesh(cloud, min_spoke_angle=0.0, importance=limit, smallest_piece=0.0)
    np.testing.assert_array_equal(drawn.sheets[0], mesh.points)
    np.testing.assert_array_equal(drawn.sheets[1], mesh.faces)
    # What is not drawn by triangles lies away from them, and all of it is drawn.
    alone = np.union1d(drawn.of_discs, drawn.of_balls)
    gaps = np.linalg.norm(layer.points[rows][:, None] - mesh.points, axis=2).min(axis=1)
    assert np.array_equal(alone, np.flatnonzero(gaps > 3.0 * result.shape.spacing))


def test_medial_points_without_triangles_are_discs_and_balls():
    thin = medialis.run("surface_skeleton", ORGANIC, subsample=0.05)
    layer = thin.layers[0]
    drawn = medial_pieces(thin.shape, layer, np.arange(len(layer.points)))
    assert len(drawn.sheets[1]) < len(drawn.of_discs) / 5
    assert 0 < len(np.union1d(drawn.of_discs, drawn.of_balls)) <= len(layer.points)
    # Fans have several balls of one sample; clouds have no triangles.
    box = medialis.run("surface_skeleton", medialis.Shape(CUBE, CUBE, CUBE_FACES), side="both")
    layer = box.layers[0]
    assert len(medial_pieces(box.shape, layer, np.arange(len(layer.points))).sheets[1]) > 100
    cloud = medialis.run("surface_skeleton", medialis.Shape(ORGANIC.points, ORGANIC.normals))
    layer = cloud.layers[0]
    drawn = medial_pieces(cloud.shape, layer, np.arange(len(layer.points)))
    assert len(drawn.sheets[1]) == 0 and len(drawn.of_discs) > 1000


def test_only_whole_numbers_stand_beside_orders():
    key = ColorBar("order", "sequential", 0.0, 3.0)
    assert 0.5 in key.numbers
    assert replace(key, whole=True).numbers == [0.0, 3.0, 1.0, 2.0]


def test_numbers_are_short():
    texts = [number_text(x) for x in (999.6, -0.5, 1e-12, 123456.0, 1e9, 0.1 + 0.2)]
    assert texts == ["1000", "-0.5", "1e-12", "123000", "1e9", "0.3"]


@pytest.mark.parametrize("shape", [(1, 1, 3), (7, 13, 3), (60, 41, 3), (1, 1, 4), (200, 41, 4)])
def test_png_round_trip(tmp_path, shape):
    """200 rows are four strips, each compressed by itself; zlib checks the sum of all."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, shape).astype(np.uint8)
    image[len(image) // 2 :] = 255
    image[:, shape[1] // 2 :, 0] = np.arange(shape[0])[:, None]
    write_png(tmp_path / "a.png", image)
    np.testing.assert_array_equal(read_png(tmp_path / "a.png"), image)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    assert struct.unpack(">II", encode_png(image)[16:24]) == shape[1::-1]


def test_a_reduced_picture_is_the_mean_of_squares():
    """Whole squares only, and never narrower than asked for."""
    image = np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3)
    small = reduced(image, 3)
    assert small.shape == (2, 3, 3)
    np.testing.assert_array_equal(small[1, 2], np.rint(image[2:4, 4:6].mean(axis=(0, 1))))
    np.testing.assert_array_equal(reduced(image, 7), image)
    assert reduced(image, 1).shape == (1, 1, 3)


def test_a_reduced_see_through_picture_keeps_its_colors():
    image = np.zeros((4, 4, 4), np.uint8)
    image[:2, 0] = 200, 100, 50, 255
    small = reduced(image, 2)
    assert small[0, 0].tolist() == [200, 100, 50, 128]
    assert small[1, 1].tolist() == [0, 0, 0, 0]


def test_png_errors(tmp_path):
    good = np.zeros((2, 2, 3), np.uint8)
    for bad in (good[..., 0], good.astype(float), good[:0], good[..., :2]):
        with pytest.raises(InvalidShapeError, match="uint8"):
            encode_png(bad)
    with pytest.raises(FileError, match="Cannot write"):
        write_png(tmp_path / "missing" / "a.png", good)
    with pytest.raises(FileError, match="folder"):
        write_png(tmp_path, good)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_picture_of_everything_is_the_same_on_any_number_of_threads():
    rng = np.random.default_rng(0)
    inside = rng.uniform(-0.8, 0.8, (50, 3))
    items = [
        Surface(CUBE, CUBE_FACES, opacity=0.2),
        Surface(CUBE * 0.3, CUBE_FACES, labels=np.arange(12), per_face=True),
        Balls(inside, rng.uniform(0, 0.1, 50), values=inside[:, 0]),
        Points(inside[::-1], size=3, color=(1, 0, 0)),
        Curves(CUBE, [[0, 1], [1, 3], [3, 7]], width=4, labels=np.arange(8)),
    ]
    pictures = []
    for count in (1, 2):
        with thread_limit(count):
            pictures.append(draw(items, camera(perspective=True), title="T", legend="Label"))
    np.testing.assert_array_equal(*pictures)
    assert pictures[0].shape == (120, 160, 3)
    assert pictures[0].dtype == np.uint8


def test_colors_arrive_in_the_picture():
    """A facing surface shows about its own colour: what the legend says is what one sees.

    The highlight adds up to 0.03 of linear light, which is 0.14 of a channel that was dark.
    """
    square = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    front = Camera([0, 0, 5], [0, 0, 0], [0, 1, 0], 1.0, 20, 20)
    for color in ((0.8, 0.2, 0.2), (0.2, 0.7, 0.3), (0.1, 0.2, 0.6)):
        image = draw([Surface(square, [[0, 1, 2], [0, 2, 3]], color=color)], front)
        assert np.abs(image[10, 10] / 255 - color).max() < 0.14


def test_a_see_through_picture_laid_on_white_is_the_picture():
    items = [
        Surface(CUBE, CUBE_FACES, opacity=0.2, color=(0.3, 0.5, 0.9)),
        Balls(CUBE / 3, 0.4, values=CUBE[:, 0]),
    ]
    white = draw(items, camera())
    clear = draw(items, camera(), style=Style(background=None))
    assert clear.shape == (120, 160, 4) and clear[0, 0].tolist() == [0, 0, 0, 0]
    solid = clear[..., 3] == 255
    assert np.abs(clear[solid][:, :3].astype(int) - white[solid]).max() <= 1
    np.testing.assert_array_equal(clear[..., 3] > 0, ink(white) | (clear[..., 3] > 0))
    veiled = (clear[..., 3] > 10) & ~solid
    assert veiled.sum() > 500
    sheet = contact_sheet([clear])[8:128, 8:168].astype(int)
    # Covers are mixed as screens do, not in linear light: somewhat darker, never lighter.
    assert (sheet - white).max() <= 2 and (white - sheet)[veiled].mean() < 40


def test_a_cropped_picture_is_the_shape_and_a_margin():
    items, around = [Balls([[0, 0, 0]], 0.4, values=[0.5], low=0, high=1)], camera(400, 300)
    plain = draw(items, around)
    cropped = draw(items, around, style=Style(crop=True))
    rows, columns = (np.flatnonzero(ink(plain).any(axis=axis)) for axis in (1, 0))
    margin = (cropped.shape[0] - len(rows)) // 2
    assert 5 <= margin <= 20 and cropped.shape[1] == len(columns) + 2 * margin
    inner = cropped[margin:-margin, margin:-margin]
    np.testing.assert_array_equal(
        inner, plain[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    )
    noted = draw(
        items, around, style=Style(crop=True), title="A long title over a ball", legend="value"
    )
    assert noted.shape[0] > cropped.shape[0] and noted.shape[1] > cropped.shape[1]
    assert draw([], camera(60, 40), style=Style(crop=True)).shape == (40, 60, 3)


def test_edges_are_smooth_and_the_background_is_white():
    image = draw([Balls([[0, 0, 0]], 0.8, color=(0, 0, 0))], camera())
    assert (image[0] == 255).all()
    assert len(np.unique(image)) > 20
    rough = draw(
        [Balls([[0, 0, 0]], 0.8, color=(0, 0, 0))],
        camera(),
        style=Style(specular=0, supersampling=1),
    )
    assert ((rough == 255) | (rough < 60)).all()


def test_see_through_shows_the_inside_and_a_dark_outline():
    around = camera(margin=0.1)
    solid = draw([Surface(CUBE, CUBE_FACES), Points([[0, 0, 0]], size=20, color=(1, 0, 0))], around)
    clear = draw(
        [Surface(CUBE, CUBE_FACES, opacity=0.15), Points([[0, 0, 0]], size=20, color=(1, 0, 0))],
        around,
    )
    red = (clear[..., 0].astype(int) - clear[..., 1]) > 90
    assert red.sum() > 150
    assert not ((solid[..., 0].astype(int) - solid[..., 1]) > 90).any()
    np.testing.assert_array_equal(ink(clear), ink(solid))


def test_title_and_legend_do_not_cover_the_shape():
    around = camera(400, 300)
    plain = draw([Balls([[0, 0, 0]], 0.9, values=[1.0])], around)
    noted = draw([Balls([[0, 0, 0]], 0.9, values=[1.0])], around, title="A ball", legend="radius")
    assert plain.shape == noted.shape
    # The shape's own columns and rows are followed by a white gap before legend and title.
    assert ink(noted)[:20].any()
    columns = ink(noted)[30:].any(axis=0)
    gaps = np.flatnonzero(np.diff(columns.astype(int)))
    assert len(gaps) >= 4
    missing = draw([Points(CUBE, values=[np.nan, *range(7)])], around, legend="x")
    assert (np.abs(missing.astype(int) - round(255 * MISSING[0])).max(axis=2) == 0).sum() > 20


def test_label_keys_use_names_and_shorten_long_lists():
    around = camera(400, 300)
    few = draw(
        [Points(CUBE, labels=np.arange(8) % 3 - 1)],
        around,
        legend="part",
        label_names=["body", "tail"],
    )
    many = draw([Points(np.repeat(CUBE, 10, 0), labels=np.arange(80))], around, legend="part")
    assert few.shape == many.shape == (300, 400, 3)


@pytest.mark.slow
def test_sharp_edges_stay_sharp_and_round_ones_smooth():
    """A cube's corners were once rounded where its diagonals gave one side a double weight."""
    normals = corner_normals(CUBE, CUBE_FACES)
    np.testing.assert_allclose(np.abs(normals).max(axis=2), 1, atol=1e-6)
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    points = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (-1.0, 1.0)])
    i, j = np.arange(60), np.roll(np.arange(60), -1)
    faces = np.concatenate([np.stack([i, j, i + 60], 1), np.stack([j, j + 60, i + 60], 1)])
    shading = corner_normals(points, faces)
    radial = points[faces] * [1, 1, 0]
    # The two faces round a vertex that share a side differ by 6 degrees.
    assert (np.einsum("mkj,mkj->mk", shading, radial) > np.cos(np.radians(3.1))).all()


def test_contact_sheet_places_images_and_captions():
    cells = [np.full((30, 40, 3), shade, np.uint8) for shade in (10, 20, 30)]
    sheet = contact_sheet(cells, columns=2)
    assert sheet.shape == (2 * 38 + 8, 2 * 48 + 8, 3)
    for number, shade in enumerate((10, 20, 30)):
        row, col = 8 + number // 2 * 38, 8 + number % 2 * 48
        assert (sheet[row : row + 30, col : col + 40] == shade).all()
    assert contact_sheet(cells, ["a", "b", "a very long caption that is written smaller"]).size
    keyed = contact_sheet(cells, columns=2, key=ColorBar("mm", "sequential", 0.0, 3.0))
    assert keyed.shape[0] == sheet.shape[0] and keyed.shape[1] > sheet.shape[1] + 20
    with pytest.raises(InvalidShapeError, match="at least one"):
        contact_sheet([])
    with pytest.raises(InvalidShapeError, match="uint8"):
        contact_sheet([np.zeros((3, 3))])
    with pytest.raises(InvalidOptionError, match="captions"):
        contact_sheet(cells, ["a"])


def test_bad_items_and_options_are_one_sentence():
    around = camera(60, 40)
    ball = Balls([[0, 0, 0]], 1.0)
    for item in (
        Balls([[0, 0, 0]], [1.0, 2.0]),
        Balls([[0, 0, 0]], [np.nan]),
        Balls([[0, 0, 0]], 1.0, values=[1.0, 2.0]),
        Points([[0, 0, 0]], labels=[0, 1]),
        Surface(CUBE, [[0, 1, 9]]),
        Curves(CUBE, [[0, 1, 2]]),
        Curves(CUBE, [[0, 8]]),
    ):
        with pytest.raises(InvalidShapeError):
            draw([item], around)
    for item in (
        Points([[0, 0, 0]], size=0),
        Surface(CUBE, CUBE_FACES, opacity=1.5),
        Balls([[0, 0, 0]], 1.0, color=(2, 0, 0)),
        Balls([[0, 0, 0]], 1.0, values=[1.0], cmap="x"),
    ):
        with pytest.raises(InvalidOptionError):
            draw([item], around)
    with pytest.raises(InvalidOptionError, match="there is none"):
        draw([ball], around, legend="radius")
    with pytest.raises(InvalidOptionError, match="wider picture"):
        draw([Balls([[0, 0, 0]], 1.0, values=[1.0])], around, legend="radius")
    with pytest.raises(InvalidOptionError, match="supersampling"):
        Style(supersampling=0)
    with pytest.raises(InvalidOptionError, match="larger than 16384"):
        draw([ball], camera(16384, 10))
    assert (draw([], around) == 255).all()


@pytest.mark.parametrize("unit", [2.0**330, 2.0**-330], ids=["huge", "tiny"])
def test_unit_of_length_does_not_change_a_picture(unit):
    """At a size of 1e100 products of lengths were NaN, which indexed the table of colours: drawing
    ended the process with a segmentation fault."""
    frame = camera()
    scaled = Camera(unit * frame.eye, unit * frame.target, frame.up, unit * frame.extent, 160, 120)

    def scene(points):
        return [Surface(points, CUBE_FACES, opacity=0.2), Points(points / 2, size=5.0)]

    expected = draw([*scene(CUBE), Surface(CUBE / 3, CUBE_FACES)], frame)
    found = draw([*scene(unit * CUBE), Surface(unit * CUBE / 3, CUBE_FACES)], scaled)
    assert np.array_equal(found, expected) and ink(found).any()


@pytest.mark.parametrize("perspective", [False, True])
def test_what_is_empty_is_not_drawn_and_changes_no_pixel(perspective):
    """Specks in two corners make the window the whole picture; the rest stays as it was."""
    shape = medialis.organic_shape(56)
    middle, far = shape.points.mean(axis=0), shape.diagonal
    eye = middle + np.array([0.0, 0.0, 2.0 * far])
    size = {"extent": 2.5 * far, "width": 163, "height": 121, "perspective": perspective}
    camera = Camera(eye, middle, [0, 1, 0], **size)
    items = [
        Surface(shape.points, shape.faces),
        Surface(shape.points + np.array([0.3 * far, 0, 0]), shape.faces, opacity=0.3),
        Balls(shape.points[::40] - np.array([0.4 * far, 0, 0]), 0.02 * far),
    ]
    corners = middle + far * np.array([[-1.55, 1.15, 0.0], [1.55, -1.15, 0.0]])
    alone = draw(items, camera)
    whole = draw([*items, Balls(corners, 0.01 * far)], camera)
    differs = (alone != whole).any(axis=2)
    assert differs[:12, :20].any() and differs[-12:, -20:].any()
    differs[:12, :20] = differs[-12:, -20:] = False
    assert not differs.any()
