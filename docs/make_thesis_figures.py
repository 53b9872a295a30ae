"""Make our figure for each figure of the thesis that can be remade, on generated shapes.

python docs/make_thesis_figures.py [NAME ...]

The page `thesis_figures.md` says what each shows and how it differs from the printed one. The
thesis's own pictures and shapes are not used.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from make_pictures import FOLDER, Image, _dented_plate, _noisy, _wheel
from numpy.typing import ArrayLike, NDArray
from website.figures_of_chapters_4_to_6 import LATER_FIGURES

import medialis
from medialis.curves.candidates import tangent_field
from medialis.curves.from_views.views import camera_pairs, pair_points, sphere_of
from medialis.show.annotation import contact_sheet
from medialis.show.camera import Camera
from medialis.show.picture import Item, Points, Surface, draw, draw_result
from medialis.show.png import write_png
from medialis.show.reconstruction import reconstruct_image

SIZE = {"width": 560, "height": 440}


def _view(points: ArrayLike, **more: object) -> Camera:
    return Camera.framing(points, **{**SIZE, **more})


def _close_up(points: NDArray[np.float64], place: Sequence[float], share: float) -> Camera:
    """Return the automatic view of the points, moved to a place and narrowed to a share."""
    whole = _view(points)
    place = np.asarray(place)
    eye = place + whole.eye - whole.target
    return Camera(eye, place, whole.up, whole.extent * share, **SIZE)


def _head(shape: medialis.Shape) -> NDArray[np.float64]:
    """Return the middle of the creature's head."""
    forward = shape.points[:, 0]
    return shape.points[forward > np.quantile(forward, 0.88)].mean(axis=0)


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
    rows = []
    for camera in (_view(shape.points), _close_up(shape.points, _head(shape), 0.4)):
        seen = reconstruct_image(cloud, camera=camera)
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
    pictures, captions = [], []
    for name, given in (
        ("all points", {"min_spoke_angle": 0.0, "smallest_piece": 0.0}),
        ("importance from 3 %", {"min_spoke_angle": 0.0, "importance": 0.03}),
    ):
        result = medialis.run("skeleton_mesh", shape, **given)
        for camera in (_view(shape.points), _close_up(shape.points, _head(shape), 0.4)):
            pictures.append(draw_result(result, camera=camera))
            captions.append(f"{name}: {result.values['faces']} faces")
    return contact_sheet(pictures, captions, 2)


def figure_3_11() -> Image:
    """Draw a surface, its medial cloud, the radius of the cloud, and the radius brought back."""
    shape = medialis.organic_shape(200)
    cloud = medialis.surface_skeleton(shape)
    good = cloud.subset(cloud.valid)
    field = medialis.field_on_surface(cloud, cloud.radii)[: shape.point_count]
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
    """Draw the tangents of the geodesics on the skeleton (Eq. 3.2), coloured by direction."""
    shape = medialis.organic_shape(200)
    cloud = medialis.surface_skeleton(shape)
    paths = medialis.geodesic_importance(cloud)
    kept = medialis.important_points(paths, threshold=0.02)
    tangents = tangent_field(cloud)[kept]
    found = np.isfinite(tangents).all(axis=1)
    points = Points(cloud.centers[kept][found], size=2.5, color=(tangents[found] + 1) / 2)
    pictures = [
        draw([points], camera)
        for camera in (_view(shape.points), _view(shape.points, direction=(0.3, -0.2, 1)))
    ]
    return contact_sheet(pictures, ["from the side", "from above"], 2)


def figure_3_13() -> Image:
    """Draw curve skeletons from the surface skeleton, and from views."""
    pictures = [
        draw_result(medialis.run(name, shape), **SIZE)
        for name in ("curve_skeleton", "view_curve_skeleton")
        for shape in (medialis.organic_shape(160), _wheel())
    ]
    captions = ["from the surface skeleton (3.6)"] * 2 + ["from views (3.7)"] * 2
    return contact_sheet(pictures, captions, 2)


def _silhouette(size: int = 320) -> NDArray[np.bool_]:
    """Return the creature with a rough surface, seen from the side."""
    shape = _noisy(0.003)
    view = _square_view(shape, size, [[1, 0, 0], [0, 0, 1], [0, 1, 0]])
    return medialis.rasterizer(shape)([view])[0].mask


def _square_view(shape: medialis.Shape, size: int, axes: ArrayLike) -> medialis.OrthographicCamera:
    low, high = shape.bounds
    return medialis.OrthographicCamera((low + high) / 2, axes, 1.05 * shape.diagonal, size)


def _around(taken: NDArray[np.bool_], margin: int = 12) -> slice:
    """Return the range that is taken, with a margin."""
    inside = np.flatnonzero(taken)
    return slice(max(0, inside[0] - margin), inside[-1] + margin + 1)


