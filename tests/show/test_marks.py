"""What is written over pictures: numbers at places that are seen, axes, and the bar."""

import numpy as np
import pytest

import medialis
import plates
from medialis.show.camera import Camera
from medialis.show.marks import round_length, seen, write_texts
from medialis.show.picture import Surface, draw
from medialis.show.raster import Style


@pytest.fixture
def box():
    points, faces = plates.boxes((0, 2, 0, 2, 0, 2))
    return np.asarray(points, float), np.asarray(faces)


def test_places_behind_a_surface_are_not_seen(box):
    camera = Camera([1, 1, 9], [1, 1, 1], [0, 1, 0], extent=4.0, width=200, height=160)
    places = np.array([[1, 1, 2.0], [1, 1, 0.0], [3, 3, 0.0], [30, 0, 0]], float)
    found = seen(camera, places, *box, medialis.base.progress.Progress())
    assert found.tolist() == [True, False, False, False] or found.tolist()[:2] == [True, False]


def test_texts_do_not_lie_over_each_other():
    camera = Camera([0, 0, 9], [0, 0, 0], [0, 1, 0], extent=2.0, width=400, height=300)
    image = np.full((300, 400, 3), 255, np.uint8)
    write_texts(image, camera, np.zeros((3, 3)), ["1: 0.8 mm", "2: 0.9 mm", ""])
    ink = (image < 200).any(axis=2)
    rows = np.flatnonzero(ink[:, 210:].any(axis=1))
    assert (np.diff(rows) > 1).sum() == 1  # two lines
    between = slice(rows[np.argmax(np.diff(rows) > 1)] + 1, rows[np.argmax(np.diff(rows) > 1) + 1])
    assert ink[between].any(), "a line leads from the place to the text that had to go away"


def test_no_text_leaves_the_picture():
    """The number of a place at the lower border was cut in two (fixed)."""
    camera = Camera([0, 0, 9], [0, 0, 0], [0, 1, 0], extent=2.0, width=400, height=300)
    image = np.full((300, 400, 3), 255, np.uint8)
    write_texts(image, camera, np.array([[0.0, -0.99, 0.0]]), ["1: 0.8 mm"])
    ink = np.flatnonzero((image < 200).any(axis=(1, 2)))
    assert len(ink) > 5 and ink.max() < 299


def test_the_bar_is_as_long_as_it_says(box):
    camera = Camera.framing(box[0], direction=[0, 0, 1], up=[0, 1, 0], width=600, height=450)
    plain = draw([Surface(*box)], camera)
    image = draw([Surface(*box)], camera, style=Style(scale=True), unit="mm")
    assert plain.shape == image.shape == (450, 600, 3)
    below = image[-60:].astype(int)
    gray = (abs(below - 60) < 30).all(axis=2)
    longest = max(np.diff(np.flatnonzero(np.diff(np.pad(row, 1).astype(int))))[::2].max(initial=0)
                  for row in gray)  # fmt: skip
    box_rows = (image[:-60] < 250).any(axis=2).any(axis=1).sum()
    # Half a millimetre of a box of two, and the halves of the strokes at its ends.
    thick = 4
    assert abs(longest - thick - box_rows / 4) <= thick


def test_round_lengths():
    for longest in np.random.default_rng(0).uniform(1e-6, 1e6, 200):
        length = round_length(longest)
        assert 0.4 * longest <= length <= longest * 1.000001


@pytest.mark.slow
def test_a_picture_of_walls_tells_kinds_and_limits():
    points, faces = plates.boxes((0, 60, 0, 40, 0, 4), (40, 40.8, 0, 40, 4, 24))
    shape = medialis.make_shape(points, faces, unit="mm")
    result = medialis.run("wall_check", shape, minimum="1mm")
    names = [name for name, _ in result.shown[0].classes]
    assert names[:2] == ["within", "too thin: below 1 mm"]
    image = medialis.draw_result(result, width=400, height=300)
    red = (image[..., 0] > 1.8 * image[..., 1].astype(float)) & (image[..., 0] > 80)
    assert 0.02 < red.mean() < 0.5
