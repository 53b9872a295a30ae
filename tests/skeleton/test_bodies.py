"""Bodies that touch have balls of their own, as if each were alone.

The family is that of `tests/assemblies.py`. The answer is known: the balls of each body alone.
"""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from assemblies import GAPS, KINDS, block, in_any_pose, stack, together, turned_profile
from medialis.base.progress import Progress
from medialis.shape.normals import ring_normals


def assembled(parts):
    return medialis.make_shape(*together(parts), repair=True)


def bare(points, faces):
    """Shape with mean normals: cylinders are not looked for, which takes most of the time."""
    return medialis.Shape(points, ring_normals(points, faces, smooth=False), faces)


def deviations(cloud, parts, made=medialis.make_shape, **options):
    """Largest relative difference of the radii of each body to those of the body alone."""
    label, result = cloud.surface.bodies[cloud.source], []
    for number, part in enumerate(parts):
        alone = medialis.surface_skeleton(made(*part), **options)
        radii = cloud.radii[label == number]
        assert len(radii) == len(alone)
        result.append(np.max(np.abs(radii - alone.radii) / alone.radii))
    return result


@pytest.mark.parametrize("alike", [True, False])
@pytest.mark.parametrize("gap", GAPS)
@pytest.mark.parametrize("kind", KINDS)
def test_each_body_is_computed_on_as_if_it_were_alone(kind, gap, alike):
    """224 members: four of each kind, gap and tessellation, of 2 to 9 bodies in any pose."""
    for seed in range(4):
        rng = np.random.default_rng(1000 + seed)
        count = int(rng.integers(2, 10 if kind == "stack" else 5))
        parts = in_any_pose(KINDS[kind](rng, gap, count, alike), rng)
        shape = bare(*together(parts))
        assert shape.body_contacts.count == len(parts)
        label = np.repeat(np.arange(len(parts)), [len(points) for points, _ in parts])
        np.testing.assert_array_equal(shape.bodies, label)
        progress = Progress()
        cloud = medialis.surface_skeleton(shape, refine=0.0, progress=progress)
        assert max(deviations(cloud, parts, bare, refine=0.0)) < 1e-6
        contacts = {contact.bodies for contact in shape.body_contacts.contacts}
        notes = {m.code: m.data for m in progress.messages}
        assert contacts <= {(k, k + 1) for k in range(len(parts))}
        assert ("contacts" in notes) == bool(contacts)
        if contacts:
            assert notes["contacts"]["contacts"] == len(contacts)
        if gap == 1e-3:
            assert not contacts or kind != "stack"  # coarse facets say less than the gap
        elif alike or kind != "sleeves":  # rings of different heights may miss each other
            assert len(contacts) == len(parts) - 1


@pytest.mark.parametrize("kind", KINDS)
def test_automatic_lengths_are_those_of_each_body(kind):
    rng = np.random.default_rng(5)
    parts = in_any_pose(KINDS[kind](rng, 0.0, 2, False), rng)
    cloud = medialis.surface_skeleton(assembled(parts))
    assert max(deviations(cloud, parts)) < 1e-4


def test_fifty_bodies():
    rng = np.random.default_rng(6)
    parts = stack(rng, 0.0, 50, False)
    shape = bare(*together(parts))
    assert len(shape.body_contacts.contacts) == 49
    cloud = medialis.surface_skeleton(shape, refine=0.0)
    assert max(deviations(cloud, parts, bare, refine=0.0)) < 1e-6


@pytest.mark.parametrize("kind", ["sleeves", "plug"])
def test_a_gap_of_a_thousandth_between_round_bodies_is_no_contact(kind):
    """As soon as facets are fine enough to tell."""
    parts = KINDS[kind](np.random.default_rng(5), 1e-3, 2, True)
    surface = medialis.surface_skeleton(assembled(parts)).surface
    assert surface.body_contacts.contacts == () and len(surface.body_contacts.near) == 1


