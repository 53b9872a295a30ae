"""What is kept: found again for equal input alone, bounded, read-only, the same bits as anew."""

import logging
import pickle
import platform
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.base import kept as memory
from medialis.base.errors import Cancelled, InvalidOptionError
from medialis.base.kept import DEFAULT_LIMIT, LIMIT_VARIABLE, Bound, _first_limit, kept
from medialis.base.progress import Progress
from medialis.skeleton import surface_skeleton as preparation
from medialis.skeleton.importance import importance
from medialis.skeleton.importance import importance as connectivity

ROOM = 1 << 30


class Thing(Bound):
    """Something to compute from."""


class Computing:
    """Computes an array of 8 `size` bytes for an option, and counts how often it did."""

    def __init__(self, size=125):
        self.size, self.done = size, []

    def __call__(self, data, option):
        def work():
            self.done.append(option)
            return np.arange(float(self.size))

        return kept(Computing, data, option, work, Progress())


# The memory


def test_the_same_is_computed_once_and_another_option_or_thing_anew():
    compute, one, other = Computing(), Thing(), Thing()
    with medialis.memory_limit(ROOM):
        first = compute(one, "a")
        assert compute(one, "a") is first and compute.done == ["a"]
        assert compute(one, "b") is not first and compute(other, "a") is not first
        assert compute.done == ["a", "b", "a"]


def test_options_of_another_type_are_not_the_same():
    compute, thing = Computing(), Thing()
    with medialis.memory_limit(ROOM):
        for option in (1, 1.0, True):  # equal, with the same hash
            compute(thing, option)
    assert [type(option) for option in compute.done] == [int, float, bool]


def test_what_was_not_used_for_longest_goes_first():
    compute, thing = Computing(), Thing()  # 1000 bytes each
    with medialis.memory_limit(3000):
        for option in "abc":
            compute(thing, option)
        assert medialis.kept_bytes() == 3000
        compute(thing, "a")
        compute(thing, "d")  # no room for b
        assert medialis.kept_bytes() == 3000
        for option in "acd":
            compute(thing, option)
        assert compute.done == list("abcd")
        compute(thing, "b")
        assert compute.done == list("abcdb")


def test_what_is_larger_than_all_memory_is_not_kept():
    compute, thing = Computing(), Thing()
    with medialis.memory_limit(999):
        compute(thing, "a")
        compute(thing, "a")
        assert compute.done == ["a", "a"] and medialis.kept_bytes() == 0


def test_a_limit_ends_with_its_block_and_a_lower_one_forgets():
    compute, thing = Computing(), Thing()
    with medialis.memory_limit(ROOM):
        compute(thing, "a")
        compute(thing, "b")
        with medialis.memory_limit(1000):
            assert medialis.kept_bytes() == 1000
            compute(thing, "b")
        with medialis.memory_limit(0):
            assert medialis.kept_bytes() == 0
            compute(thing, "b")
            compute(thing, "b")
        assert compute.done == list("abbb")
        compute(thing, "b")
        compute(thing, "b")
        assert compute.done == list("abbbb")
    for bad in (-1, 0.5, "all", None):
        with pytest.raises(InvalidOptionError, match="size"), medialis.memory_limit(bad):
            pass


def test_forgetting():
    compute, thing = Computing(), Thing()
    with medialis.memory_limit(ROOM):
        compute(thing, "a")
        assert medialis.kept_bytes() == 1000
        medialis.forget()
        assert medialis.kept_bytes() == 0
        compute(thing, "a")
        assert compute.done == ["a", "a"]


def test_the_environment_sets_the_limit_of_a_process(monkeypatch):
    for text, wanted in (("1000", 1000), ("0", 0), ("", DEFAULT_LIMIT), ("many", DEFAULT_LIMIT)):
        monkeypatch.setenv(LIMIT_VARIABLE, text)
        assert _first_limit() == wanted


def test_results_of_anything_else_are_not_kept():
    compute = Computing()
    with medialis.memory_limit(ROOM):
        compute([1, 2], "a")
        assert compute([1, 2], "a").flags.writeable and compute.done == ["a", "a"]


def test_arrays_that_two_results_hold_count_once():
    thing, shared = Thing(), np.arange(125.0)
    with medialis.memory_limit(ROOM):
        for option in "ab":
            kept(Thing, thing, option, lambda: {"of": [shared, shared[3:]]}, Progress())
        assert medialis.kept_bytes() == 1000


