"""Progress: nested spans, cancelling, messages and times."""

import logging
import time
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from medialis.base.errors import Cancelled
from medialis.base.progress import Progress


def test_nested_stages_span_their_share():
    seen = []
    progress = Progress(lambda fraction, text: seen.append((fraction, text)))
    with progress.stage("outer", 0.0, 0.5):
        with progress.stage("inner", 0.5, 1.0):
            progress.update(0.5)
        progress.update(1.0, "other")
    with progress.stage("last", 0.5, 1.0):
        pass
    assert seen == [
        (0.0, "outer"),
        (0.25, "inner"),
        (0.375, "inner"),
        (0.5, "inner"),
        (0.5, "other"),
        (0.5, "outer"),
        (0.5, "last"),
        (1.0, "last"),
    ]


@pytest.mark.slow
@settings(max_examples=200, deadline=None, derandomize=True)
@given(cuts=st.lists(st.floats(0, 1), max_size=6), inner=st.lists(st.floats(0, 1), max_size=4))
def test_fractions_never_fall_and_stay_within_0_and_1(cuts, inner):
    """Nested spans step back by a rounding error unless they are held (fixed)."""
    seen = []
    progress = Progress(lambda fraction, text: seen.append(fraction))
    bounds = [0.0, *sorted(cuts), 1.0]
    for begin, end in pairwise(bounds):
        with progress.stage("a", begin, end):
            parts = [0.0, *sorted(inner), 1.0]
            for b, e in pairwise(parts):
                with progress.stage("b", b, e):
                    progress.update(0.3)
    assert seen == sorted(seen) and seen[0] == 0 and seen[-1] == 1


def test_fractions_outside_are_clipped():
    seen = []
    progress = Progress(lambda fraction, text: seen.append(fraction))
    progress.update(-1)
    progress.update(2)
    assert seen == [0, 1]


@pytest.mark.parametrize("answer", [None, True, 0, "", 1])
def test_only_false_cancels(answer):
    Progress(lambda fraction, text: answer).update(0.5)


def test_false_cancels_and_the_span_is_restored():
    progress = Progress(lambda fraction, text: fraction < 0.4)
    with pytest.raises(Cancelled, match="nothing was written"), progress.stage("half", 0, 0.5):
        progress.update(0.9)
    assert "half" in progress.seconds
    seen = []
    progress._callback = lambda fraction, text: seen.append((fraction, text))
    progress.update(1.0)
    assert seen == [(1.0, "")]


def test_exceptions_of_the_callback_come_through():
    def interrupt(fraction, text):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Progress(interrupt).update(0.0)


def test_of_wraps_callbacks_only():
    progress = Progress()
    assert Progress.of(progress) is progress
    assert isinstance(Progress.of(None), Progress)
    seen = []
    Progress.of(lambda fraction, text: seen.append(fraction)).update(0.25)
    assert seen == [0.25]


def test_times_of_a_stage_add_up():
    progress = Progress()
    for _ in range(2):
        with progress.stage("wait", 0, 1):
            time.sleep(0.01)
    assert list(progress.seconds) == ["wait"] and progress.seconds["wait"] >= 0.02


def test_a_stage_within_one_of_its_name_counts_once():
    progress = Progress()
    start = time.perf_counter()
    with progress.stage("paths", 0.0, 1.0), progress.stage("paths", 0.0, 0.5):
        time.sleep(0.02)
    assert 0.02 <= progress.seconds["paths"] <= time.perf_counter() - start


def test_notes_are_kept_and_logged(caplog):
    progress = Progress()
    with caplog.at_level(logging.INFO, logger="medialis"):
        progress.note("two holes")
        progress.note("no normals", level=logging.WARNING)
    assert progress.messages == ["two holes", "no normals"]
    assert [record.levelname for record in caplog.records] == ["INFO", "WARNING"]
