"""Extended feature transform and point types (thesis 6.2.1)."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import closed_forms as forms
import medialis
import oracles
from medialis.base.progress import Progress
from medialis.base.threads import thread_limit
from medialis.shape.graph import local_spacing


def typed(shape):
    cloud = medialis.shrink_balls(shape)
    return cloud, medialis.point_types(cloud)


def clusters(sets, row):
    """The clusters of a row as a set of sets of samples."""
    samples, at = sets.samples[row], sets.samples.offsets
    labels = sets.clusters[at[row] : at[row + 1]]
    return {frozenset(samples[labels == c].tolist()) for c in range(sets.counts[row])}


@pytest.mark.parametrize("shape", [forms.box_mesh((2.0, 1.5, 1.0), 0.3), forms.torus_mesh(40, 20)])
def test_sets_are_those_of_the_oracle(shape):
    cloud = medialis.shrink_balls(shape)
    sets = medialis.extended_feature_transform(cloud)
    expected = oracles.feature_sets(shape, cloud, 0.1)
    for row in range(len(cloud)):
        assert clusters(sets, row) == expected[row]
        assert (sets.samples[row][:2] == cloud.features[row]).all()
        assert sets.clusters[sets.samples.offsets[row]] == 0


def test_balls_of_a_tube_that_touch_too_many_samples_are_those_that_hold_them():
    """A certificate that one ball gives another tells the truth: counted sample by sample."""
    turn, z = np.meshgrid(2 * np.pi * np.arange(300) / 300, 0.03 * np.arange(16))
    normals = np.stack([np.cos(turn), np.sin(turn), 0 * z], axis=2).reshape(-1, 3)
    points = (1.0 - 0.02 * z.ravel()[:, None]) * normals + z.ravel()[:, None] * [0, 0, 1]
    cloud = medialis.shrink_balls(medialis.Shape(points, normals))
    sets = medialis.extended_feature_transform(cloud)
    gap = 0.1 * local_spacing(cloud.surface)[cloud.features].mean(axis=1)
    apart = np.linalg.norm(cloud.centers[:, None] - points, axis=2)
    held = (apart <= (cloud.radii + gap)[:, None]).sum(axis=1)
    assert 1000 < (held > 1024).sum() < len(cloud)
    assert ((held > 1024) == ((sets.samples.lengths == 2) & (sets.agreement == 0))).all()


def test_threads_scale_and_order_change_nothing():
    shape = medialis.organic_shape(56)
    cloud = medialis.shrink_balls(shape)
    sets = medialis.extended_feature_transform(cloud)
    with thread_limit(1):
        single = medialis.extended_feature_transform(cloud)
    assert (single.samples.indices == sets.samples.indices).all()
    assert (single.clusters == sets.clusters).all()
    big = medialis.Shape(1024 * shape.points, shape.normals, shape.faces)  # a power of 2: exact
    types = medialis.point_types(cloud)
    assert (typed(big)[1] == types).all()
    order = np.random.default_rng(0).permutation(shape.point_count)
    place = np.argsort(order)
    mixed = medialis.Shape(shape.points[order], shape.normals[order], place[shape.faces])
    # The same balls, so that ties of ball shrinking do not matter.
    moved = medialis.MedialCloud(
        cloud.centers[order], cloud.radii[order], place[cloud.features[order]],
        np.arange(len(order)), cloud.status[order], cloud.spoke_angles[order], cloud.side[order],
        surface=mixed,
    )  # fmt: skip
    assert (medialis.point_types(moved) == types[order]).mean() > 0.999  # sums of lengths


def test_rotation_keeps_types():
    """Samples exactly at a distance of r + tau may turn over by rounding: one in a thousand."""
    shape = medialis.organic_shape(56)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    cloud = medialis.shrink_balls(shape)
    turned = medialis.Shape(shape.points @ turn.T, shape.normals @ turn.T, shape.faces)
    moved = medialis.MedialCloud(
        cloud.centers @ turn.T, cloud.radii, cloud.features, cloud.source, cloud.status,
        cloud.spoke_angles, cloud.side, surface=turned,
    )  # fmt: skip
    same = medialis.point_types(moved) == medialis.point_types(cloud)
    assert same.mean() > 0.999


@pytest.mark.parametrize("longest", [0.24, 0.16, 0.08, 0.04])
def test_box_has_a3_points_along_its_edges_and_nowhere_else(longest):
    """At the distance d from an edge the contacts are (d, 0) and (0, d). Samples on both sides that
    are no further than one mesh edge from it share a neighbour on it; others do not, so A3 reaches
    one sample spacing. Samples on the edges have balls of about 0.8 h, which touch both faces right
    beside the edge: all A3.
    """
    sides = np.array([2.0, 1.5, 1.0])
    shape = forms.box_mesh(sides, longest)
    types = typed(shape)[1]
    to_face = np.sort(sides / 2 - np.abs(shape.points), axis=1)
    to_edge = np.hypot(to_face[:, 0], to_face[:, 1])
    assert (types[to_edge < 1e-9] == medialis.PointType.A3).all()
    assert (types[to_edge > longest] >= medialis.PointType.SHEET).all()


@pytest.mark.parametrize("longest", [0.16, 0.08, 0.04])
def test_box_has_three_contacts_along_its_y_curves_only(longest):
    """A third face at the distance r + g counts when one of its samples lies within tau = 0.1 h of
    the ball. Its nearest sample is at most e = L / sqrt 3 away from the contact (L: longest
    edge), so it counts surely for g + e^2 / (2 r) < tau, and surely not for g > tau.
    """
    sides = np.array([2.0, 1.5, 1.0])
    shape = forms.box_mesh(sides, longest)
    cloud, types = typed(shape)
    clear = cloud.radii > 2 * longest  # smaller balls: three contacts within a few samples
    spacing = local_spacing(shape)
    tau = 0.1 * spacing[cloud.features].mean(axis=1)
    gaps = sides / 2 - np.abs(cloud.centers)
    gaps = np.sort(np.concatenate([gaps, sides - gaps], axis=1), axis=1) - cloud.radii[:, None]
    third = gaps[:, 2]
    slack = 2e-4 * shape.diagonal  # relief that does not shrink a ball: 3/4 of 3e-4
    assert (types[clear & (third > tau + slack)] == 2).all()
    touching = clear & (third + longest**2 / (6 * cloud.radii) < tau)
    assert touching.any() and (types[touching] >= 3).all()


def test_rim_of_the_focal_ellipse():
    """The medial surface of an ellipsoid a > b > c is the inside of the ellipse with the semi-axes
    (a^2 - c^2)/a and (b^2 - c^2)/b; A3 points lie on its rim, all others inside.

    Near the rim, at the distance x from it, the two contacts are y = c sqrt(2 x / L) from the
    middle plane, L being the semi-axis. The surface leaves the ball by (2 x / L) q between them,
    with q below the radius of the ball, so contacts merge where this is below tau = 0.1 h: for
    x < h L / (10 q) or so. With q >= c^2 / a = 0.25 and L <= 0.75 that is 0.3 h; a spacing is
    stretched to 2 h at most there, so that 2.5 h cover it.
    """
    shape = forms.icosphere(4)
    axes = np.array([1.0, 0.8, 0.5])
    points = shape.points * axes
    shape = medialis.Shape(points, forms.unit(points / axes**2), shape.faces)
    cloud = medialis.shrink_balls(shape, tolerance=0)
    types = medialis.point_types(cloud)
    rim = (1 - axes[2] ** 2 / axes**2)[:2] * axes[:2]
    angle = np.linspace(0, 2 * np.pi, 4000)
    ellipse = np.stack([rim[0] * np.cos(angle), rim[1] * np.sin(angle)], axis=1)
    distance = cKDTree(ellipse).query(cloud.centers[:, :2])[0]
    a3 = types == medialis.PointType.A3
    assert a3.sum() > 20 and distance[a3].max() < 2.5 * shape.spacing
    # They go all the way round: no gap of the rim is longer than a few stretched spacings.
    around = np.sort(np.arctan2(cloud.centers[a3, 1] / rim[1], cloud.centers[a3, 0] / rim[0]))
    assert np.diff(np.r_[around, around[0] + 2 * np.pi]).max() < 0.8
    assert set(np.unique(types)) <= {1, 2}


def test_tubes_and_spheres_are_not_rims():
    """One contact that goes round the ball is type 2, and so is a set too large to list."""
    for shape in (forms.torus_mesh(), forms.icosphere(3), forms.sphere(3000).shape):
        cloud, types = typed(shape)
        assert (types[cloud.valid] == medialis.PointType.SHEET).all()


def test_a3_filter_takes_the_rim_only():
    """Balls that touch within a sample spacing of an edge are no larger than that."""
    shape = forms.box_mesh((2.0, 1.5, 1.0), 0.1)
    cloud, types = typed(shape)
    taken = cloud.subset(types == medialis.PointType.A3)
    assert len(taken) > 0 and taken.radii.max() < 1.45 * 0.1


def test_clouds_and_masked_balls():
    form = forms.box_samples()
    types = typed(form.shape)[1]
    assert (types == 2).mean() > 0.5 and (types > 0).all()
    square = medialis.make_shape(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
    )
    cloud, types = typed(square)
    assert not cloud.valid.any() and (types == 0).all()


def test_bad_input():
    cloud = medialis.shrink_balls(medialis.organic_shape(56))
    for gap in (0, 11):
        with pytest.raises(medialis.InvalidOptionError, match="contact_gap"):
            medialis.extended_feature_transform(cloud, contact_gap=gap)
    for function in (medialis.extended_feature_transform, medialis.point_types):
        with pytest.raises(medialis.Cancelled):
            function(cloud, progress=lambda *_: False)


def test_types_take_the_feature_sets_of_the_sheets():
    cloud = medialis.shrink_balls(forms.box_mesh((2.0, 1.5, 1.0), 0.2))
    fresh, stages = medialis.point_types(cloud), Progress()
    with medialis.memory_limit(1 << 30):
        medialis.medial_sheets(cloud)
        types = medialis.point_types(cloud, progress=stages)
    assert "feature sets" not in stages.seconds and (types == fresh).all()
