"""Estimated normals of clouds: directions from the neighbours, signs outward."""

import math
import threading

import numpy as np
import pytest

import closed_forms as forms
from medialis.base.errors import Cancelled, InvalidOptionError, InvalidShapeError
from medialis.base.progress import Progress
from medialis.base.threads import thread_limit
from medialis.shape.normals import estimate_normals


def cosines(shape, **options):
    return np.einsum("ij,ij->i", estimate_normals(shape.points, **options), shape.normals)


@pytest.mark.parametrize(
    ("form", "curvature"),
    [
        (forms.sphere(2000), 1.0),
        (forms.sphere(3000, seed=2), 1.0),
        (forms.torus(), 1 / 0.3),
        (forms.capsule(5000), 1 / 0.4),
        (forms.ellipsoid(3000, (1.0, 0.9, 0.7)), 1 / 0.49),
    ],
    ids=["sphere", "random sphere", "torus", "capsule", "ellipsoid"],
)
def test_smooth_clouds_look_outward(form, curvature):
    """All signs are right; the neighbourhood of radius R has a sagitta of k R^2/2.

    So the plane of least variance tilts by about k R/2 at most where samples are evenly spread, k R
    where they lie on one side of the sample.
    """
    shape, progress = form.shape, Progress()
    cosine = cosines(shape, progress=progress)
    assert cosine.min() > 0
    assert progress.messages == []
    from scipy.spatial import cKDTree

    reach = cKDTree(shape.points).query(shape.points, k=13)[0][:, -1]
    assert (cosine >= np.cos(np.minimum(curvature * reach, math.pi / 2))).all()


def test_two_separate_spheres_both_look_outward():
    sphere = forms.sphere(1000).shape
    points = np.concatenate([sphere.points, 0.5 * sphere.points + [9, 0, 0]])
    normals = estimate_normals(points)
    assert (np.einsum("ij,ij->i", normals, np.tile(sphere.normals, (2, 1))) > 0.9).all()


def test_sphere_inside_a_sphere_looks_outward_as_well():
    """Each part is closed on its own; that the inner one bounds a hole is not known from points."""
    sphere = forms.sphere(3000).shape
    normals = estimate_normals(np.concatenate([sphere.points, 0.4 * sphere.points]))
    assert (np.einsum("ij,ij->i", normals, np.tile(sphere.normals, (2, 1))) > 0.9).all()


def test_box_cloud():
    """Only samples within a neighbourhood of an edge see two faces."""
    shape = forms.box_samples(spacing=0.03).shape
    cosine = cosines(shape)
    assert (cosine > 0).mean() >= 0.99
    gap = np.sort(shape.points.max(axis=0) - np.abs(shape.points), axis=1)[:, 1]
    assert cosine[gap > 0.1].min() > 1 - 1e-12


def test_flat_sheet_gives_the_warning(caplog):
    x, y = np.random.default_rng(0).uniform(size=(2, 500))
    progress = Progress()
    normals = estimate_normals(np.stack([x, y, 0 * x], axis=1), progress=progress)
    assert np.abs(normals[:, 2]) == pytest.approx(1, abs=1e-12)
    assert len(set(np.sign(normals[:, 2]))) == 1
    (told,) = progress.messages
    assert told.code == "outside_uncertain" and told.data == {"parts": 1, "of": 1}
    assert caplog.records[0].levelname == "WARNING"


def test_half_sphere_looks_outward_on_its_own_account():
    """Its extreme points vote as those of the whole sphere: right, so no warning is needed."""
    sphere = forms.sphere(3000).shape
    half = sphere.points[:, 2] > 0
    normals = estimate_normals(sphere.points[half])
    assert (np.einsum("ij,ij->i", normals, sphere.normals[half]) > 0).all()


def test_shallow_cap_gives_the_warning():
    sphere = forms.sphere(20000).shape
    cap = sphere.points[sphere.points[:, 2] > 0.97]
    progress = Progress()
    estimate_normals(cap, progress=progress)
    assert progress.messages[0].code == "outside_uncertain"


@pytest.mark.parametrize("scale", [1e-200, 1e-6, 1e6, 1e150])
def test_scale_does_not_matter(scale):
    """Distances were squared in the caller's units: at 1e-200 all neighbours were at 0 (fixed)."""
    shape = forms.sphere(1000, radius=2.0**-3).shape
    expected = estimate_normals(shape.points)
    # Equidistant neighbours may be chosen differently: directions agree to the tilt they allow.
    assert np.einsum("ij,ij->i", estimate_normals(shape.points * scale), expected).min() > 0.99


