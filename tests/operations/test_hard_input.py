"""Inputs that are hard to use: values stay defined or None, sentences tell the way out."""

import json

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.hosts import shown
from medialis.operations.result import Outcome
from medialis.show.colors import value_range
from medialis.skeleton.layers import summary


def faceted_ball(turns=8):
    """A sphere of so few facets that no candidate of a curve skeleton is certain."""
    profile = np.linspace(-np.pi / 2, np.pi / 2, turns + 1)
    return forms.revolved(np.stack([np.cos(profile), np.sin(profile)], axis=1), around=2 * turns)


def together(first, second, step):
    return medialis.make_shape(
        np.vstack([first.points, second.points + np.asarray(step)]),
        np.vstack([first.faces, second.faces + first.point_count]),
    )


def test_values_hold_none_for_what_is_not_defined():
    values = {"a": np.nan, "b": [1.5, -np.inf, {"c": np.float64("nan")}], "d": (1, "x")}
    given = Outcome(medialis.organic_shape(56), values=values).values
    assert given == {"a": None, "b": [1.5, None, {"c": None}], "d": [1, "x"]}
    assert summary(np.array([np.nan, np.inf]), "area") == dict.fromkeys(
        ("area_min", "area_median", "area_max")
    )


def test_the_scaffold_of_a_cloud_is_strict_json():
    """Areas of sheets in a cloud were NaN in the values, which JSON does not know."""
    result = medialis.run("medial_sheets", forms.sphere(400).shape)
    assert result.values["scaffold"]["sheets"][0]["area"] is None
    json.dumps(result.values, allow_nan=False)


def test_what_is_thinner_than_a_pixel_has_no_depth_difference():
    """The medians were NaN, and so were the words in the picture."""
    bar = forms.box_mesh((1e5, 1.0, 1.0), 1e6)
    result = medialis.run("ball_reconstruction", bar, size=64, progressive=True)
    assert result.values["median_depth_difference_percent"] is None
    assert result.values["progressive"][0][2] is None
    assert "thinner_than_a_pixel" in {message.code for message in result.messages}


@pytest.mark.slow
def test_a_round_part_has_its_node_in_the_middle():
    """The node of a faceted ball lay near its surface, where the measure, which is noise there, was
    largest; its importance was NaN, or that of another part."""
    ball = faceted_ball()
    result = medialis.run("curve_skeleton", ball)
    graph = result.extras["graph"]
    assert len(graph.nodes) == 1
    # The ball inside the facets has the radius cos(pi / 16) = 0.98; refinement leaves 2 % edges.
    assert np.linalg.norm(graph.nodes[0]) < 0.1 and graph.radii[0] > 0.85
    area = result.shape.area
    assert np.allclose(graph.importance, area, rtol=1e-9)
    bar = forms.box_mesh((4.0, 0.4, 0.4), 0.2)
    result = medialis.run("curve_skeleton", together(bar, ball, [0, 5, 0]))
    both, fine = result.extras["graph"], result.shape
    area = fine.face_areas[fine.points[fine.faces[:, 0], 1] > 3].sum()
    alone = both.degrees == 0
    assert alone.sum() == 1 and np.allclose(both.importance[alone], area, rtol=1e-9)


def test_closed_branches_have_no_tortuosity_in_values():
    result = medialis.run("curve_skeleton", forms.torus_mesh(), refine=0.05)
    assert [row["tortuosity"] for row in result.values["branch_table"]] == [None]
    ring = CurveSkeleton.of(np.eye(3), [[0, 1], [1, 2], [0, 2]], np.ones(3))
    assert np.isinf(ring.tortuosity).all()


@pytest.mark.slow
def test_infinite_importance_stays_and_scales_come_from_the_finite_values():
    """Between overlapping parts no path joins the feature points: no threshold removes them."""
    ball = forms.icosphere(2)
    # Each ball reaches into that of the other one; the third is apart.
    shape = together(together(ball, ball, [1.0, 0, 0]), ball, [5.0, 0, 0])
    result = medialis.run("skeleton_importance", shape, threshold=1.0, connected=False)
    importance = result.layers[0].attributes["importance"]
    endless = np.isinf(importance)
    assert endless.any() and (importance[~endless] >= shape.diagonal).all()
    every = medialis.run("skeleton_importance", shape, connected=False)
    importance = every.layers[0].attributes["importance"]
    low, high = value_range(importance)
    assert np.isfinite([low, high]).all() and every.values["importance_max"] == high
    colors = shown(every.layers[0]).rgba_bytes
    assert (colors[np.isinf(importance)] == colors[importance == high][0]).all()
    assert "between_parts" in {message.code for message in every.messages}


@pytest.mark.slow
def test_segments_that_a_coarse_input_cannot_show_are_told():
    cube = forms.cube()
    result = medialis.run("mean_shift_segments", cube, refine=0.1)
    present = np.unique(result.layers[0].attributes["segment"])
    count = result.values["segments"]
    assert len(present) < count == result.layers[1].attributes["segment"].max() + 1
    assert any(f"{count - len(present)} of {count} segments" in text for text in result.messages)
    assert not any("hold no vertex" in text for text in medialis.run("patches", cube).messages)


def test_a_cloud_with_inward_normals_and_flat_views_are_told_the_way_out():
    ball = forms.sphere(200).shape
    inward = medialis.Shape(ball.points, -ball.normals)
    with pytest.raises(medialis.InvalidShapeError, match="normals of this cloud point inward"):
        medialis.run("surface_skeleton", inward)
    flat = medialis.make_shape(np.eye(3), [[0, 1, 2]])
    with pytest.raises(medialis.InvalidShapeError, match="use surface_skeleton"):
        medialis.run("view_curve_skeleton", flat, pairs=2, size=32)


def test_parts_are_moved_by_their_own_bones_only():
    """Bones of one part were smoothed over all others: 10000 parts took many minutes."""
    bar = forms.box_mesh((2.0, 0.5, 0.4), 0.2)
    result = medialis.run("armature", together(bar, bar, [0, 4, 0]), refine=0)
    assert np.allclose(result.extras["skin"].weights.sum(axis=1), 1, rtol=0, atol=1e-12)
    bones = result.extras["bones"]
    there = np.stack([bones.heads[:, 1], bones.tails[:, 1]], axis=1) > 2
    of_other = there.all(axis=1), ~there.any(axis=1)  # the one between them is of both
    for part in range(2):
        own = result.extras["skin"].bones[part * bar.point_count : (part + 1) * bar.point_count]
        assert of_other[part].any() and not of_other[part][own[own >= 0]].any()
