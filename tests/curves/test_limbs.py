"""Limbs of bodies and machine parts: ends, loops and what hangs on what are known."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from bodies import blended, joined, meshed, rod, rounded_box, without

TRUNK = 0.3
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])


def trunk_with_limbs(ratios, lengths):
    """Limbs at right angles to a capsule along z, each a share of its radius thick: ends, shape."""
    places, parts = np.linspace(-0.9, 0.9, len(ratios)), []
    parts.append((np.array([0, 0, -1.5]), np.array([0, 0, 1.5]), TRUNK, TRUNK))
    for k, (z, ratio, length) in enumerate(zip(places, ratios, lengths, strict=True)):
        way = np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0])
        start, radius = np.array([0, 0, z]), ratio * TRUNK
        parts.append((start, start + (TRUNK + length) * way, radius, radius))
    tips = np.array([parts[0][0], *(part[1] for part in parts)])
    radii = np.array([TRUNK, *(part[2] for part in parts)])
    return blended(parts, 0.012, 0.6 * radii.min()), tips, radii


@pytest.mark.parametrize(
    ("ratios", "lengths"),
    [
        ((0.3, 0.3, 0.3), (0.25, 0.4, 0.8)),
        pytest.param((0.08, 0.1, 0.15), (0.3, 0.4, 0.5), marks=pytest.mark.slow),
        pytest.param((0.5, 0.1, 0.3, 0.2), (0.6, 0.3, 0.5, 0.4), marks=pytest.mark.slow),
    ],
)
def test_limbs_are_found_however_thin_and_hang_on_the_trunk(ratios, lengths):
    shape, tips, radii = trunk_with_limbs(ratios, lengths)
    graph = medialis.run("curve_skeleton", shape).graph
    ends = graph.nodes[graph.end_points]
    gap = np.linalg.norm(ends[:, None] - tips, axis=2)
    assert len(ends) == len(tips)
    assert sorted(gap.argmin(axis=1)) == list(range(len(tips)))
    # A branch ends where a square of 2 % of the diagonal hangs on it, or a blunt corner: up to the
    # diameter, which is some three edges here.
    least = (0.02 * shape.diagonal) ** 2 / (2 * np.pi * radii)
    assert (gap.min(axis=0) < least + 2 * radii).all()
    fork = graph.nodes[graph.junctions]
    assert np.hypot(fork[:, 0], fork[:, 1]).max() < TRUNK / 2
    assert len(fork) == len(ratios)


def beads(sides):
    """Prisms in a row, as legs of insects are drawn: narrow sides that bend by 45 degrees."""
    places = 3.0 * (np.arange(4)[:, None] + np.array([0.08, 0.3, 0.7, 0.92])).ravel()
    wide = 0.5 * np.tile([0.7, 1.0, 1.0, 0.7], 4)
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = [
        np.column_stack([r * ring, np.full(sides, z)]) for r, z in zip(wide, places, strict=True)
    ]
    points += [np.array([[0, 0, places[0]], [0, 0, places[-1]]])]
    i, first = np.arange(sides), sides * np.arange(len(places) - 1)[:, None]
    a, b = first + i, first + (i + 1) % sides
    last, low, high = sides * (len(places) - 1), sides * len(places), sides * len(places) + 1
    faces = [np.stack([a, b, b + sides], axis=2), np.stack([a, b + sides, a + sides], axis=2)]
    j = (i + 1) % sides
    caps = [np.stack([0 * i + low, j, i], 1), np.stack([0 * i + high, last + i, last + j], 1)]
    return medialis.make_shape(
        np.concatenate(points), np.concatenate([*(f.reshape(-1, 3) for f in faces), *caps])
    )


@pytest.mark.parametrize("refine", [0.04, 0.06, 0.08])
def test_the_curve_of_prisms_in_a_row_does_not_go_along_their_creases(refine):
    """Samples of a coarse prism lie on its creases alone where it ends, and so did the graph.

    It is the spider's leg: there the graph was twice as long as the leg. The balls that join two
    prisms lie beside creases, up to half a radius off the axis.
    """
    graph = medialis.curve_skeleton(medialis.surface_skeleton(beads(8), refine=refine))
    assert len(graph.end_points) == 2
    assert graph.length > 9.0 - 1e-9  # from the middle of the first prism to that of the last
    assert np.hypot(graph.nodes[:, 0], graph.nodes[:, 1]).max() < 0.5 / 2


def quadruped(tail):
    def limb(a, b, radius, end=None):
        return (np.array(a), np.array(b), radius, radius if end is None else end)

    parts = [limb((0, -0.5, 0), (0, 0.5, 0), 0.2), limb((0, 0.5, 0.05), (0, 0.9, 0.35), 0.1, 0.08)]
    parts += [limb((0, -0.55, 0.05), (0, -0.85, 0), tail)]
    parts += [limb((0, -0.85, 0), (0, -0.95, -0.45), tail, 0.8 * tail)]
    for side in (-1, 1):
        parts += [limb((side * 0.13, y, 0), (side * 0.15, y, -0.75), 0.07) for y in (-0.5, 0.5)]
    return parts


@pytest.mark.slow
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("tail", [0.08, 0.05])
def test_a_tail_hangs_on_the_trunk_and_left_is_as_right(tail, turned):
    shape = blended(quadruped(tail), 0.012, 0.4 * tail)
    turn = TURN if turned else np.eye(3)
    points, normals = shape.points @ turn.T, shape.normals @ turn.T
    graph = medialis.run("curve_skeleton", medialis.Shape(points, normals, shape.faces)).graph
    nodes = graph.nodes @ turn
    ends = graph.end_points
    assert len(ends) == 6
    tip = ends[np.linalg.norm(nodes[ends] - [0, -0.95, -0.45], axis=1).argmin()]
    branch = next(row for row in graph.branches if tip in (row[0], row[-1]))
    fork = nodes[branch[0] if branch[-1] == tip else branch[-1]]
    trunk = np.clip(fork[1], -0.5, 0.5)
    assert np.linalg.norm(fork - [0, trunk, 0]) < 0.5 * 0.2
    image = nodes * [-1, 1, 1]
    off = np.linalg.norm(nodes[:, None] - image, axis=2).min(axis=1)
    assert off.max() < 0.01 * shape.diagonal


@pytest.mark.slow
@pytest.mark.parametrize(("half_angle", "branches"), [(20, 1), (45, 0)])
def test_cones_that_taper_by_more_than_60_degrees_are_no_limbs(half_angle, branches):
    """Two equal cones, base to base: a spindle has an axis, a top is one node."""
    tall = 1 / np.tan(np.radians(half_angle))
    side = np.linspace(0, 1, 30)
    profile = [(t, -tall * (1 - t)) for t in side] + [(1 - t, tall * t) for t in side[1:]]
    graph = medialis.run("curve_skeleton", forms.revolved(profile)).graph
    assert graph.branch_count == branches
    assert np.hypot(graph.nodes[:, 0], graph.nodes[:, 1]).max() < 0.02


def eyelets(at):
    bar = rounded_box(at, (0, 0, 0), (1, 0.17, 0.1), 0.03)
    body = joined([rod(at, (-1, 0, 0), 0.45, 0.2), rod(at, (1, 0, 0), 0.3, 0.2), bar], 0.03)
    return without(without(body, rod(at, (-1, 0, 0), 0.28, 1)), rod(at, (1, 0, 0), 0.16, 1))


def crank(at):
    shafts = [rod(at, (0, 0, z), 0.2, 0.35) for z in (-1, 1)]
    cheeks = [rounded_box(at, (0.25, 0, z), (0.5, 0.22, 0.1), 0.04) for z in (-0.55, 0.55)]
    return joined([*shafts, *cheeks, rod(at, (0.5, 0, 0), 0.15, 0.6)], 0.03)


def elbow(at):
    pipes = [rod(at, (0, 0, 0.6), 0.25, 0.7), rod(at, (0.6, 0, 0), 0.25, 0.7, axis=0)]
    flanges = [rod(at, (0, 0, 1.2), 0.5, 0.1), rod(at, (1.2, 0, 0), 0.5, 0.1, axis=0)]
    rib = rounded_box(at, (0.3, 0, 0.3), (0.25, 0.05, 0.25), 0.02)
    return joined([*pipes, *flanges, rib], 0.03)


def flange(at):
    body = joined([rod(at, (0, 0, 0), 1, 0.12), rod(at, (0, 0, 0.25), 0.4, 0.3)], 0.03)
    body = without(body, rod(at, (0, 0, 0), 0.22, 2))
    for turn in np.arange(6) * np.pi / 3:
        body = without(body, rod(at, (0.75 * np.cos(turn), 0.75 * np.sin(turn), 0), 0.1, 1))
    return body


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "low", "high", "ends", "loops", "branches"),
    [
        (eyelets, (-1.5, -0.5, -0.25), (1.4, 0.5, 0.25), 0, 2, 3),
        (crank, (-0.4, -0.4, -1.5), (0.9, 0.4, 1.5), 2, 0, 1),
        (elbow, (-0.6, -0.6, -0.6), (1.4, 0.6, 1.4), 2, 0, 1),
        (flange, (-1.1, -1.1, -0.2), (1.1, 1.1, 0.7), 0, 7, 18),
    ],
)
def test_machine_parts_have_no_spurs(part, low, high, ends, loops, branches):
    graph = medialis.run("curve_skeleton", meshed(part, low, high, 0.03)).graph
    assert (len(graph.end_points), graph.loops) == (ends, loops)
    assert graph.branch_count <= branches


@pytest.mark.slow
def test_a_spool_has_its_axis_and_a_disc_its_middle():
    profile = [(0, -1), (1, -1), (1, -0.8), (0.3, -0.8), (0.3, 0.8), (1, 0.8), (1, 1), (0, 1)]
    graph = medialis.run("curve_skeleton", forms.revolved(profile, around=48)).graph
    assert graph.branch_count == 1 and graph.length > 1
    assert np.hypot(graph.nodes[:, 0], graph.nodes[:, 1]).max() < 0.02
    disc = [(0, -0.05), (1, -0.05), (1, 0.05), (0, 0.05)]
    run = medialis.run("curve_skeleton", forms.revolved(disc, around=48))
    assert len(run.graph.nodes) == 1 and np.linalg.norm(run.graph.nodes[0]) < 0.02
    assert "thin_sheets" in {message.code for message in run.messages}


@pytest.mark.slow
def test_thin_blades_on_a_hub_warn():
    def rotor(at):
        body = [rod(at, (0, 0, 0), 0.25, 0.3)]
        for turn in 2 * np.pi * np.arange(5) / 5:
            c, s = np.cos(turn), np.sin(turn)
            spun = at @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
            body.append(rounded_box(spun, (0.62, 0, 0), (0.45, 0.03, 0.25), 0.01))
        return joined(body, 0.01)

    run = medialis.run(
        "curve_skeleton", meshed(rotor, (-1.1, -1.1, -0.35), (1.1, 1.1, 0.35), 0.025)
    )
    assert "thin_sheets" in {message.code for message in run.messages}
    assert run.graph.branch_count < 20
