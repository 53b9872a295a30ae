"""Models of scanned trees whose volume, length and limbs are known."""

import numpy as np
import pytest

import medialis
from medialis.base.progress import Progress
from medialis.cli.display import summary_lines
from medialis.curves.ground import Ground, find_ground
from medialis.curves.limb_fit import falling, fit_limb
from medialis.curves.point_tree import Sections, neighbour_graph, thinned
from medialis.curves.scanned_tree import ScannedTree, _cylinders, _judge, _Limb, scanned_tree
from medialis.curves.tree_operation import _warn_of_scan
from tree_scans import forked, grown, scanned

FORK = forked()
"""A trunk with two branches."""

VOLUME = sum(limb.volume for limb in FORK)

LENGTH = FORK[0].length + sum(limb.length - limb.at(0)[1] for limb in FORK[1:])
"""Beyond the surface of the trunk. Branches leave at 45 degrees: 1.4 times its radius is inside."""


def is_a_tree(tree):
    """One root, parents before children, and so no loops."""
    goes_on = tree.parents >= 0
    return goes_on.sum() == len(tree) - 1 and (tree.parents < np.arange(len(tree))).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "seen",
    [
        {},
        {"noise": 0.005},
        {"noise": 0.005, "strays": 300},
        {"noise": 0.003, "positions": 1},
        {"noise": 0.003, "positions": 2},
    ],
    ids=["exact", "noise", "strays", "one side", "two sides"],
)
def test_a_fork_has_its_limbs_volume_and_length(seen):
    """There were 94 limbs with noise, and no end with strays inside the trunk (fixed).

    Radii have errors of noise / sqrt(points of a window), below 1 %; where limbs meet, a window
    (two radii long) sees both: 5 % of the volume and of the length.
    """
    points = scanned(FORK, 3000, **seen)
    model = scanned_tree(points)
    tree = model.cylinders
    assert is_a_tree(tree)
    large = np.bincount(tree.branches, tree.volumes) > 0.01 * VOLUME  # not a few strays at a fork
    assert tree.orders[tree.first][large].tolist() == [0, 1, 1]
    assert tree.volumes.sum() == pytest.approx(VOLUME, rel=0.05)
    assert tree.lengths.sum() == pytest.approx(LENGTH, rel=0.05)
    assert model.explained > 0.95
    assert model.noise == pytest.approx(seen.get("noise", 0.0), abs=0.001)


@pytest.mark.slow
def test_a_registration_error_changes_radii_by_no_more_than_itself():
    """1 cm of 25 cm: 8 % of the volume."""
    points = scanned(FORK, 4000, positions=3, noise=0.003, shift=0.01)
    tree = scanned_tree(points).cylinders
    assert len(tree.first) == 3 and is_a_tree(tree)
    assert tree.volumes.sum() == pytest.approx(VOLUME, rel=0.08)


@pytest.mark.slow
def test_the_ground_is_left_out_and_the_trunk_begins_on_it():
    points = scanned(FORK, 5000, positions=3, noise=0.003, ground=4.0)
    model = scanned_tree(points)
    tree = model.cylinders
    assert len(tree.first) == 3 and model.on_ground > 1500
    assert tree.volumes.sum() == pytest.approx(VOLUME, rel=0.05)
    assert tree.starts[0, 2] == pytest.approx(0.0, abs=0.1)


def test_what_ends_just_above_the_ground_belongs_to_it():
    """Points left on rough ground were limbs across it: 55 % of the volume (fixed)."""
    cells = np.stack(np.meshgrid(np.arange(40), np.arange(40), indexing="ij"), -1).reshape(-1, 2)
    ground = Ground(2, np.zeros(2), 0.1, cells, np.zeros(len(cells)), 0.05)
    post = np.column_stack([np.full((60, 2), 2.05), np.linspace(0.06, 3, 60)])
    grass = np.random.default_rng(0).uniform([0.5, 0.5, 0.06], [1, 1, 0.15], (50, 3))
    low = ground.low_parts(np.concatenate([post, grass]))
    assert not low[:60].any() and low[60:].all()


def test_a_tree_without_ground_has_none():
    points = scanned(FORK, 3000, noise=0.003)
    assert find_ground(points, 2, 0.05) is None


@pytest.mark.slow
@pytest.mark.parametrize("positions", [0, 1, 2, 4])
def test_grown_trees(positions):
    """14 limbs of two orders. A limb is about 5 cm shorter than its tip, a section wide."""
    limbs = grown(3, 14)
    tree = scanned_tree(scanned(limbs, 15000, positions=positions, noise=0.003)).cylinders
    assert is_a_tree(tree)
    assert tree.volumes.sum() == pytest.approx(sum(limb.volume for limb in limbs), rel=0.05)
    assert tree.lengths.sum() == pytest.approx(sum(limb.length for limb in limbs), rel=0.05)
    assert len(tree.first) == pytest.approx(len(limbs), abs=2)


