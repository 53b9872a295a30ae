"""The window of the real MeshLab 2020.09: filters one after another, errors, cancelling."""

import time

import numpy as np
import pytest

import medialis
from medialis.formats.ply_attributes import write_ply
from meshlab_screen import ABOVE_DEFAULT, APPLY, meshlab_window
from real_meshlab import make_meshlab, need, x_server

pytestmark = pytest.mark.slow

SKELETON = "Generate Medial Curve Skeleton"
THICKNESS = "Compute Scalar by Medial Thickness per Vertex"
DIRECTIONS = (0.6, 181)
"""The field of this name in the dialog of geodesics."""


@pytest.fixture(scope="module")
def meshlab(tmp_path_factory):
    need("xdotool")
    with x_server() as display:
        yield make_meshlab(tmp_path_factory.mktemp("meshlab") / "with space ä", display)


@pytest.fixture
def calls(meshlab, tmp_path, monkeypatch):
    """The operations that were started, one a line."""
    log, program = tmp_path / "calls", tmp_path / "medialis"
    log.touch()
    real = meshlab.environment["MEDIALIS_PROGRAM"]
    program.write_text(f'#!/bin/sh\necho "$1" >> "{log}"\nexec "{real}" "$@"\n')
    program.chmod(0o755)
    monkeypatch.setitem(meshlab.environment, "MEDIALIS_PROGRAM", str(program))
    return lambda: log.read_text().split()


@pytest.fixture(scope="module")
def shape(tmp_path_factory):
    made = medialis.organic_shape(56)
    path = tmp_path_factory.mktemp("shapes") / "creature.ply"
    write_ply(path, made.points.astype(np.float32).astype(np.float64), faces=made.faces)
    return path


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    made = medialis.organic_shape(200)
    path = tmp_path_factory.mktemp("shapes") / "large.ply"
    write_ply(path, made.points, faces=made.faces)
    return path


def test_two_filters_in_a_row_have_no_preview_and_run_once_each(meshlab, shape, calls):
    """Where MeshLab puts its box Preview there is none: a click there starts nothing."""
    with meshlab_window(meshlab, [shape]) as screen:
        for number, (title, operation) in enumerate(
            ((SKELETON, "curve-skeleton"), (THICKNESS, "thickness"), (SKELETON, "curve-skeleton"))
        ):
            screen.choose(title)
            screen.click(*screen.place(title, ABOVE_DEFAULT))
            time.sleep(2.0)
            assert screen.child() == "" and len(calls()) == number
            screen.apply(title)
            assert calls()[-1] == operation and len(calls()) == number + 1
            screen.close(title)
        assert screen.process.poll() is None


def test_a_mistake_is_a_box_and_the_window_goes_on(meshlab, shape, calls):
    """A number out of its range starts no program; one that is right does."""
    title = "Generate Medial Geodesic Path"
    with meshlab_window(meshlab, [shape]) as screen:
        screen.choose(title)
        screen.click(*screen.place(title, DIRECTIONS))
        screen.key("ctrl+a")
        screen.xdotool("type", "100000")
        screen.click(*screen.place(title, APPLY))
        screen.wait(lambda: screen.windows("Filter Failure"))
        assert calls() == [] and screen.child() == ""
        screen.key("Return")
        time.sleep(1.0)
        screen.click(*screen.place(title, DIRECTIONS))
        screen.key("ctrl+a")
        screen.xdotool("type", "20")
        screen.apply(title)
        assert calls() == ["geodesic-path"] and not screen.windows("Filter Failure")


def test_escape_cancels_and_the_window_goes_on(meshlab, large, calls):
    with meshlab_window(meshlab, [large]) as screen:
        screen.choose(SKELETON)
        screen.apply(SKELETON, to_its_end=False)
        time.sleep(1.5)
        screen.key("Escape")
        screen.wait(lambda: screen.windows("Filter Failure"), seconds=10)
        assert screen.child() == ""
        screen.key("Return")
        time.sleep(1.0)
        assert not any((meshlab.folder / "temporary").iterdir())
        screen.apply(SKELETON)
        assert calls() == ["curve-skeleton", "curve-skeleton"]
        assert not screen.windows("Filter Failure")


def test_two_windows_at_once(meshlab, shape, calls):
    """Each has its own child and its own folder; neither waits for the other."""
    with meshlab_window(meshlab, [shape]) as first:
        first.choose(THICKNESS)
        dialog = first.windows(f"^{THICKNESS}$")[0]
        first.xdotool("windowmove", first.windows("^MeshLab 2020")[0], 2000, 0)
        first.xdotool("windowmove", dialog, 780, 0)
        with meshlab_window(meshlab, [shape]) as second:
            second.choose(SKELETON)
            second.apply(SKELETON, to_its_end=False)

            def both() -> bool:
                first.xdotool("windowraise", dialog)
                time.sleep(0.5)
                if len(calls()) < 2:
                    first.click(*first.place(THICKNESS, APPLY))
                return len(calls()) == 2

            first.wait(both)
            for screen in (first, second):
                screen.wait(lambda screen=screen: not screen.child())
                assert screen.process.poll() is None
                assert not screen.windows("Filter Failure")
        assert sorted(calls()) == ["curve-skeleton", "thickness"]
        assert not any((meshlab.folder / "temporary").iterdir())
