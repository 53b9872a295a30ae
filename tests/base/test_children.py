"""Processes that end with this one, and within their limits."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from medialis.base import children
from medialis.base.children import Ended, Limits, answer_of, job_limits
from medialis.base.errors import Cancelled
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently

SETTLED = "import sys; from medialis.base.children import settle; settle(*sys.argv[1:]); "
ANSWER = "data = sys.stdin.buffer.read(); sys.stdout.buffer.write(data[::-1])"
SPIN = "sys.stdin.buffer.read(); sum(iter(int, 1))"
WIDE = Limits(30.0, 1 << 30)
PIPE = """
import os, sys, time
from medialis.base.children import watch
watch(int(sys.argv[1]))
print(os.getpid(), flush=True)
time.sleep(60)
"""
PARENT = f"""
from medialis.base.children import Limits, answer_of
code = {SETTLED!r} + "import os; open('part', 'w').write(str(os.getpid())); "
code += "os.rename('part', 'pid'); " + {SPIN!r}
answer_of(code, b"", Limits(60.0, 1 << 30))
"""

unix = pytest.mark.skipif(os.name == "nt", reason="needs signals and limits of Unix")


def is_alive(process):
    """Whether a process is there, and no mere entry that waits for its parent."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(answer, seconds=20.0):
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not answer() and time.monotonic() < end:
        time.sleep(0.02)
    return answer()


@pytest.mark.slow
def test_a_process_answers_large_things():
    """What did not fit into the pipe at once never came (fixed before it was released)."""
    data = bytes(range(256)) * 10_000
    assert answer_of(SETTLED + ANSWER, data, WIDE) == data[::-1]


@pytest.mark.slow
def test_a_crash_is_told():
    with pytest.raises(Ended, match="code 7") as told:
        answer_of(SETTLED + "sys.exit(7)", b"", WIDE)
    assert not told.value.slow


@unix
@pytest.mark.slow
def test_processor_time_is_bounded():
    """A STEP file of 19 kB with the unit EXA kept a processor busy for ever (fixed)."""
    begin = time.monotonic()
    with pytest.raises(Ended) as told:
        answer_of(SETTLED + SPIN, b"", Limits(1.0, 1 << 30))
    assert told.value.slow and time.monotonic() - begin < 60


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="macOS has no limit of memory")
def test_memory_is_bounded():
    code = "sys.stdin.buffer.read(); x = bytearray(1 << 29); sys.stdout.write('had it')"
    assert answer_of(SETTLED + code, b"", Limits(30.0, 1 << 30)) == b"had it"
    with pytest.raises(Ended, match="code 1"):
        answer_of(SETTLED + code, b"", Limits(30.0, 1 << 28))


@unix
@pytest.mark.slow
def test_what_nobody_waits_for_is_killed(tmp_path):
    """Ctrl-C in a command left the reading process at 100 % for ever (fixed)."""
    path = tmp_path / "pid"
    code = f"import os; open({os.fspath(path)!r}, 'w').write(str(os.getpid())); "
    stopped = Progress(lambda fraction, text: not path.exists() or not path.read_text())
    with pytest.raises(Cancelled):
        run_patiently(lambda: answer_of(SETTLED + code + SPIN, b"", WIDE), stopped)
    assert wait_for(lambda: not is_alive(path.read_text()))


@pytest.mark.slow
@pytest.mark.parametrize("how", ["SIGKILL", "SIGTERM", "SIGABRT"])
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_it_ends_with_its_parent(tmp_path, how):
    parent = subprocess.Popen([sys.executable, "-c", PARENT], cwd=tmp_path)
    assert wait_for((tmp_path / "pid").exists)
    process = (tmp_path / "pid").read_text()
    assert is_alive(process)
    parent.send_signal(getattr(signal, how))
    parent.wait()
    assert wait_for(lambda: not is_alive(process))


@unix
@pytest.mark.slow
def test_where_the_system_kills_none_a_pipe_is_watched():
    """The way of macOS: the first half of a fork kills the second when the pipe has no end."""
    theirs, ours = os.pipe()
    command = [sys.executable, "-c", PIPE, str(theirs)]
    with subprocess.Popen(command, pass_fds=[theirs], stdout=subprocess.PIPE) as child:
        os.close(theirs)
        process = int(child.stdout.readline())
        assert process != child.pid
        os.kill(process, 0)  # it is there
        os.close(ours)
        assert child.wait(20) == -signal.SIGKILL
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_a_windows_job_is_told_what_the_system_reads():
    """The sizes and places of a structure of Windows; it could not be tried there."""
    told = job_limits(Limits(2.5, 1000))
    assert ctypes.sizeof(told) == 144 and type(told).process_memory.offset == 112
    assert told.basic.process_time == 25_000_000 and told.process_memory == 1000
    assert told.basic.flags == 0x2000 | 0x2 | 0x100
    assert job_limits(None).basic.flags == 0x2000


def test_a_python_that_cannot_start_is_told(monkeypatch):
    monkeypatch.setattr(children.sys, "executable", "/nowhere/python")
    with pytest.raises(Ended, match="cannot be started"):
        answer_of(SETTLED, b"", WIDE)
