"""A process that computes for a host: the same bits, kept stages, cancelling, crashes, views."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import medialis
from medialis.hosts import Computer, computing
from medialis.hosts.computing_child import pack, unpack

needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")


@pytest.fixture
def computer(tmp_path):
    made = Computer(tmp_path, {})
    yield made
    made.end()
    assert list(tmp_path.iterdir()) == []  # nothing that was handed over stays


@pytest.fixture(scope="module")
def shape():
    return medialis.organic_shape(56)


def begin(computer, shape, name="thickness", *, render=None, **parameters):
    return computer.run(name, shape.points, shape.faces, parameters, render=render)


def finished(computation):
    computation.wait()
    return computation.outcome()


@pytest.mark.slow
def test_results_are_those_of_this_process(computer, shape):
    read, result = finished(begin(computer, shape, "curve_skeleton", threshold=0.04))
    expected = medialis.make_shape(shape.points, shape.faces, repair=True)
    here = medialis.run("curve_skeleton", expected, threshold=0.04)
    assert np.array_equal(read.points, expected.points)
    assert [layer.name for layer in result.layers] == [layer.name for layer in here.layers]
    for one, other in zip(result.layers, here.layers, strict=True):
        assert np.array_equal(one.points, other.points)
        for name, values in other.attributes.items():
            assert np.array_equal(one.attributes[name], values, equal_nan=True)
    assert result.values == {"spacing": here.shape.spacing, **here.values}
    assert [m.code for m in result.messages if m.code] == [
        m.code for m in (*expected_messages(shape), *here.messages) if m.code
    ]


def expected_messages(shape):
    progress = medialis.Progress()
    medialis.make_shape(shape.points, shape.faces, repair=True, progress=progress)
    return progress.messages


@pytest.mark.slow
def test_a_late_option_is_answered_from_what_is_kept(computer, shape):
    """The process stays, also for equal arrays that are others."""
    first = finished(begin(computer, shape, "curve_skeleton"))[1]
    process = computer._process.pid
    points, faces = shape.points.copy(), shape.faces.copy()
    second = computer.run("curve_skeleton", points, faces, {"threshold": 0.1})
    second.wait()
    assert computer._process.pid == process
    assert "surface_skeleton" not in second.outcome()[1].seconds
    assert second.outcome()[1].seconds["total"] < first.seconds["total"]


@pytest.mark.slow
def test_progress_rises(computer, shape):
    seen = []
    computation = begin(computer, shape)
    computation.wait(lambda fraction, text: seen.append(fraction))
    assert seen == sorted(seen) and computation.fraction == 1.0 and computation.done


@pytest.mark.slow
def test_cancelling_ends_at_once_and_the_process_serves_again(computer, shape):
    finished(begin(computer, shape))
    computation = begin(computer, shape, "surface_skeleton")
    computation.cancel()
    computation.cancel()
    assert computation.done
    with pytest.raises(medialis.Cancelled):
        computation.outcome()
    assert finished(begin(computer, shape))[1].operation == "thickness"


@pytest.mark.slow
def test_a_process_that_does_not_come_back_is_replaced(computer, shape, monkeypatch):
    monkeypatch.setattr(computing, "SECONDS_TO_COME_BACK", 0.0)
    begin(computer, shape, "surface_skeleton").cancel()
    process = computer._process
    assert finished(begin(computer, shape))[1].operation == "thickness"
    assert computer._process is not process and process.returncode is not None


@needs_signals
@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "sentence"),
    [
        ("SIGKILL", "as it does when memory runs out"),
        ("SIGSEGV", r"unexpectedly \(signal 11\)\. N"),
    ],
)
def test_a_crash_is_a_sentence(computer, shape, number, sentence):
    """Every end of the process was told as a lack of memory."""
    finished(begin(computer, shape))
    computer._process.send_signal(signal.SIGSTOP)  # or it may be done before the signal comes
    computation = begin(computer, shape)
    computer._process.send_signal(getattr(signal, number))
    computer._process.send_signal(signal.SIGCONT)
    computation.wait()
    with pytest.raises(medialis.MedialisError, match=sentence):
        computation.outcome()
    assert finished(begin(computer, shape))[1].operation == "thickness"


@pytest.mark.parametrize(
    ("module", "sentence"),
    [
        ("numpy", "The process that computes could not start (code 1): ImportError: Not there."),
        ("scipy", "medialis needs is not there or does not work: ImportError: Not there."),
    ],
)
def test_a_module_that_is_missing_is_named(tmp_path, shape, capfd, module, sentence):
    """It was told as a lack of memory where the process imports it first of all."""
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / f"{module}.py").write_text('raise ImportError("Not there.")')
    (tmp_path / "exchange").mkdir()
    path = os.pathsep.join([str(tmp_path / "first"), *sys.path])
    computer = Computer(tmp_path / "exchange", {"PYTHONPATH": path})
    with pytest.raises(medialis.MedialisError, match=re.escape(sentence)):
        finished(begin(computer, shape, "curve_skeleton"))  # `thickness` does without scipy
    computer.end()
    assert "Traceback" in capfd.readouterr().err
    assert list((tmp_path / "exchange").iterdir()) == []


def test_a_python_without_its_library_says_so(computer, shape):
    computer.environment = dict.fromkeys(("PYTHONHOME", "PYTHONPATH"), str(computer.folder))
    with pytest.raises(medialis.MedialisError, match=r"could not start \(code 1\): .*encodings"):
        finished(begin(computer, shape))


HOST = """
import sys, time, medialis
from medialis.hosts import Computer
from pathlib import Path
folder, moment = Path(sys.argv[1]), sys.argv[2]
computer = Computer(folder, {})
shape = medialis.organic_shape(56)
computation = computer.run(
    "view_curve_skeleton", shape.points, shape.faces, {"pairs": 3000 if moment == "work" else 6}
)
until = {"start": -1.0, "work": 0.11, "rest": 2.0}[moment]
while computation.fraction < until and not computation.done:
    computation.look()
    computer.listen(0.02)
