"""Cancelling at any moment: no stage is silent for long, and what was cancelled leaves nothing."""

from collections import Counter

import numpy as np
import pytest

import medialis
from medialis.base import threads
from medialis.base.kept import DEFAULT_LIMIT
from medialis.base.threads import thread_limit
from medialis.formats.ply_attributes import write_ply
from medialis.operations.registry import OPERATIONS


@pytest.fixture(scope="module")
def creature():
    return medialis.organic_shape(56)


@pytest.fixture
def no_reports_by_the_clock(monkeypatch):
    """Reports of `run_patiently` come every 50 ms: how many depends on the machine."""
    monkeypatch.setattr(threads, "PATIENCE", 100.0)


def calls_of(work):
    """Return how often each stage called, with one thread; `run` takes its number by itself."""
    calls = Counter()
    with thread_limit(1), medialis.memory_limit(0):
        work(lambda fraction, text: calls.update([text]))
    return calls


@pytest.mark.slow
@pytest.mark.usefixtures("no_reports_by_the_clock")
def test_views_report_each_view(creature):
    """Sixteen views of a million triangles were rendered without a report: five seconds."""
    calls = calls_of(
        lambda told: medialis.run(
            "view_curve_skeleton", creature, pairs=20, size=128, threads=1, progress=told
        )
    )
    # Two views a pair; a view that is drawn already, and what ends at once, does not report.
    assert calls["pairs"] >= 20
    assert calls["sharpen"] >= 15
    assert calls["link"] >= 5


@pytest.mark.slow
@pytest.mark.usefixtures("no_reports_by_the_clock")
def test_candidates_report_often(creature):
    """Chunks of 64 candidates took half a second: each has 50 cuts that cross the whole shape."""
    cloud = medialis.surface_skeleton(creature)
    measured = medialis.candidate_measure(cloud)
    rows = np.flatnonzero(measured.measure > 0.015 * creature.diagonal)
    calls = calls_of(lambda told: medialis.area_importance(measured, rows, progress=told))
    assert sum(calls.values()) >= len(rows) / 8


@pytest.mark.slow
@pytest.mark.usefixtures("no_reports_by_the_clock")
def test_pictures_and_files_report(creature, tmp_path):
    """A picture of a million triangles was drawn without a report: five seconds."""
    result = medialis.run("surface_skeleton", creature)
    bands = 750 // 32
    calls = calls_of(lambda told: medialis.draw_result(result, progress=told))
    assert calls["draw"] >= bands  # three a band; those above and below the shape are not drawn
    calls = calls_of(lambda told: medialis.write_result(result, tmp_path / "out", progress=told))
    assert calls.keys() == {"write", "picture", "check"}
    assert calls["picture"] >= bands and calls["write"] >= len(result.layers)


@pytest.mark.usefixtures("no_reports_by_the_clock")
def test_each_step_of_reading_reports(creature, tmp_path):
    """Reading and repairing 537,000 vertices was one call of four seconds."""
    path = tmp_path / "creature.ply"
    write_ply(path, creature.points, creature.faces)
    calls = calls_of(lambda told: medialis.read_shape(path, progress=told))
    assert calls["read"] >= 3 and calls["prepare"] >= 6


@pytest.mark.slow
@pytest.mark.parametrize("name", [operation.name for operation in OPERATIONS])
def test_what_was_cancelled_leaves_no_trace(name, small_shape, default_run):
    """Cancelled in its 2nd, 4th, 10th, ... call and run again, with what is kept: as if never."""
    if name == "view_curve_skeleton":
        given = {"pairs": 8, "size": 64}
    else:
        given = {"end": 1000} if name == "geodesic_path" else {}
    creature = small_shape(name)
    wanted = medialis.run(name, creature, **given) if given else default_run(name)
    with medialis.memory_limit(DEFAULT_LIMIT):
        for allowed in (1, 3, 9, 27, 81):
            calls = Counter()

            def told(fraction, text, calls=calls, allowed=allowed):
                calls.update(["all"])
                return calls["all"] <= allowed

            try:
                medialis.run(name, creature, progress=told, **given)
            except medialis.Cancelled:
                continue
        again = medialis.run(name, creature, **given)
    assert again.values == wanted.values
    assert [str(message) for message in again.messages] == list(map(str, wanted.messages))
    for key, values in wanted.arrays.items():
        np.testing.assert_array_equal(again.arrays[key], values)
