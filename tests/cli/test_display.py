"""What the command line shows while it computes."""

import pytest

from medialis.cli import display


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets."""
    now = [100.0]
    monkeypatch.setattr("medialis.cli.display.time.monotonic", lambda: now[0])
    return now


def test_a_log_tells_the_time_left_and_is_short(clock, capsys):
    """A resumed batch starts at a half: what was finished before says nothing about speed."""
    progress = display.shown_progress("auto", batch=True)  # not a terminal
    progress.update(0.5, "100 of 200")
    for step in range(1, 101):
        clock[0] += 1.25
        progress.update((100 + step) / 200, f"{100 + step} of 200, 1 failed: shape_{step}")
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == " 50 % 100 of 200"
    assert lines[1] == " 54 % 2 min left, 108 of 200, 1 failed: shape_8"
    assert len(lines) == 14 and lines[-1] == "100 % 200 of 200, 1 failed: shape_100"


def test_a_bar_fills_the_line_of_a_terminal_and_vanishes(clock, capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setattr(display, "_columns", lambda: 70)
    progress = display.shown_progress("auto", batch=True)
    progress.update(0.0, "0 of 4")
    clock[0] += 1.0
    progress.update(0.25, "1 of 4: a shape with a long, long name")
    _, first, second = capsys.readouterr().err.split("\r")
    assert len(first) == len(second) == 69
    assert first.rstrip() == "." * 30 + "   0 % 0 of 4"
    assert second == "#######" + "." * 23 + "  25 % 4 s left, 1 of 4: a shape with a"
    progress.update(0.5, "too soon for the eye")
    progress.update(1.0, "4 of 4")
    assert capsys.readouterr().err == f"\r{'':69}\r"


def test_a_single_run_is_silent_in_a_log(capsys):
    display.shown_progress("auto").update(0.5, "half")
    display.shown_progress("none", batch=True).update(0.5, "half")
    assert capsys.readouterr().err == ""