print(computer._process.pid, computation.done, flush=True)
time.sleep(100)
"""


@needs_signals
@pytest.mark.slow
@pytest.mark.parametrize("moment", ["start", "work", "rest"])
def test_it_is_gone_when_its_host_is_killed(tmp_path, moment):
    """Whatever it is doing, and nobody has told it: the host had no time for last words."""
    folder = tmp_path / "medialis-run"
    folder.mkdir()
    command = [sys.executable, "-c", HOST, str(folder), moment]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as host:
        process, done = host.stdout.readline().split()
        assert done == str(moment == "rest") and is_running(int(process))
        host.kill()
    end = time.monotonic() + 20  # it may be importing, on a busy machine
    while is_running(int(process)) and time.monotonic() < end:
        time.sleep(0.02)
    assert not is_running(int(process))
    assert not list(tmp_path.iterdir())


SLOW = """
import os, sys, time
from multiprocessing import Pipe
from medialis.hosts import computing_child as child
clear_up = child.clear_up
child.clear_up = lambda: (time.sleep(0.5), clear_up())
os.chdir(sys.argv[1])
here, there = Pipe()
here.close()
child.Host(there).tell("ready")
"""


def test_words_to_a_host_that_is_gone_do_not_end_what_clears_up(tmp_path):
    """The process ended by the error of its word while another thread was at it."""
    folder = tmp_path / "medialis-run"
    folder.mkdir()
    (folder / "medialis-1.arrays").touch()
    done = subprocess.run([sys.executable, "-c", SLOW, str(folder)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "")
    assert not folder.exists()


ENDED = """
import os, sys, time
from multiprocessing import Pipe
from medialis.hosts import computing_child as child
listen = child.Host._listen
child.Host._listen = lambda self: (time.sleep(0.5), listen(self))
os.chdir(sys.argv[1])
here, there = Pipe()
here.send(("end",))
here.close()
child.Host(there).tell("progress", 0.5, "")
"""


def test_what_a_host_that_ends_it_has_is_left_alone(tmp_path):
    """Its pipe is closed before the process has read that it shall end; the host goes on."""
    folder = tmp_path / "medialis-run"
    folder.mkdir()
    (folder / "medialis-1.arrays").touch()
    command = [sys.executable, "-c", ENDED, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert list(folder.iterdir()) == [folder / "medialis-1.arrays"]


def is_running(process):
    """Tell whether a process is there; one that has ended may wait for someone to ask how."""
    asked = ["ps", "-o", "stat=", "-p", str(process)]
    state = subprocess.run(asked, capture_output=True, text=True).stdout.strip()
    return state != "" and not state.startswith("Z")


@pytest.mark.slow
def test_errors_are_those_of_the_core(computer, shape):
    computation = begin(computer, shape, tolerance=7.0)
    computation.wait()
    with pytest.raises(medialis.InvalidOptionError):
        computation.outcome()
    computation = begin(computer, medialis.Shape(np.zeros((1, 3)), np.zeros((1, 3))))
    computation.wait()
    with pytest.raises(medialis.MedialisError):
        computation.outcome()


def test_a_python_that_is_missing_is_a_sentence(computer, shape, monkeypatch):
    monkeypatch.setattr(sys, "executable", "no/such/python")
    with pytest.raises(medialis.MedialisError, match="Python cannot be started"):
        begin(computer, shape)


def test_another_version_asks_for_a_restart(computer, shape, monkeypatch):
    monkeypatch.setattr(computing, "VERSION", "1.9")
    computation = begin(computer, shape)
    computation.wait()
    with pytest.raises(medialis.MedialisError, match=r"updated from 1\.9 .*: restart"):
        computation.outcome()


@pytest.mark.slow
def test_the_host_renders_views(computer, shape):
    calls = []

    def render(points, faces):
        source = medialis.rasterizer(medialis.make_shape(points, faces))
        return lambda cameras: calls.append(len(cameras)) or source(cameras)

    quick = {"pairs": 6, "size": 64}
    _, result = finished(begin(computer, shape, "view_curve_skeleton", render=render, **quick))
    here = medialis.run("view_curve_skeleton", shape, **quick)
    assert sum(calls) >= 12
    assert np.array_equal(result.layers[0].points, here.layers[0].points)


@pytest.mark.slow
def test_a_host_that_cannot_render_is_told_and_replaced(computer, shape):
    quick = {"pairs": 6, "size": 64}
    _, result = finished(
        begin(computer, shape, "view_curve_skeleton", render=lambda *_: "No driver.", **quick)
    )
    assert "No driver." in result.messages

    def fails(*_):
        raise RuntimeError("lost the device")

    computation = begin(computer, shape, "view_curve_skeleton", render=fails, **quick)
    computation.wait()
    with pytest.raises(medialis.MedialisError, match="lost the device"):
        computation.outcome()


def test_parcels_keep_arrays_and_leave_nothing(tmp_path, shape):
    odd = np.arange(3, dtype=np.int8)
    things = {"points": shape.points, "odd": odd, "none": None, "shape": shape}
    found = unpack(pack(things, tmp_path))
    assert np.array_equal(found["points"], shape.points) and found["odd"].tolist() == [0, 1, 2]
    assert not found["points"].flags.writeable
    assert found["points"].ctypes.data % 8 == 0
    assert np.array_equal(found["shape"].faces, shape.faces)
    assert list(tmp_path.iterdir()) == []
    assert unpack(pack("word", tmp_path)) == "word"
    with pytest.raises(medialis.FileError, match="Cannot hand arrays over"):
        pack(things, tmp_path / "missing")


@pytest.mark.slow
def test_compiling_moves_the_bar(tmp_path, shape):
    """With an empty folder of kernels: it says what it does, and how many pieces there are."""
    settings = {"MEDIALIS_CACHE_DIR": str(tmp_path / "kernels"), "MEDIALIS_KERNELS": "numba"}
    computer = Computer(tmp_path, settings)
    flat = medialis.make_shape(shape.points, shape.faces)
    computation = begin(computer, flat, "smooth")
    compiling = []

    def told(fraction, text):
        """Cancels when there was enough: the rest is the same again."""
        if text.startswith("compiling"):
            compiling.append(fraction)
        if len(set(compiling)) > 4:
            computation.cancel()

    computation.wait(told)
    computer.end()
    with pytest.raises(medialis.Cancelled):
        computation.outcome()
    assert compiling == sorted(compiling) and len(set(compiling)) > 4
