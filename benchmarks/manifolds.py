"""Manifolds of noisy clouds and mean shift: ground truth, baselines, real shapes (thesis 4.2, 5.3).

python benchmarks/manifolds.py [MESH ...]

Needs scikit-learn for the comparison of mean shift (pip install scikit-learn). Times are processor
times of one process, best of three, compiled kernels.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import medialis

TESTS = Path(__file__).resolve().parent.parent / "tests"
sys.path[:0] = [str(TESTS)]
import clouds  # noqa: E402 - the generated clouds of the tests

NOISE = (0.0, 0.1, 0.2, 0.3, 0.4)


def best(work: Callable[[], Any], times: int = 3) -> tuple[Any, float]:
    """Return the result and the least processor time of some runs that find nothing kept."""
    result, seconds = work(), math.inf
    with medialis.memory_limit(0):
        for _ in range(times):
            clock = time.process_time()
            result = work()
            seconds = min(seconds, time.process_time() - clock)
    return result, seconds


def ground_truth() -> None:
    """Agreement with known manifolds, and how well noise is found."""
    made = {
        "planes 90": clouds.crossing_planes(90),
        "planes 45": clouds.crossing_planes(45),
        "planes 20": clouds.crossing_planes(20),
        "three planes": clouds.three_planes(),
        "sphere, plane": clouds.sphere_and_plane(),
        "spiral, plane": clouds.spiral_and_plane(),
        "parallel sheets": clouds.parallel_sheets(),
        "Moebius band": clouds.mobius_band(),
    }
    print(
        "\n| cloud | outliers | jitter | manifolds | adjusted Rand | judge | recall | precision |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, (points, truth) in made.items():
        for outliers, jitter in ((0, 0), (0.1, 0), (0.4, 0), (0, 0.005), (0.4, 0.005)):
            rough = clouds.jittered(points, jitter)
            found = medialis.manifolds(clouds.with_outliers(rough, outliers))
            labels = found.labels()
            index = clouds.adjusted_rand(truth, labels[: len(truth)])
            recall, precision = clouds.noise_scores(labels, len(truth))
            scores = f"{recall:.3f} | {precision:.3f}" if outliers else "- | -"
            print(
                f"| {name} | {100 * outliers:g} % | {100 * jitter:g} % | {found.count} | "
                f"{index:.3f} | {_judge(name, rough, truth)} | {scores} |"
            )


def _judge(name: str, points: np.ndarray, truth: np.ndarray) -> str:
    """Index of one who knows the two planes: what jitter leaves to be found."""
    if not name.startswith("planes"):
        return "-"
    angle = math.radians(float(name.split()[1]))
    normals = np.array([[0, 0, 1], [0, -math.sin(angle), math.cos(angle)]])
    return f"{clouds.adjusted_rand(truth, np.abs(points @ normals.T).argmin(axis=1)):.3f}"


def distances_of_outliers(points: np.ndarray) -> np.ndarray:
    """Mean distance to 50 neighbours: what statistical outlier removal thresholds."""
    return cKDTree(points).query(points, k=51)[0][:, 1:].mean(axis=1)


def figure_4_6(paths: list[str]) -> None:
    """Compare with statistical outlier removal, at its usual threshold and at our recall."""
    print("\n| noise | ours: good removed | recall | SOR: good removed | recall |", end="")
    print(" SOR at our recall: good removed | removed - added: ours | SOR |")
    print("|---|---|---|---|---|---|---|---|")
    shapes = [medialis.read_shape(path).points for path in paths] or [
        medialis.organic_shape(160).points,
        medialis.dental_arch(resolution=120)[0].points,
    ]
    for share in NOISE:
        rows = []
        for points in shapes:
            noisy, n = clouds.with_outliers(points, share), len(points)
            bad = np.arange(len(noisy)) >= n
            ours = medialis.manifolds(noisy, max_bend=18, max_turn=12)
            gone = ours.labels() < 0
            far = distances_of_outliers(noisy)
            usual = far > far.mean() + far.std()
            equal = far >= np.quantile(far[bad], 1 - gone[bad].mean()) if share else usual
            counts = [gone[~bad].mean(), gone[bad].mean() if share else np.nan]
            counts += [usual[~bad].mean(), usual[bad].mean() if share else np.nan]
            counts += [equal[~bad].mean(), (gone.sum() - bad.sum()) / n]
            rows.append([*counts, (usual.sum() - bad.sum()) / n])
        mean = 100 * np.array(rows).mean(axis=0)
        print(f"| {100 * share:g} % | " + " | ".join(f"{value:.1f} %" for value in mean) + " |")


def laser_rooms() -> None:
    """Faces of a room that a laser scanner sees, at several steps and errors."""
    print("\n| step | noise | points | faces | manifolds | adjusted Rand | noise found | seconds |")
    print("|---|---|---|---|---|---|---|---|")
    for step in (1.0, 0.5, 0.3):
        for noise in (0.0, 0.0025, 0.01):
            points, face = clouds.laser_room(step, noise)
            clock = time.process_time()
            labels = medialis.manifolds(points).labels()
            seconds = time.process_time() - clock
            print(
                f"| {step:g} degrees | {1000 * noise:g} mm | {len(points)} | {face.max() + 1} | "
                f"{labels.max() + 1} | {clouds.adjusted_rand(face, labels):.3f} | "
                f"{100 * (labels < 0).mean():.2f} % | {seconds:.1f} |"
            )


def clean_clouds(paths: list[str]) -> None:
    """Print what removing noise takes from clouds that have none."""
    print("\n| clean cloud | points | removed | manifolds |")
    print("|---|---|---|---|")
    made = clouds.clean_clouds()
    for path in paths:
        shape = medialis.read_shape(path)
        if shape.faces is None:
            made[Path(path).stem] = shape.points
    for name, points in made.items():
        result = medialis.run("remove_outliers", medialis.make_shape(points))
        removed = 100 * (1 - result.values["kept_points"] / len(points))
        print(f"| {name} | {len(points)} | {removed:.2f} % | {result.values['manifolds']} |")


def real_shapes(paths: list[str]) -> None:
    """Print counts and times as Tables 6 and 7 do."""
    print("\n| shape | points | manifolds | noise | intersections | seconds |", end="")
    print(" manifolds, wider angles | noise |")
    print("|---|---|---|---|---|---|---|---|")
    for path in paths:
        shape = medialis.read_shape(path)
        points, name = shape.points, Path(path).stem
        if shape.faces is not None:
            cloud = medialis.surface_skeleton(shape)
            points, name = cloud.centers[cloud.valid], f"{name} (medial)"
        found, seconds = best(lambda points=points: medialis.manifolds(points))
        wide = medialis.manifolds(points, max_bend=17.2, max_turn=11.5)
        kinds = np.bincount(found.point_class, minlength=3)
        print(
            f"| {name} | {len(points)} | {found.count} | {kinds[0]} "
            f"({100 * kinds[0] / len(points):.0f} %) | {kinds[2]} | {seconds:.2f} | "
            f"{wide.count} | {100 * (wide.point_class == 0).mean():.0f} % |"
        )
    print("\n| shape | balls | segments | segments, last 20 steps | seconds | last 20 steps |")
    print("|---|---|---|---|---|---|")
    for path in paths:
        shape = medialis.read_shape(path)
        if shape.faces is None:
            continue
        cloud = medialis.surface_skeleton(shape)
        whole, a = best(lambda c=cloud: medialis.mean_shift_segments(c))
        last, b = best(lambda c=cloud: medialis.mean_shift_segments(c, last_steps=20))
        balls = int(cloud.valid.sum())
        name = Path(path).stem
        print(f"| {name} | {balls} | {whole.count} | {last.count} | {a:.2f} | {b:.2f} |")


def dental() -> None:
    """Teeth found on generated arches."""
    print("\n| arch | automatic: on the teeth | one pick a tooth: everywhere | segments |")
    print("|---|---|---|---|")
    for count in (12, 14, 16):
        shape, teeth = medialis.dental_arch(count, rng=count)
        cloud = medialis.surface_skeleton(shape)
        on, bumps = teeth >= 0, {"seeds": "bumps", "last_steps": 20, "fill": False}
        found = medialis.mean_shift_segments(cloud, **bumps).labels
        tips = [
            int(np.flatnonzero(teeth == t)[shape.points[teeth == t, 2].argmax()])
            for t in range(count)
        ]
        picks = {"seeds": "none", "add": tips, "fill": False}
        picked = medialis.mean_shift_segments(cloud, search_radius=0.04, **picks)
        print(
            f"| {count} teeth | {clouds.adjusted_rand(teeth[on], found[on]):.3f} | "
            f"{clouds.adjusted_rand(teeth, picked.labels):.3f} | {picked.count} |"
        )


def against_scikit_learn() -> None:
    """Equal kernel, bandwidth and seeds: the same clusters, and how much faster."""
    try:
        from sklearn.cluster import MeanShift
    except ImportError:
        print("\nscikit-learn is not installed: no comparison of mean shift.")
        return
    print("\n| points | seeds | same clusters | scikit-learn s | ours s | ratio |")
    print("|---|---|---|---|---|---|")
    rng = np.random.default_rng(0)
    for a_blob, step in ((50, 1), (100, 1), (2000, 40)):
        centers = rng.uniform(0, 20, (10, 1, 3))
        points = (rng.normal(size=(10, a_blob, 3)) + centers).reshape(-1, 3)
        seeds = points[::step]
        share = {"search_radius": 2.0 / medialis.Surface(points).diagonal, "kernel": "flat"}
        ours, quick = best(lambda p=points, s=seeds, o=share: medialis.mean_shift(p, seeds=s, **o))
        theirs, slow = best(lambda p=points, s=seeds: MeanShift(bandwidth=2.0, seeds=s).fit(p), 1)
        nearest = cKDTree(ours.centers).query(points)[1]
        same = clouds.adjusted_rand(theirs.labels_, nearest)
        print(
            f"| {len(points)} | {len(seeds)} | {len(ours.centers)} and "
            f"{len(theirs.cluster_centers_)}, adjusted Rand {same:.3f} | {slow:.3f} | "
            f"{quick:.3f} | {slow / quick:.0f} |"
        )


def main(paths: list[str]) -> None:
    """Print all tables."""
    ground_truth()
    laser_rooms()
    clean_clouds(paths)
    figure_4_6([path for path in paths if medialis.read_shape(path).faces is not None])
    real_shapes(paths)
    dental()
    against_scikit_learn()


if __name__ == "__main__":
    main(sys.argv[1:])
