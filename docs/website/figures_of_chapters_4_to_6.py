"""Our figures for those of thesis chapters 4 to 6 that no page of an operation has already."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from make_pictures import Image, _dented_plate
from numpy.typing import ArrayLike, NDArray

import medialis
from medialis.show.annotation import contact_sheet
from medialis.show.camera import Camera
from medialis.show.picture import Curves, Points, Surface, draw, draw_result

SIZE = {"width": 420, "height": 340}
GREY = (0.75, 0.75, 0.78)


def _cloud(points: ArrayLike) -> medialis.Shape:
    points = np.asarray(points, np.float64)
    return medialis.Shape(points, np.zeros_like(points))


def _curved_pair(rng: np.random.Generator) -> NDArray[np.float64]:
    """Make two curved sheets that cross."""
    x, y = rng.uniform(-1, 1, (2, 8000))
    first, second = np.stack([x, y, 0.4 * x * x - 0.2], axis=1)[:4000], slice(4000, None)
    return np.concatenate([first, np.stack([x, 0.4 * y * y - 0.2, y], axis=1)[second]])


def _rolled_sheets(rng: np.random.Generator) -> NDArray[np.float64]:
    """Make four sheets that roll round each other and do not touch."""
    turn, height = rng.uniform(0.5, 2.0, 16000), rng.uniform(-1, 1, 16000)
    angle = np.pi * (turn + np.repeat(np.arange(4), 4000) / 2)
    return np.stack([turn * np.cos(angle), turn * np.sin(angle), height], axis=1)


def _spiral_and_plane(rng: np.random.Generator) -> NDArray[np.float64]:
    """Make a densely sampled roll, cut by a sparsely sampled plane."""
    turn, height = rng.uniform(1.0, 2.5, 14000), rng.uniform(-1, 1, 14000)
    angle = 2 * np.pi * turn
    roll = np.stack([turn * np.cos(angle), turn * np.sin(angle), height], axis=1)
    flat = np.stack([*rng.uniform(-2.5, 2.5, (2, 5000)), np.zeros(5000)], axis=1)
    return np.concatenate([roll, flat])


def figure_4_4() -> Image:
    """Draw three clouds by manifold, and below the largest manifold of each."""
    rng = np.random.default_rng(0)
    above, below, captions = [], [], []
    for make in (_curved_pair, _rolled_sheets, _spiral_and_plane):
        found = medialis.run("manifolds", _cloud(make(rng)), max_bend=12.0)
        points, labels = found.layers[0].points, found.layers[0].attributes["manifold"]
        camera = Camera.framing(points, **SIZE)
        above.append(draw([Points(points, size=2.5, labels=labels)], camera))
        one = np.where(labels == np.bincount(labels[labels >= 0]).argmax())[0]
        below.append(draw([Points(points[one], size=2.5, labels=labels[one])], camera))
        captions.append(f"{found.values['manifolds']} manifolds")
    return contact_sheet([*above, *below], [*captions, *["the largest one"] * 3], 3)


def _with_outliers(shape: medialis.Shape, share: float) -> NDArray[np.float64]:
    """Add outliers up to 40 % of the size away from points, as thesis 4.2.4.2 does."""
    rng = np.random.default_rng(0)
    base = shape.points[rng.choice(shape.point_count, int(share * shape.point_count))]
    step = rng.normal(size=base.shape)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    far = 0.4 * shape.diagonal * rng.random((len(base), 1))
    return np.concatenate([shape.points, base + far * step])


def _without_statistical_outliers(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Keep points whose mean distance to 50 neighbours is within one deviation of the mean."""
    from scipy.spatial import cKDTree

    distance = cKDTree(points).query(points, k=51)[0][:, 1:].mean(axis=1)
    return points[distance <= distance.mean() + distance.std()]


def figure_4_5() -> Image:
    """Draw noisy clouds, and what statistical outlier removal and our method leave of them."""
    rows = []
    for shape in (medialis.organic_shape(160), _dented_plate()):
        noisy = _with_outliers(shape, 0.4)
        kept = medialis.run("remove_outliers", _cloud(noisy)).layers[0].points
        camera = Camera.framing(shape.points, **SIZE)
        clouds = (noisy, _without_statistical_outliers(noisy), kept)
        rows += [draw([Points(points, size=2)], camera) for points in clouds]
    return contact_sheet(rows, ["40 % outliers", "SOR", "ours"] * 2, 3)


def figure_4_6() -> Image:
    """Draw the points removed in excess of the outliers over the share of outliers."""
    shapes = (
        medialis.organic_shape(100),
        _dented_plate(),
        medialis.dental_arch(12, resolution=110)[0],
    )
    shares = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
    excess = np.zeros((2, len(shares)))
    for shape in shapes:
        for column, share in enumerate(shares):
            noisy = _with_outliers(shape, share)
            ours = medialis.run("remove_outliers", _cloud(noisy)).values["kept_points"]
            left = np.array([ours, len(_without_statistical_outliers(noisy))])
            excess[:, column] += (shape.point_count - left) / shape.point_count / len(shapes)
    nodes = [(8 * x, 8 * y, 0.0) for row in excess for x, y in zip(shares, row, strict=True)]
    edges = [(i, i + 1) for i in range(2 * len(shares) - 1) if i != len(shares) - 1]
    method = np.repeat([0, 1], len(shares))
    heights = np.arange(np.floor(10 * excess.min()), np.ceil(10 * excess.max()) + 1) / 10
    grid = [(8 * x, 8 * height, -0.1) for height in heights for x in (shares[0], shares[-1])]
    items = [
        Curves(nodes, edges, width=5, labels=method),
        Points(nodes, size=11, labels=method),
        Curves(grid, [(2 * k, 2 * k + 1) for k in range(len(heights))], width=1.5, color=GREY),
        Curves(
            [(0, 0, -0.05), (8 * shares[-1], 0, -0.05)], [(0, 1)], width=3, color=(0.4, 0.4, 0.4)
        ),
    ]
    camera = Camera.framing(grid, direction=(0, 0, 1), up=(0, 1, 0), width=900, height=560)
    title = "points removed in excess, lines 10 % apart, dark: 0 %; outliers from 0 to 40 %"
    return draw(items, camera, title=title, legend="method", label_names=["ours", "SOR"])