@pytest.mark.slow
def test_the_operation_gives_height_and_breast_diameter_with_units_far_from_the_origin():
    """The trunk has a radius of 0.25 * (1 - 0.4 * 1.3 / 6) m at 1.3 m."""
    points = 100.0 * scanned(FORK, 3000, noise=0.003) + [4.5e7, 5.4e8, 1e4]
    result = medialis.run("tree_cylinders", medialis.make_shape(points, unit="cm"))
    values = result.values
    assert values["limbs"] == 3 and values["highest_order"] == 1
    assert values["height"] == pytest.approx(600.0, rel=0.02)
    assert values["breast_diameter"] == pytest.approx(50.0 * (1 - 0.4 * 1.3 / 6), rel=0.02)
    assert values["volume"] == pytest.approx(1e6 * VOLUME, rel=0.05)
    assert [row["order"] for row in values["order_table"]] == [0, 1]
    root = np.array(values["root"])
    assert root == pytest.approx([4.5e7, 5.4e8, 1e4], abs=10.0)


@pytest.mark.slow
def test_unexplained_points_are_a_warning_with_their_fraction():
    rng = np.random.default_rng(0)
    cloud = np.concatenate([scanned(FORK, 2000), rng.uniform([1, -2, 1], [3, 0, 3], (400, 3))])
    result = medialis.run("tree_cylinders", medialis.make_shape(cloud, unit="m"))
    [warning] = [m for m in result.messages if m.code == "unexplained_points"]
    assert 0.05 < warning.data["fraction"] < 0.4


@pytest.mark.slow
def test_order_of_points_and_motion_change_nothing_that_matters():
    points = scanned(FORK, 2000, noise=0.003)
    shuffled = np.random.default_rng(1).permutation(points)
    one, other = (scanned_tree(p).cylinders for p in (points, shuffled))
    assert np.array_equal(one.starts, other.starts) and np.array_equal(one.radii, other.radii)
    turned = scanned_tree(points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])).cylinders
    assert turned.volumes.sum() == pytest.approx(one.volumes.sum(), rel=0.02)


def test_a_section_has_one_parent_and_gaps_are_bridged():
    points = scanned(FORK[:1], 1500)
    points = points[(points[:, 2] < 2.0) | (points[:, 2] > 2.6)]
    graph = neighbour_graph(points)
    base = np.flatnonzero(points[:, 2] < 0.15)
    sections = Sections.of(graph, base, 0.15)
    assert (sections.parents < 0).sum() == 1
    assert len(sections.path(sections.root())) > 0.8 * 6.0 / 0.15


def ring(radius, count, rng, noise=0.002):
    turn, place = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, 4, count)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), place], axis=1)
    return points + noise * rng.normal(size=points.shape)


def test_a_circle_through_few_scattered_points_measures_nothing():
    """Ten scattered points have a circle that fits; a limb so thick would have hundreds."""
    rng, axis = np.random.default_rng(0), np.array([[0, 0, 0], [0, 0, 4.0]])
    limbs = [
        _Limb(fit_limb(points, axis, 0.1, 1e-9), -1, 0.0, np.arange(len(points)), np.ones(1))
        for points in (ring(0.2, 6000, rng), ring(0.3, 60, rng), ring(0.03, 600, rng))
    ]
    assert limbs[1].fit.measured(0.002).any()
    _judge(limbs, 0.002)
    thick, few, thin = limbs
    assert thick.known.mean() > 0.9 and not few.known.any() and thin.known.any()
    assert (few.most < 0.1).all() and (thin.most > 0.03).all()


def test_a_limb_that_goes_on_straight_beyond_its_parent_keeps_its_length():
    """The parent was taken for endless, with the upper half of a trunk inside of it (fixed)."""
    rng = np.random.default_rng(0)
    points, axis = ring(0.2, 3000, rng), np.array([[0, 0, 0], [0, 0, 4.0]])
    limbs = []
    for number in range(2):
        lift = np.array([0.0, 0.0, 4.0 * number])
        fit = fit_limb(points + lift, axis + lift, 0.1, 1e-9)
        limbs.append(_Limb(fit, number - 1, 4.0 * number, np.arange(3000), fit.profile()))
        limbs[-1].radii = fit.profile()
    tree = _cylinders(limbs, 3.0, 0.1)
    assert tree.lengths.sum() == pytest.approx(8.0, rel=0.02)
    assert tree.branches.max() == 1


