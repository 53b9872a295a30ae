"""Make our figure for each figure of the thesis that can be remade, on generated shapes.

python docs/make_thesis_figures.py [NAME ...]

The page `thesis_figures.md` says what each shows and how it differs from the printed one. The
thesis's own pictures and shapes are not used.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import numpy as np
from make_pictures import FOLDER, Image, _dented_plate, _noisy
from numpy.typing import ArrayLike, NDArray

import medialis
from medialis.operations.pictures import draw_result
from medialis.render.annotation import contact_sheet
from medialis.render.camera import Camera
from medialis.render.picture import Item, Points, Surface, draw
from medialis.render.png import write_png
from medialis.render.reconstruction import reconstruct_image

SIZE = {"width": 560, "height": 440}


def _view(points: ArrayLike, **more: object) -> Camera:
    return Camera.framing(points, **{**SIZE, **more})


def _close_up(points: NDArray[np.float64], place: Sequence[float], share: float) -> Camera:
    """Return the automatic view of the points, moved to a place and narrowed to a share."""
    whole = _view(points)
    place = np.asarray(place)
    eye = place + whole.eye - whole.target
    return Camera(eye, place, whole.up, whole.extent * share, **SIZE)


def figure_3_4() -> Image:
    """Draw importance on a clean and on a noisy skeleton, at three thresholds."""
    pictures, captions = [], []
    for name, shape in (("clean", medialis.organic_shape(160)), ("noisy", _noisy(0.001))):
        for threshold in (0.0, 0.02, 0.05):
            result = medialis.run("skeleton_importance", shape, threshold=threshold)
            pictures.append(draw_result(result, **SIZE))
            captions.append(f"{name}, importance from {100 * threshold:g} %")
    return contact_sheet(pictures, captions, 3)


def figure_3_7() -> Image:
    """Draw surface and union of balls, whole and close up, and their difference."""
    shape = medialis.organic_shape(300)
    cloud = medialis.surface_skeleton(shape)
    head = shape.points[np.argmax(shape.points @ [1.0, 0.0, 1.0])]
    rows = []
    for camera in (_view(shape.points), _close_up(shape.points, head, 0.35)):
        seen = reconstruct_image(shape, cloud, camera=camera)
        rows += [seen.surface_images[0], seen.ball_images[0], seen.difference_images[0]]
    return contact_sheet(rows, ["surface", "union of balls", "difference"] * 2, 3)


def figure_3_8() -> Image:
    """Draw the samples of two shapes, and their skeletons as triangles."""
    pictures = []
    for shape in (medialis.organic_shape(200), _dented_plate()):
        result = medialis.run("skeleton_mesh", shape)
        pictures.append(draw([Points(shape.points, size=1.5)], _view(shape.points)))
        pictures.append(draw_result(result, **SIZE))
    return contact_sheet(pictures, ["point cloud", "surface skeleton"] * 2, 2)


def figure_3_9() -> Image:
    """Draw the raw and the simplified skeleton mesh, whole and close up."""
    shape = _noisy(0.0005)
    head = shape.points[np.argmax(shape.points @ [1.0, 0.0, 1.0])]
    pictures, captions = [], []
    for name, given in (
        ("all points", {"min_spoke_angle": 0.0, "smallest_piece": 0.0}),
        ("importance from 3 %", {"min_spoke_angle": 0.0, "importance": 0.03}),
    ):
        result = medialis.run("skeleton_mesh", shape, **given)
        for camera in (_view(shape.points), _close_up(shape.points, head, 0.4)):
            pictures.append(draw_result(result, camera=camera))
            captions.append(f"{name}: {result.values['faces']} faces")
    return contact_sheet(pictures, captions, 2)


def figure_3_11() -> Image:
    """Draw a surface, its medial cloud, the radius of the cloud, and the radius brought back."""
    shape = medialis.organic_shape(200)
    cloud = medialis.surface_skeleton(shape)
    good = cloud.subset(cloud.valid)
    field = medialis.field_on_surface(cloud, cloud.radii, shape.point_count)
    camera = _view(shape.points)
    panels: list[list[Item]] = [
        [Surface(shape.points, shape.faces)],
        [Surface(shape.points, shape.faces, opacity=0.12), Points(good.centers, size=2)],
        [Points(good.centers, size=2, values=good.radii)],
        [Surface(shape.points, shape.faces, values=field)],
    ]
    captions = ["surface", "medial cloud", "radius on the cloud", "radius on the surface"]
    return contact_sheet([draw(items, camera) for items in panels], captions, 2)


def figure_3_12() -> Image:
    """Draw the tangent field T of the geodesics on the skeleton (Eq. 3.2), coloured by direction."""
    shape = medialis.organic_shape(200)
    cloud = medialis.surface_skeleton(shape)
    paths = medialis.geodesic_importance(shape, cloud)
    kept = medialis.important_points(shape, paths.length, 0.02)
    ends = shape.points[cloud.features[kept]]
    along = ends[:, 0] - ends[:, 1]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # Both pointing away from the ball: t_s leaves f1, and t_e, which arrives at f2, is turned round.
    total = paths.start_tangent[kept] - paths.end_tangent[kept]
    total -= along * (along * total).sum(axis=1, keepdims=True)
    length = np.linalg.norm(total, axis=1)
    found = length > 1e-9
    direction = total[found] / length[found, None]
    points = Points(cloud.centers[kept][found], size=2.5, color=(direction + 1) / 2)
    pictures = [
        draw([points], camera)
        for camera in (_view(shape.points), _view(shape.points, direction=(0.3, -0.2, 1)))
    ]
    return contact_sheet(pictures, ["from the side", "from above"], 2)


FIGURES: dict[str, Callable[[], Image]] = {
    f"thesis_{make.__name__}": make
    for make in (figure_3_4, figure_3_7, figure_3_8, figure_3_9, figure_3_11, figure_3_12)
}


def main(names: list[str]) -> None:
    """Make the named figures, or all."""
    FOLDER.mkdir(exist_ok=True)
    for name in names or FIGURES:
        path = FOLDER / f"{name}.png"
        write_png(path, FIGURES[name]())
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
