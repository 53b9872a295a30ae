"""Parts against people's segmentations, and of copies of the same shape.

python benchmarks/parts.py [people] [copies] [left_out] [--method auto] [--only ant cup horse]

people: 1 - Rand index against each person, in the mean over people, models and classes (76 models
of the benchmark of Chen, Golovinskiy and Funkhouser, in ../shared/segmentation, which is left out
where it is absent). copies: adjusted Rand index of the parts of turned, split, decimated and noisy
copies with those of the shape, on its vertices. left_out: the weights of segments/sites.py chosen
anew, from all classes and three times from two thirds of them, and 1 - Rand of the others; always
with the generated bodies of known_bodies.py, and so that copies of the last model of each class
that is not left out have the same sums. Seconds are processor time.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import medialis
from medialis.base.progress import Progress
from medialis.segments.parts import PartsOptions, SeenSites, as_seen
from medialis.segments.sites import Sites, all_placements, mean_quantities
from medialis.skeleton.surface_skeleton import balls_of

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
sys.path[:0] = [str(ROOT / "tests")]
SCANS = ("hand", "horse", "cow", "armadillo", "elephant", "fertility", "bunny", "screwdriver")
TURNS, NOISE = 3, 0.002
DRAWN, RIDGE, SAME = 4000, 1e-4, 1.0

Divide = Callable[[medialis.Shape], tuple[np.ndarray, np.ndarray]]
"""Labels of the vertices and of the faces of a shape."""


def by_method(method: str) -> Divide:
    """Return the division that hosts get."""

    def divide(shape: medialis.Shape) -> tuple[np.ndarray, np.ndarray]:
        layer = medialis.run("parts", shape, method=method).layers[0]
        return layer.attributes["parts"], layer.face_attributes["face_parts"]

    return divide


def rand_distance(labels: np.ndarray, person: np.ndarray) -> float:
    """Return 1 - Rand index of two partitions of faces: 0 for the same."""
    both = _counts(labels, person)
    pairs = len(labels) * (len(labels) - 1) / 2
    one, two = both.sum(axis=1), both.sum(axis=0)
    return float(((one**2).sum() / 2 + (two**2).sum() / 2 - (both**2).sum()) / pairs)


def adjusted_rand(labels: np.ndarray, others: np.ndarray) -> float:
    """Return the adjusted Rand index of two partitions: 1 for the same, 0 for chance."""
    both = _counts(labels, others)
    pairs = [(x * (x - 1) / 2).sum() for x in (both, both.sum(axis=1), both.sum(axis=0))]
    chance = pairs[1] * pairs[2] / (len(labels) * (len(labels) - 1) / 2)
    most = (pairs[1] + pairs[2]) / 2
    return 1.0 if most == chance else float((pairs[0] - chance) / (most - chance))


def _counts(labels: np.ndarray, others: np.ndarray) -> np.ndarray:
    one, two = (np.unique(x, return_inverse=True)[1].reshape(-1) for x in (labels, others))
    both = np.zeros((one.max() + 1, two.max() + 1))
    np.add.at(both, (one, two), 1)
    return both


def people(divide: Divide, wanted: list[str]) -> None:
    """Print 1 - Rand of each class."""
    folder = SHARED / "segmentation"
    if not folder.is_dir():
        print(f"{folder} is absent: people's segmentations are left out.")
        return
    scores: dict[str, list[float]] = {}
    seconds = []
    for path in sorted(folder.glob("*.ply")):
        name = path.stem.rsplit("_", 1)[0]
        if wanted and name not in wanted and path.stem not in wanted:
            continue
        shape, truth = medialis.read_shape(path), np.load(path.with_suffix(".npz"))["people"]
        clock = time.process_time()
        labels = divide(shape)[1]
        seconds.append(time.process_time() - clock)
        truth = truth if shape.face_count == truth.shape[1] else truth[:, shape.face_map]
        score = float(np.mean([rand_distance(labels, person) for person in truth]))
        scores.setdefault(name, []).append(score)
        parts = len(np.unique(labels))
        print(f"{path.stem} {score:.3f} {parts} parts {seconds[-1]:.2f} s", flush=True)
    for name, values in scores.items():
        print(f"{name:10s} {np.mean(values):.3f}")
    every = [score for values in scores.values() for score in values]
    print(f"mean {np.mean(every):.4f}; worst class {max(np.mean(v) for v in scores.values()):.3f}")
    print(f"seconds: median {np.median(seconds):.2f}, worst {max(seconds):.2f}")


class Pairs(NamedTuple):
    """What the weights are chosen by, of one model."""

    sites: Sites
    quantities: np.ndarray
    drawn: np.ndarray
    together: np.ndarray
    surface: medialis.Shape
    people: np.ndarray
    steps: list[np.ndarray]
    """How much the quantities of pairs of vertices differ in copies."""


def left_out(divide: Divide, wanted: list[str]) -> None:
    """Choose the weights by all classes, and by two thirds three times; print what they give."""
    from known_bodies import known_bodies

    models: dict[str, Pairs] = {}
    paths = sorted((SHARED / "segmentation").glob("*.ply"))
    last = {path.stem.rsplit("_", 1)[0]: path.stem for path in paths}
    for path in paths:
        if not wanted or path.stem.rsplit("_", 1)[0] in wanted:
            shape, truth = medialis.read_shape(path), np.load(path.with_suffix(".npz"))["people"]
            truth = truth if shape.face_count == truth.shape[1] else truth[:, shape.face_map]
            models[path.stem] = pairs_of(shape, truth, path.stem in last.values())
    known = {name: pairs_of(shape, part[None]) for name, shape, part in known_bodies()}
    classes = sorted({name.rsplit("_", 1)[0] for name in models})
    fitted, weights = scores_of(models | known, models)
    print("OFFSET =", weights[0], "WEIGHTS =", tuple(weights[1:].tolist()))
    left: dict[str, float] = {}
    for third in range(3):
        out = {name for name in models if name.rsplit("_", 1)[0] in classes[third::3]}
        rest = {name: models[name] for name in models if name not in out}
        left |= scores_of(rest | known, {name: models[name] for name in out})[0]
    for name in classes:
        own = [model for model in models if model.rsplit("_", 1)[0] == name]
        print(name, *(f"{np.mean([s[m] for m in own]):.3f}" for s in (fitted, left)))
    print("mean", *(f"{np.mean(list(s.values())):.4f}" for s in (fitted, left)), flush=True)


def measured(shape: medialis.Shape) -> tuple[Sites, np.ndarray, medialis.Shape]:
    """Return the sites of a shape, the quantities of their pairs, and its refined surface."""
    options = PartsOptions().with_auto_resolved(shape, Progress())
    cloud = balls_of(shape, options, Progress()).inner.own
    placed = all_placements(cloud)
    area = cloud.surface.point_areas / cloud.surface.area
    quantities = np.stack(mean_quantities(placed, area)).astype(np.float32)
    return placed[0], quantities, cloud.surface


def pairs_of(shape: medialis.Shape, people: np.ndarray, copied: bool = False) -> Pairs:
    """Draw pairs of faces of one model, with the share of people who put them together."""
    sites, quantities, surface = measured(shape)
    assert shape.faces is not None
    nearest = nearest_sites(sites)
    rng = np.random.default_rng(0)
    one, two = rng.integers(0, shape.face_count, (2, DRAWN))
    together = (people[:, one] == people[:, two]).mean(axis=0)
    first = nearest[shape.faces[:, 0]]
    drawn = quantities[:, first[one], first[two]].T.astype(float)
    one, two = rng.integers(0, shape.point_count, (2, DRAWN))
    own = quantities[:, nearest[one], nearest[two]].T.astype(float)
    steps = []
    for copy in copies_of(shape) if copied else ():
        others, values, _ = measured(copy)
        rows = cKDTree(copy.points).query(shape.points)[1]
        if copy.point_count >= shape.point_count:  # its vertices come first
            rows = np.arange(shape.point_count)
        site = nearest_sites(others)[rows]
        steps.append(values[:, site[one], site[two]].T.astype(float) - own)
    return Pairs(sites, quantities, drawn, together, surface, people, steps)


def nearest_sites(sites: Sites) -> np.ndarray:
    """Return the site with the largest share in each sample."""
    return np.asarray(sites.shares.argmax(axis=1)).reshape(-1)


def copies_of(shape: medialis.Shape) -> list[medialis.Shape]:
    """Return copies that should have the same parts."""
    made = [turn(shape, 0), turn(shape, 1), split(shape), decimated(shape), noisy(shape)]
    return [copy for copy in made if copy is not None]


def scores_of(chosen: dict[str, Pairs], scored: dict[str, Pairs]) -> tuple[dict, np.ndarray]:
    """Return 1 - Rand of models with weights chosen by others, and the weights."""
    weights = choose_weights(
        np.concatenate([model.drawn for model in chosen.values()]),
        np.concatenate([model.together for model in chosen.values()]),
        [step for model in chosen.values() for step in model.steps],
    )
    scores = {}
    for name, model in scored.items():
        sites = model.sites
        total = weights[0] + np.tensordot(weights[1:], model.quantities.astype(float), 1)
        shares = 1 / (1 + np.exp(-np.clip(total, -50, 50)))
        shares = (shares + shares.T) / 2
        shares[sites.components[:, None] != sites.components[None, :]] = 0
        found = as_seen(model.surface, SeenSites(sites, shares), PartsOptions(), Progress())
        labels = found.of_input_faces()
        scores[name] = float(np.mean([rand_distance(labels, person) for person in model.people]))
    return scores, weights


def choose_weights(drawn: np.ndarray, together: np.ndarray, steps: list[np.ndarray]) -> np.ndarray:
    """Return the weights of a logistic regression, the offset first.

    The mean square of what copies change in the sum counts as well, `SAME` / 2 of it.
    """
    middle, spread = drawn.mean(axis=0), drawn.std(axis=0)
    known = np.concatenate([np.ones((len(drawn), 1)), (drawn - middle) / spread], axis=1)
    change = np.zeros((known.shape[1], known.shape[1]))
    for step in steps:
        change[1:, 1:] += (step / spread).T @ (step / spread) / len(step) / len(steps)

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        total = known @ weights
        cost = np.logaddexp(0, total) - together * total
        slope = known.T @ (1 / (1 + np.exp(-total)) - together) / len(known)
        inner, moved = np.concatenate([[0.0], weights[1:]]), SAME * change @ weights
        value = float(cost.mean() + RIDGE / 2 * inner @ inner + weights @ moved / 2)
        return value, slope + RIDGE * inner + moved

    found = minimize(loss, np.zeros(known.shape[1]), jac=True, method="L-BFGS-B").x
    weights = found[1:] / spread
    return np.concatenate([[found[0] - weights @ middle], weights])


def shapes(wanted: list[str]) -> Iterator[tuple[str, medialis.Shape]]:
    """Yield the twelve shapes of docs/parts.md; those of ../shared where it is there."""
    from closed_forms import dumbbell
    from tubes import AXES, FORK, hub

    made = {
        "dumbbell": lambda: dumbbell(step=0.04),
        "creature": lambda: medialis.organic_shape(96),
        "jack": lambda: hub(AXES, 0.04, ball=0.6)[0],
        "fork": lambda: hub(FORK, 0.04, ball=0.25)[0],
    }
    for name in (*SCANS, *made):
        path = SHARED / "shapes" / f"{name}.ply"
        if (not wanted or name in wanted) and (name in made or path.is_file()):
            yield name, made[name]() if name in made else medialis.read_shape(path)


def copies(divide: Divide, wanted: list[str]) -> None:
    """Print the adjusted Rand index of each copy."""
    print("shape parts turned split decimated noisy")
    worst = np.ones(4)
    for name, shape in shapes(wanted):
        labels = divide(shape)[0]
        turned = min(adjusted_rand(labels, divide(turn(shape, i))[0]) for i in range(TURNS))
        quarters = divide(split(shape))[0][: shape.point_count]
        scores = [turned, adjusted_rand(labels, quarters)]
        half = decimated(shape)
        scores.append(
            np.nan if half is None else adjusted_rand(labels, carried(divide, half, shape))
        )
        scores.append(adjusted_rand(labels, divide(noisy(shape))[0]))
        worst = np.fmin(worst, scores)
        print(name, len(np.unique(labels)), *(f"{s:.3f}" for s in scores), flush=True)
    print("worst", *(f"{s:.3f}" for s in worst))


def turn(shape: medialis.Shape, seed: int) -> medialis.Shape:
    """Return a copy turned at random."""
    rotation = Rotation.random(random_state=seed + 1).as_matrix()
    return medialis.make_shape(shape.points @ rotation.T, shape.faces)


def split(shape: medialis.Shape) -> medialis.Shape:
    """Split each triangle into four; the vertices of the shape come first."""
    assert shape.faces is not None
    middle = shape.points[shape.edges].mean(axis=1)
    number = {}
    for k, (a, b) in enumerate(shape.edges.tolist()):
        number[a, b] = number[b, a] = shape.point_count + k
    faces = []
    for a, b, c in shape.faces.tolist():
        ab, bc, ca = number[a, b], number[b, c], number[c, a]
        faces += [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return medialis.make_shape(np.concatenate([shape.points, middle]), faces)


def decimated(shape: medialis.Shape) -> medialis.Shape | None:
    """Collapse edges until half of the faces are left; None without pymeshlab."""
    try:
        import pymeshlab
    except ImportError:
        return None
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(shape.points, shape.faces))
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=shape.face_count // 2)
    mesh = meshes.current_mesh()
    return medialis.make_shape(mesh.vertex_matrix(), mesh.face_matrix())


def noisy(shape: medialis.Shape) -> medialis.Shape:
    """Move each vertex by normal noise with a deviation of 0.2 % of the size along its normal."""
    offsets = np.random.default_rng(0).normal(0, NOISE * shape.diagonal, shape.point_count)
    return medialis.make_shape(shape.points + offsets[:, None] * shape.normals, shape.faces)


def carried(divide: Divide, copy: medialis.Shape, shape: medialis.Shape) -> np.ndarray:
    """Return the parts of a copy at the nearest vertices of a shape."""
    return divide(copy)[0][cKDTree(copy.points).query(shape.points)[1]]


def main() -> None:
    """Print the tables asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("tables", nargs="*", default=["people", "copies"])
    parser.add_argument("--method", default="auto")
    parser.add_argument("--only", nargs="*", default=[])
    given = parser.parse_args()
    divide = by_method(given.method)
    for table in given.tables:
        {"people": people, "copies": copies, "left_out": left_out}[table](divide, given.only)


if __name__ == "__main__":
    main()
