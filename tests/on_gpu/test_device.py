"""The same bits on a real GPU; skipped where there is none."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

import medialis
from medialis.base import gpu
from medialis.base.errors import GpuError


@pytest.fixture(scope="module", autouse=True)
def device():
    try:
        gpu.opened_gpu()
        gpu.kernel(gpu.kernel_names()[0])
    except GpuError as error:
        pytest.skip(f"no GPU here: {error}")


def ellipsoid() -> medialis.Shape:
    across = np.random.default_rng(0).normal(size=(50_000, 3))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return medialis.Shape(across * [3, 2, 1], across)


def on_both(work, *names: str) -> None:
    """Compare what the processor and the GPU find, and see that it was the GPU."""
    found = []
    for choice in ("cpu", "gpu"):
        medialis.forget()
        progress = medialis.Progress()
        with medialis.use_device(choice):
            found.append(work(progress))
        assert not [one for one in progress.messages if one.code == "gpu_not_used"]
    for name in names:
        mine, other = (getattr(one, name) for one in found)
        assert mine.tobytes() == other.tobytes(), name


@pytest.mark.parametrize("make", [medialis.organic_shape, ellipsoid, lambda: arch(100)])
def test_balls(make):
    shape = make()
    names = "centers", "radii", "features", "status"
    on_both(lambda p: medialis.shrink_balls(shape, tolerance=0.0, progress=p), *names)


def arch(resolution: int) -> medialis.Shape:
    return medialis.dental_arch(resolution=resolution)[0]


@pytest.mark.parametrize("make", [medialis.organic_shape, lambda: arch(100)])
def test_views(make):
    shape = make()
    names = "nodes", "edges", "radii"
    on_both(lambda p: medialis.view_curve_skeleton(shape, pairs=20, size=256, progress=p), *names)


def test_mean_shift():
    points = np.random.default_rng(0).random((20_000, 3))
    names = "centers", "labels", "seed_labels", "shares"
    on_both(lambda p: medialis.mean_shift(points, progress=p), *names)


SMALL = """
import numpy as np, medialis
shape = medialis.organic_shape(56)
with medialis.use_device("gpu"):
    medialis.shrink_balls(shape)
    medialis.view_curve_skeleton(shape, pairs=4, size=64)
    medialis.mean_shift(np.random.default_rng(0).random((500, 3)), search_radius=0.1)
"""


@pytest.mark.slow
def test_the_sanitizer_finds_nothing():
    if (tool := shutil.which("compute-sanitizer")) is None:
        pytest.skip("compute-sanitizer is not here")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [tool, "--error-exitcode", "9", sys.executable, "-c", SMALL]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