def test_lengths_that_are_given_are_used_as_written():
    """A tolerance is then a length of the whole, the same for all bodies."""
    parts = stack(np.random.default_rng(7), 0.0, 3, True)
    shape = assembled(parts)
    cloud = medialis.surface_skeleton(shape, refine=0.0, tolerance=1e-3)
    alone = medialis.make_shape(*parts[0])
    tolerance = 1e-3 * shape.diagonal / alone.diagonal
    wanted = medialis.surface_skeleton(alone, refine=0.0, tolerance=tolerance)
    np.testing.assert_allclose(cloud.radii[: len(wanted)], wanted.radii, rtol=1e-9)


def test_a_ring_on_a_rod_of_the_same_radius_is_no_thin_wall():
    """A nut on a rod had 11 thin spots, one of 1e-10 over 282 mm2."""
    rod = turned_profile([[0, -20], [5, -20], [5, 20], [0, 20]], 32)
    ring = turned_profile([[5, -4], [9, -4], [9, 4], [5, 4]], 32, np.pi / 32)
    shape = medialis.make_shape(*together([rod, ring]), unit="mm", repair=True)
    result = medialis.run("thickness", shape, threshold="2mm", refine=0.03)
    assert result.values["spots"] == []
    assert result.values["thickness_min"] == pytest.approx(4.0, rel=0.01)
    assert "contacts" in [m.code for m in result.messages]


def test_fans_and_both_sides_of_bodies_that_touch():
    parts = stack(np.random.default_rng(8), 0.0, 3, False)
    cloud = medialis.surface_skeleton(assembled(parts), refine=0.3, fans=True, side="both")
    own, n = cloud.own, cloud.surface.point_count
    assert len(own) == 2 * n and (own.source == np.tile(np.arange(n), 2)).all()
    assert (own.side[:n] == 1).all() and (own.side[n:] == -1).all()
    inner = cloud.subset(cloud.side > 0)
    label = cloud.surface.bodies
    touched = inner.features[inner.valid]
    np.testing.assert_array_equal(label[touched[:, 0]], label[touched[:, 1]])
    on_face = inner.contact_faces >= 0
    corner = cloud.surface.faces[inner.contact_faces[on_face], 0]
    np.testing.assert_array_equal(label[corner], label[inner.source[on_face]])
    one = medialis.surface_skeleton(medialis.make_shape(*parts[0]), refine=0.0, fans=True)
    whole = medialis.surface_skeleton(assembled(parts), refine=0.0, fans=True)
    mine = whole.surface.bodies[whole.source] == 0
    assert mine.sum() == len(one)


def test_bodies_that_do_not_touch_are_computed_as_before():
    """The same bits as those of a shape whose bodies are all one set."""
    far = [block((1, 1, 1)), block((1, 1, 1), (5, 0, 0))]
    cloud = medialis.surface_skeleton(assembled(far))
    assert cloud.surface.body_contacts.near.shape == (0, 2)
    assert "contacts" not in [m.code for m in _messages(far)]
    plates = [block((2.0, 1.5, 0.2)), block((2.0, 1.5, 0.2), (0.9, 0.3, 0.15))]
    deep = assembled(plates)
    assert deep.body_contacts.count == 1  # they interpenetrate: one body, limited by both


def _messages(parts):
    progress = Progress()
    medialis.surface_skeleton(assembled(parts), progress=progress)
    return progress.messages


def test_icospheres_inside_of_each_other():
    """A ball in the cavity of a hollow ball: two bodies; a ball within a solid one: one body."""
    ball = forms.icosphere(2)
    points, faces = ball.points, ball.faces
    hollow = [(points * 2, faces), (points * 1.2, faces[:, ::-1].copy())]
    shape = assembled([*hollow, (points, faces)])
    assert shape.body_contacts.count == 2
    assert (shape.bodies[: 2 * len(points)] == 0).all() and (
        shape.bodies[2 * len(points) :] == 1
    ).all()
    assert assembled([(points * 2, faces), (points, faces)]).body_contacts.count == 1
