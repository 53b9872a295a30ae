"""What the command line shows while it computes."""

import pytest

import medialis
from medialis.cli import display
from medialis.cli.display import summary_lines
from medialis.formats.output_folder import MANIFEST
from medialis.show.writing import describe_result


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


def test_a_result_takes_no_more_lines_than_a_screen_has():
    """A wall check of a bracket took 30; files that have no room are in the last line."""
    notes = [{"code": f"note_{k}", "warning": k == 4} for k in range(6)]
    manifest = {
        "operation": "wall_check", "input": "a.ply", "unit": "mm", "layers": [], "picture": None,
        "values": {f"value_{k}": float(k) for k in range(14)}, "notes": notes,
        "messages": [f"Sentence {k}." for k in range(6)], "seconds": {"total": 1.0},
        "files": [f"a/file_{k}.ply" for k in range(9)],
    }  # fmt: skip
    lines = list(display.summary_lines(manifest, 120))
    assert len(lines) == 25 and lines[15] == "warning: Sentence 4."
    assert lines[18] == "3 more with --verbose, and in manifest.json"
    assert lines[-1] == "  and file_4.ply, file_5.ply, file_6.ply, file_7.ply, file_8.ply"
    whole = list(display.summary_lines(manifest, 120, verbose=True))
    assert len(whole) == 1 + 14 + 6 + 1 + 9 and not whole[-1].startswith("  and")


def test_notes_on_how_it_was_computed_are_for_the_verbose():
    """`37,702 outer balls meet no second sample` says nothing to who asked for patches (fixed)."""
    manifest = {
        "operation": "patches", "input": "a.ply", "unit": None, "layers": [], "picture": None,
        "values": {}, "seconds": {"total": 1.0}, "files": ["a/manifest.json"],
        "notes": [{"code": "open_balls", "warning": False}, {"code": "round", "warning": True}],
        "messages": ["Balls are open.", "It is round."],
    }  # fmt: skip
    lines = list(display.summary_lines(manifest, 120))
    assert lines[1:3] == ["warning: It is round.", "1 more with --verbose, and in manifest.json"]
    assert "note: Balls are open." in display.summary_lines(manifest, 120, verbose=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", [one.name for one in medialis.OPERATIONS])
def test_a_default_run_takes_at_most_25_lines(name, default_run):
    """On any terminal, also where it replaces an earlier result; --verbose has all."""
    result = default_run(name)
    files = [f"{layer.name}.ply" for layer in result.layers] + [f"{name}.npz", MANIFEST]
    about = describe_result(result, input="creature.ply", picture=None, replaced={"a": 1})
    about |= {"files": [f"out/{file}" for file in files]}
    about["seconds"] |= {"total": 1.0}
    for width in (60, 80, 100, None):
        assert len(list(summary_lines(about, width))) <= 25, width


def test_files_with_numbers_are_one_line():
    names = [f"convex_pieces_piece_{k}.obj" for k in range(12)]
    manifest = {"operation": "convex_pieces", "files": [*names, "convex_pieces.urdf"],
                "picture": None, "layers": []}  # fmt: skip
    assert len(dict(display._files(manifest, verbose=True))) == 13
    told = dict(display._files(manifest, verbose=False))
    assert told.pop("convex_pieces_piece_0.obj ...") == "12 pieces, for the URDF file"
    assert list(told) == ["convex_pieces.urdf"]
    assert display.file_meanings(manifest)[names[3]] == "a piece, for the URDF file"