def test_a_limb_of_few_points_has_no_radius():
    points = ring(0.05, 9, np.random.default_rng(0))
    fit = fit_limb(points, np.array([[0, 0, 0], [0, 0, 4.0]]), 0.1, 1e-9)
    assert np.isnan(fit.radii).all() and not fit.measured(0.002).any()
    assert fit.lengths.sum() == pytest.approx(np.ptp(points[:, 2]))


@pytest.mark.slow
def test_strays_far_apart_are_no_limb():
    away = np.column_stack([np.linspace(1, 4, 5), np.zeros(5), np.full(5, 1.0)])
    points = np.concatenate([scanned(FORK, 3000, noise=0.003), away])
    tree = scanned_tree(points).cylinders
    assert len(tree.first) == 3
    assert tree.lengths.sum() == pytest.approx(LENGTH, rel=0.05)


@pytest.mark.slow
def test_one_position_with_occlusion():
    """Of what is behind something only parts are seen: the length is less sure than the volume."""
    limbs = grown(3, 14)
    seen = {"positions": 1, "occluded": True, "noise": 0.003, "ground": 4.0}
    model = scanned_tree(scanned(limbs, 10000, **seen))
    tree = model.cylinders
    assert is_a_tree(tree)
    assert tree.volumes.sum() == pytest.approx(sum(limb.volume for limb in limbs), rel=0.10)
    assert tree.lengths.sum() == pytest.approx(sum(limb.length for limb in limbs), rel=0.15)


@pytest.mark.parametrize(
    ("measured", "error", "code", "words"),
    [
        (0.0, 2.0, "radii_unmeasured", "points are 0.4 apart"),
        (0.3, 0.27, "volume_uncertain", "off by 27 %: 30 % of the length"),
        (0.3, 0.08, "length_uncertain", "70 % of the length is in limbs too thin"),
        (0.6, 0.08, None, ""),
    ],
)
def test_a_volume_that_cannot_be_known_says_so(measured, error, code, words):
    """A tree of 200 points had 100 times its volume, and nothing said so (fixed)."""
    progress = Progress()
    _warn_of_scan(ScannedTree(None, 200, 0, 0.4, 0.01, 0.99, measured, error), progress)
    assert [m.code for m in progress.messages] == ([code] if code else [])
    assert all(words in m and len(m) <= 160 for m in progress.messages)


@pytest.mark.slow
def test_a_cloud_is_told_nothing_of_normals_and_lengths_it_does_not_need(tmp_path):
    cloud = medialis.make_shape(scanned(FORK, 2000, noise=0.003), unit="m")
    result = medialis.run("tree_cylinders", cloud)
    written = medialis.write_result(
        result, tmp_path / "out", pictures=medialis.Pictures(main=False)
    )
    assert not [m for m in result.messages if m.code == "automatic"]
    lines = [*summary_lines(written, 100)]
    assert not [line for line in lines if line.startswith(("note:", "warning:"))]


def test_half_a_circle_is_enough_for_a_radius():
    rng = np.random.default_rng(0)
    turn, place = rng.uniform(0, np.pi, 400), rng.uniform(0, 1, 400)
    points = np.stack([0.1 * np.cos(turn), 0.1 * np.sin(turn), place], axis=1)
    points += 0.002 * rng.normal(size=points.shape)
    fit = fit_limb(points, np.array([[0, 0.06, 0], [0, 0.06, 1.0]]), 0.1, 1e-9)
    # Standard error of a radius from half a circle of 80 points: about 0.002 * 3 / sqrt(80).
    assert np.abs(fit.radii - 0.1).max() < 0.003
    assert np.nanmedian(fit.noise) == pytest.approx(0.002, rel=0.2)
    assert fit.measured(0.002).all()


def test_falling_values_are_nearest_in_absolute_deviation():
    assert falling(np.array([1.0, 5.0, 0.5]), np.ones(3)).tolist() == [1.0, 1.0, 0.5]
    assert falling(np.array([3.0, 2.0, 1.0]), np.ones(3)).tolist() == [3.0, 2.0, 1.0]


def test_thinning_keeps_one_point_of_each_cell():
    points = np.random.default_rng(0).uniform(size=(5000, 3))
    rows = thinned(points, 1000)
    assert 800 < len(rows) <= 1000 and len(np.unique(rows)) == len(rows)
    assert np.array_equal(thinned(points, 5000), np.arange(5000))


def test_ground_alone_says_so():
    flat = np.random.default_rng(0).uniform(size=(300, 2))
    with pytest.raises(medialis.InvalidShapeError, match="less than 20 points above"):
        scanned_tree(np.column_stack([flat, np.zeros(300)]))


@pytest.mark.parametrize("points", [np.zeros((100, 3)), np.eye(3)])
def test_too_few_points_say_so(points):
    with pytest.raises(medialis.InvalidShapeError, match="distinct points"):
        scanned_tree(points)