def figure_4_11() -> Image:
    """Draw the manifolds of a skeleton at three values of each angle."""
    shape = medialis.organic_shape(160)
    pictures, captions = [], []
    for turn in (3.0, 5.7, 12.0):
        for bend in (4.0, 8.6, 18.0):
            found = medialis.run("manifolds", shape, cloud="skeleton", max_bend=bend, max_turn=turn)
            pictures.append(draw_result(found, **SIZE))
            count = found.values["manifolds"]
            captions.append(f"bend {bend:g}, turn {turn:g} degrees: {count} manifolds")
    return contact_sheet(pictures, captions, 3)


def _arch_view(points: NDArray[np.float64]) -> Camera:
    return Camera.framing(points, **SIZE, direction=(0.2, 0.8, 1.0), up=(0, 0, 1))


def figure_5_3() -> Image:
    """Draw a cast, its skeleton, the regularized skeleton, and the segments."""
    shape, _ = medialis.dental_arch(resolution=150)
    camera = _arch_view(shape.points)
    cloud = medialis.surface_skeleton(shape)
    good = cloud.subset(cloud.valid)
    kept = medialis.run("skeleton_importance", shape, threshold=0.02).layers[0]
    found = medialis.mean_shift_segments(cloud, seeds="bumps", last_steps=20, fill=False)
    items = [
        Surface(shape.points, shape.faces),
        Points(good.centers, size=2, values=good.radii),
        Points(kept.points, size=2, values=kept.attributes["importance"]),
        Surface(shape.points, shape.faces, labels=found.labels),
    ]
    captions = ["input", "surface skeleton", "importance from 2 %", "segments on the surface"]
    return contact_sheet([draw([item], camera) for item in items], captions, 2)


def figure_5_4() -> Image:
    """Draw seeds, where they converge, and the clusters, on the skeleton of a cast."""
    shape, _ = medialis.dental_arch(resolution=150)
    camera = _arch_view(shape.points)
    cloud = medialis.surface_skeleton(shape)
    balls = cloud.centers[cloud.valid & (cloud.spoke_angles > 1.0)]
    seeds = balls[:: max(1, len(balls) // 400)]
    found = medialis.mean_shift(balls, seeds=seeds, search_radius=0.05)
    pale = Points(balls, size=1.5, color=(0.8, 0.82, 0.86))
    pictures = [
        draw([pale, Points(seeds, size=5, color=(0.05, 0.05, 0.05))], camera),
        draw([pale, Points(found.centers, size=9, color=(0.8, 0.1, 0.1))], camera),
        draw([Points(balls, size=2, labels=found.labels)], camera),
    ]
    captions = [f"{len(seeds)} seeds", f"{len(found.centers)} convergence points", "clusters"]
    return contact_sheet(pictures, captions, 3)


def figure_6_3() -> Image:
    """Draw the skeleton of a rounded shape with its rim marked, and without it."""
    ellipsoid = _ellipsoid()
    marked, filtered = (
        medialis.run("point_types", ellipsoid, filter_rim=rim) for rim in (False, True)
    )
    types = marked.layers[0].attributes["type"]
    red = np.where((types == 1)[:, None], (0.8, 0.1, 0.1), (0.5, 0.55, 0.62))
    camera = Camera.framing(ellipsoid.points, **SIZE)
    context = Surface(ellipsoid.points, ellipsoid.faces, opacity=0.12)
    pictures = [
        draw([context, Points(marked.layers[0].points, size=2.5, color=red)], camera),
        draw([context, Points(filtered.layers[0].points, size=2.5)], camera),
    ]
    return contact_sheet(pictures, ["points of type A3 in red", "without them"], 2)


def _ellipsoid() -> medialis.Shape:
    """Make a closed mesh of an ellipsoid with half axes 1, 0.7 and 0.3."""
    from scipy.spatial import ConvexHull

    index = np.arange(12000) + 0.5
    z, turn = 1 - 2 * index / 12000, np.pi * (3 - np.sqrt(5)) * index
    level = np.sqrt(1 - z * z)
    ball = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
    faces = ConvexHull(ball).simplices
    return medialis.make_shape(ball * [1.0, 0.7, 0.3], faces, repair=True)


def figure_6_5() -> Image:
    """Draw sheets by the method of chapter 4 at two settings, and by that of chapter 6."""
    shape = medialis.organic_shape(200)
    results = [
        medialis.run("manifolds", shape, cloud="skeleton", max_bend=15.0, neighbours=count)
        for count in (7, 14)
    ]
    sheets = medialis.run("medial_sheets", shape)
    captions = [
        *(f"chapter 4, {n} neighbours: {r.values['manifolds']}"
          for n, r in zip((7, 14), results, strict=True)),
        f"chapter 6: {sheets.values['sheets']} sheets",
    ]  # fmt: skip
    return contact_sheet([draw_result(r, **SIZE) for r in (*results, sheets)], captions, 3)


LATER_FIGURES: dict[str, Callable[[], Image]] = {
    f"thesis_{make.__name__}": make
    for make in (
        figure_4_4,
        figure_4_5,
        figure_4_6,
        figure_4_11,
        figure_5_3,
        figure_5_4,
        figure_6_3,
        figure_6_5,
    )
}