@dataclass
class Holder:
    """A result that holds arrays in many ways."""

    plain: np.ndarray
    part: np.ndarray
    inside: dict


def test_nobody_can_write_into_what_is_kept():
    whole = np.arange(10.0)
    made = Holder(np.arange(4), whole[2:5], {"rows": (np.zeros(3),)})
    with medialis.memory_limit(ROOM):
        assert kept(Holder, Thing(), None, lambda: made, Progress()) is made
    for array in (made.plain, whole, made.inside["rows"][0]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7


def test_messages_are_recorded_when_computed_and_when_found():
    thing, progress = Thing(), Progress()

    def work():
        progress.note("2 of 3 went.", "gone", level=logging.WARNING, things=2, of=3)
        return np.zeros(1)

    with medialis.memory_limit(ROOM):
        progress.note("Before.")
        for _ in range(2):
            kept(Thing, thing, None, work, progress)
    assert [message.code for message in progress.messages] == ["", "gone", "gone"]
    assert progress.messages[2].data == {"things": 2, "of": 3}
    assert progress.messages[2].level == logging.WARNING


@pytest.mark.parametrize("error", [Cancelled("enough"), ValueError("bad"), KeyboardInterrupt()])
def test_what_ended_early_is_not_kept(error):
    thing, compute = Thing(), Computing()

    def fail():
        raise error

    with medialis.memory_limit(ROOM):
        with pytest.raises(type(error)):
            kept(Computing, thing, "a", fail, Progress())
        assert len(compute(thing, "a")) == 125 and compute.done == ["a"]


def test_threads_find_the_same():
    compute, thing, results = Computing(), Thing(), []
    with medialis.memory_limit(ROOM):
        compute(thing, "a")
        threads = [
            threading.Thread(target=lambda: results.append(compute(thing, "a"))) for _ in range(8)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert compute.done == ["a"] and all(result is results[0] for result in results)


# What shapes and results are found by


def copy_of(shape):
    return medialis.Shape(np.array(shape.points), np.array(shape.normals), np.array(shape.faces))


def test_equal_shapes_are_one_and_any_change_makes_another():
    shape = forms.icosphere(1)
    points, normals = np.array(shape.points), np.array(shape.normals)
    points[5, 2] = np.nextafter(points[5, 2], 9)
    normals[7] = -normals[7]
    changed = [
        replace(shape, points=points),
        replace(shape, normals=normals),
        replace(shape, faces=shape.faces[::-1]),
        replace(shape, faces=None),
        replace(shape, origin=np.arange(shape.point_count)),
    ]
    assert copy_of(shape).identity == shape.identity
    assert len({one.identity for one in (shape, *changed)}) == 6


def test_the_arrays_that_a_caller_can_write_to_are_not_those_of_the_shape():
    sphere = forms.icosphere(1)
    points = np.array(sphere.points)
    shape = medialis.Shape(points, sphere.normals, sphere.faces)
    before = shape.identity
    points[0] += 1
    assert (shape.points == sphere.points).all()
    assert medialis.Shape(points, sphere.normals, sphere.faces).identity != before == shape.identity


def test_pickles_hold_no_numbers_and_nothing_that_can_be_computed():
    shape = forms.icosphere(2)
    cloud = medialis.shrink_balls(shape)
    for known in (cloud.identity, cloud.inverse_features, shape.identity, shape.tree, shape.edges):
        assert known is not None
    again = pickle.loads(pickle.dumps(cloud))
    assert not {"_identity", "inverse_features"} & set(vars(again))
    assert not {"_identity", "tree", "edges"} & set(vars(again.surface))
    assert again.surface.identity == shape.identity  # its content is the same
    assert again.identity != cloud.identity
    assert (again.radii == cloud.radii).all() and (again.surface.edges == shape.edges).all()


# Operations

OPERATIONS = {
    "surface_skeleton": {"subsample": 0.01},
    "skeleton_importance": {"threshold": 0.02},
    "thickness": {"threshold": 0.1},
    "geodesic_path": {"end": 40},
    "skeleton_mesh": {"importance": 0.02},
}


@pytest.fixture(scope="module")
def creature():
    return medialis.organic_shape(56)


def assert_same(one, other):
    assert one.values == other.values and one.messages == other.messages
    assert [m.code for m in one.messages] == [m.code for m in other.messages]
    assert one.arrays.keys() == other.arrays.keys()
    for name, values in one.arrays.items():
        assert values.dtype == other.arrays[name].dtype
        assert values.tobytes() == other.arrays[name].tobytes(), name
    for mine, theirs in zip(one.layers, other.layers, strict=True):
        assert mine.points.tobytes() == theirs.points.tobytes()
        for name, values in mine.attributes.items():
            assert values.tobytes() == theirs.attributes[name].tobytes(), (mine.name, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", OPERATIONS)
def test_results_are_the_same_bits_with_and_without(creature, name):
    """First computed, then found; after the same with another late option; of an equal shape."""
    plain, late = (medialis.run(name, creature, **options) for options in ({}, OPERATIONS[name]))
    with medialis.memory_limit(ROOM):
        assert_same(medialis.run(name, creature), plain)
        assert_same(medialis.run(name, creature), plain)
        assert_same(medialis.run(name, creature, **OPERATIONS[name]), late)
        assert_same(medialis.run(name, copy_of(creature)), plain)


@pytest.mark.slow
@pytest.mark.parametrize("name", OPERATIONS)
def test_one_moved_vertex_is_computed_anew(creature, name):
    points = np.array(creature.points)
    points[1] += 1e-3 * creature.diagonal  # an end of the path from 0 to 1 as well
    moved = medialis.Shape(points, creature.normals, creature.faces)
    expected = medialis.run(name, moved)
    with medialis.memory_limit(ROOM):
        before = medialis.run(name, creature)
        after = medialis.run(name, moved)
    assert_same(after, expected)
    assert any(
        values.tobytes() != after.arrays[key].tobytes() for key, values in before.arrays.items()
    )


def counted(monkeypatch, module, name):
    calls, plain = [], getattr(module, name)

    def count(*arguments, **options):
        calls.append(name)
        return plain(*arguments, **options)

    monkeypatch.setattr(module, name, count)
    return calls


@pytest.mark.slow
def test_balls_and_geodesics_are_computed_once_for_all_operations(creature, monkeypatch):
    shrunk = counted(monkeypatch, preparation, "maximal_balls")
    traced = counted(monkeypatch, importance, "trace")
    joined = counted(monkeypatch, connectivity, "_raise_bridges")
    with medialis.memory_limit(ROOM):
        for threshold in (0.0, 0.01, 0.03):
            medialis.run("skeleton_importance", copy_of(creature), threshold=threshold)
            medialis.run("thickness", copy_of(creature), refine=0.02, threshold=threshold)
            medialis.run("skeleton_mesh", copy_of(creature), importance=threshold)
        medialis.run("surface_skeleton", creature, subsample=0.02)
        # Thickness has balls of its own: its tolerance turns with the shape. Fans are traced apart.
        assert (len(shrunk), len(traced), len(joined)) == (2, 2, 1)
        medialis.run("skeleton_importance", creature, tolerance=1e-3)
        assert (len(shrunk), len(traced), len(joined)) == (3, 3, 2)
        medialis.run("skeleton_importance", creature, directions=4)
        assert (len(shrunk), len(traced), len(joined)) == (3, 4, 3)


def test_results_are_held_by_whoever_holds_them_not_by_the_memory_alone(creature):
    with medialis.memory_limit(ROOM):
        cloud = medialis.surface_skeleton(creature)
        assert medialis.surface_skeleton(creature) is cloud
        medialis.forget()
        assert medialis.surface_skeleton(creature) is not cloud
    assert cloud.valid.any()


def test_callbacks_are_not_kept(creature):
    """A host's callback was held as long as the result, as part of the options."""
    import weakref

    class Callback:
        def __call__(self, fraction, text):
            return True

    callback = Callback()
    gone = weakref.ref(callback)
    with medialis.memory_limit(ROOM):
        medialis.surface_skeleton(creature, progress=callback)
        del callback
        assert gone() is None
        assert medialis.kept_bytes() > 0


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of the C library of Linux")
def test_memory_freed_on_the_way_to_a_large_result_goes_back_to_the_system(monkeypatch):
    def resident():
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))

    monkeypatch.setattr(memory, "LARGE", 1000)
    for size, is_given_back in ((100, False), (125, True)):
        arrays = [np.ones(1 << 13) for _ in range(2000)]  # 128 MB; the last one stays on top
        last = arrays.pop()
        del arrays
        before = resident()
        with medialis.memory_limit(ROOM):
            Computing(size)(Thing(), 0)
        assert (before - resident() > 60_000) == is_given_back
        assert last.all()
