"""What adapters do when another package is imported, and when they leave it alone."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
START = "meshlab_plugin/medialis_meshlab.pth"
TWICE = "m.add('host', 'adapter', 'act', alone='bare')"
OTHER = "m.add('host', 'gc', 'disable')"
FIND = "import importlib.util as u; u.find_spec('host')"


@pytest.fixture
def site(tmp_path):
    """A folder with a package `host`, an adapter that counts its calls, and their .pth file."""
    (tmp_path / "host").mkdir()
    (tmp_path / "host" / "__init__.py").write_text("from host import inner\nready = True")
    (tmp_path / "host" / "inner.py").write_text("")
    (tmp_path / "bare.py").write_text("import host")
    (tmp_path / "adapter.py").write_text(
        "import host\ncalls = []\n"
        "def act(): assert host.ready; calls.append(1)\n"
        "def fail(): raise OSError('no disk')"
    )
    return tmp_path


def run(site, code, function="act", **environment):
    start = (
        f"import sys; sys.path[:0] = [{str(site)!r}, {str(ROOT / 'core')!r}]\n"
        f"import medialis_after_import as m; m.add('host', 'adapter', {function!r}, alone='bare')\n"
    )
    command = [sys.executable, "-W", "error", "-c", start + code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


@pytest.mark.parametrize(
    ("code", "answer"),
    [
        ("import host, adapter; print(len(adapter.calls))", "1"),
        ("import adapter; print(len(adapter.calls))", "0"),
        ("import host.inner, adapter; print(len(adapter.calls))", "1"),
        (f"{FIND}; print('adapter' in sys.modules)", "False"),
        (f"{FIND}; import host, adapter; print(len(adapter.calls))", "1"),
        ("import bare; print('adapter' in sys.modules)", "False"),
        ("import json; print('adapter' in sys.modules, len(sys.meta_path) > 3)", "False True"),
        ("import host; print('after_import' in str(sys.meta_path))", "False"),
        (f"{TWICE}; import host, adapter; print(len(adapter.calls))", "1"),
        (f"{OTHER}; import host, gc; print(gc.isenabled())", "False"),
        (f"{OTHER}; import host, adapter; print(len(adapter.calls))", "1"),
    ],
)  # fmt: skip
def test_the_adapter_acts_once_after_the_import(site, code, answer):
    done = run(site, code)
    assert (done.stdout.strip(), done.stderr) == (answer, "")


def test_it_can_be_turned_off(site):
    done = run(site, "import host; print('adapter' in sys.modules)", MEDIALIS_AFTER_IMPORT="off")
    assert (done.stdout.strip(), done.stderr) == ("False", "")


def test_what_fails_is_a_warning_and_the_package_is_there(site):
    code = "import warnings; warnings.simplefilter('default'); import host; print(host.ready)"
    done = run(site, code, "fail")
    assert done.stdout.strip() == "True"
    assert "medialis does nothing for host: no disk" in done.stderr


def test_python_starts_quickly_and_without_the_core():
    """The module loads nothing that Python has not loaded by itself."""
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT / 'core')!r}); before = set(sys.modules)\n"
        "import medialis_after_import as m; m.add('host', 'adapter', 'act')\n"
        "print(*(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["medialis_after_import"]


def test_the_file_is_a_line_that_python_runs_at_its_start(tmp_path):
    """Only lines that begin with `import` are run; without the core it does nothing."""
    text = (ROOT / START).read_text()
    assert text.startswith("import ") and text.count("\n") == 1
    for core in (str(ROOT / "core"), str(tmp_path)):
        code = f"import sys; sys.path[:] = [{core!r}]\n{text}"
        command = [sys.executable, "-I", "-S", "-W", "error", "-c", code]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