def test_one_and_two_threads_give_the_same_bits():
    points = forms.sphere(2000, seed=1).shape.points
    with thread_limit(1):
        one = estimate_normals(points)
    with thread_limit(2):
        two = estimate_normals(points)
    assert one.tobytes() == two.tobytes()


def test_result_is_unit_and_inputs_stay_unchanged():
    points = np.random.default_rng(0).normal(size=(300, 3))
    before = points.copy()
    normals = estimate_normals(points, neighbours=3)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1, abs=1e-14)
    assert (points == before).all() and not normals.flags.writeable


def test_fewest_points():
    tetrahedron = forms.unit(np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float))
    assert np.isfinite(estimate_normals(tetrahedron)).all()


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((9, 3)),
        np.eye(3),
        np.outer(np.arange(50), [1.0, 2, 3]),
        np.outer(np.arange(50), [1.0, 2, 3]) + 1e3,
        np.repeat(np.eye(3), 20, axis=0),
    ],
    ids=["one place", "three", "line", "far line", "three places"],
)
def test_too_few_points_or_one_line(points):
    """Three places with many points each came through as a plane (fixed)."""
    with pytest.raises(InvalidShapeError, match="at least 4 different points"):
        estimate_normals(points)


@pytest.mark.parametrize("neighbours", [2, 101, 3.5, "12", None])
def test_bad_neighbours(neighbours):
    with pytest.raises(InvalidOptionError, match="neighbours"):
        estimate_normals(forms.sphere(50).shape.points, neighbours=neighbours)


def test_cancelling():
    with pytest.raises(Cancelled):
        estimate_normals(forms.sphere(50).shape.points, progress=lambda f, text: f < 0.5)


def test_cancel_while_neighbours_are_searched(monkeypatch):
    """The search was one call with threads of its own: Ctrl-C in it ended in a crash."""
    monkeypatch.setattr("medialis.base.threads.QUERIES_A_CHUNK", 100)
    seen = []

    def cancel(fraction, text):
        seen.append((fraction, text))
        return fraction == 0

    before = threading.active_count()
    with thread_limit(1), pytest.raises(Cancelled):
        estimate_normals(forms.sphere(2000).shape.points, progress=cancel)
    assert seen[-1][1] == "neighbours" and 0 < seen[-1][0] < 0.4
    assert threading.active_count() == before


def test_normals_face_their_viewpoints():
    """A room is seen from inside: its normals point inward, where the extreme points say outward.

    Both sides of a wall between two scanners are seen, each by its own.
    """
    box = forms.box_samples(spacing=0.05).shape
    progress = Progress()
    normals = estimate_normals(box.points, viewpoints=[0.05, 0.02, 0.01], progress=progress)
    gap = np.sort(box.points.max(axis=0) - np.abs(box.points), axis=1)[:, 1]
    assert (np.einsum("ij,ij->i", normals, box.normals)[gap > 0.1] < -0.99).all()
    assert [m.code for m in progress.messages] == ["normals_face_viewpoints"]
    sphere = forms.sphere(2000).shape
    two = np.concatenate([sphere.points, sphere.points + np.array([5.0, 0, 0])])
    seen = np.repeat([[0.0, 0, 0], [9e9, 0, 0]], 2000, axis=0)
    seen[2000:] = two[2000:] + 7 * sphere.normals
    normals = estimate_normals(two, viewpoints=seen)
    signs = np.einsum("ij,ij->i", normals, np.tile(sphere.normals, (2, 1)))
    assert (signs[:2000] < -0.9).all() and (signs[2000:] > 0.9).all()


def test_unknown_viewpoints_change_nothing():
    points = forms.sphere(500).shape.points
    unknown = np.full_like(points, np.nan)
    assert (estimate_normals(points, viewpoints=unknown) == estimate_normals(points)).all()


@pytest.mark.parametrize("views", [[1, 2], np.zeros((7, 3)), "here"])
def test_bad_viewpoints(views):
    with pytest.raises(InvalidShapeError, match="viewpoints must have shape"):
        estimate_normals(forms.sphere(50).shape.points, viewpoints=views)