def figure_3_15() -> Image:
    """Draw the skeleton of a silhouette at three thresholds of importance and of saliency."""
    mask = _silhouette()
    rows, columns = (_around(mask.any(axis=axis)) for axis in (1, 0))
    lines = [
        (np.column_stack([c.row, c.column]) if upright else np.column_stack([c.column, c.row]), c)
        for upright, c in (
            (True, medialis.silhouette_skeleton(mask, saliency=0.05)),
            (False, medialis.silhouette_skeleton(mask.T, saliency=0.05)),
        )
    ]
    pictures, captions = [], []
    for name, thresholds in (("importance", (5, 20, 60)), ("saliency", (0.5, 1, 4))):
        for threshold in thresholds:
            image = np.full((*mask.shape, 3), 255, np.uint8)
            image[mask] = (214, 219, 226)
            for places, found in lines:
                measure = found.importance
                if name == "saliency":
                    measure = found.importance / found.distance
                row, column = places[measure >= threshold].astype(int).T
                image[row, column] = (32, 60, 140)
            pictures.append(image[rows][:, columns].repeat(2, axis=0).repeat(2, axis=1))
            unit = " pixels" if name == "importance" else ""
            captions.append(f"{name} from {threshold:g}{unit}")
    return contact_sheet(pictures, captions, 3)


def _all_pairs(first: medialis.View, second: medialis.View, left: Any, right: Any) -> NDArray[Any]:
    """Return the points of every crossing with every one of the same row (Livesu et al.)."""
    a, b = first.camera, second.camera
    sine, cosine = -float(b.axes[0] @ a.axes[2]), float(b.axes[0] @ a.axes[0])
    found = []
    for row in range(a.size):
        x, other = (
            (c.column[c.begin[row] : c.begin[row + 1]] - a.size / 2) * a.pixel
            for c in (left, right)
        )
        depth = (x[:, None] * cosine - other[None, :]) / sine
        up = np.full(depth.shape, (a.size / 2 - row - 0.5) * a.pixel)
        found.append(np.stack([np.broadcast_to(x[:, None], depth.shape), up, depth], axis=2))
    return np.concatenate([block.reshape(-1, 3) for block in found]) @ a.axes + a.center


def figure_3_17() -> Image:
    """Draw the points of all pairs, of pairs by depth, and those sharpened, of the same views."""
    shape = medialis.organic_shape(160)
    result = medialis.run("view_curve_skeleton", shape, pairs=100, size=256)
    center, radius = sphere_of(shape.points)
    cameras = camera_pairs(center, radius, pairs=20, angle=np.radians(20), size=256)
    render = medialis.rasterizer(shape)
    every, by_depth = [], []
    for pair in cameras:
        views = render(pair)
        crossings = [medialis.silhouette_skeleton(view.mask) for view in views]
        every.append(_all_pairs(*views, *crossings))
        by_depth.append(pair_points(views[0], pair[1], *crossings))
    clouds = [np.concatenate(every), np.concatenate(by_depth), result.layers[1].points]
    near = [cloud[np.linalg.norm(cloud - center, axis=1) < radius] for cloud in clouds]
    context = Surface(shape.points, shape.faces, opacity=0.12)
    camera = _view(shape.points, direction=(0.7, -1, 0.9))
    pictures = [
        draw([context, Points(cloud, size=2, color=(0.1, 0.2, 0.5))], camera) for cloud in near
    ]
    names = ("all pairs of 20 views", "pairs by depth", "100 views, culled and sharpened")
    captions = [f"{name}: {len(cloud)} points" for name, cloud in zip(names, near, strict=True)]
    return contact_sheet(pictures, captions, 3)


def figure_3_18() -> Image:
    """Draw the clouds of points that curve skeletons from views are linked from."""
    pictures = []
    for shape in (medialis.organic_shape(160), _wheel()):
        cloud = medialis.run("view_curve_skeleton", shape).layers[1].points
        context = Surface(shape.points, shape.faces, opacity=0.12)
        points = Points(cloud, size=2, color=(0.1, 0.2, 0.5))
        pictures.append(draw([context, points], _view(shape.points)))
    return contact_sheet(pictures, columns=2)


FIGURES: dict[str, Callable[[], Image]] = {
    f"thesis_{make.__name__}": make
    for make in (
        figure_3_4, figure_3_7, figure_3_8, figure_3_9, figure_3_11, figure_3_12,
        figure_3_13, figure_3_15, figure_3_17, figure_3_18,
    )
} | LATER_FIGURES  # fmt: skip


def main(names: list[str]) -> None:
    """Make the named figures, or all."""
    FOLDER.mkdir(exist_ok=True)
    for name in names or FIGURES:
        path = FOLDER / f"{name}.png"
        write_png(path, FIGURES[name]())
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
