"""Kernels made ahead of time: used without numba, only when they are whole and up to date."""

import ast
import importlib
import json
import logging
import os
import re
import runpy
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import medialis
from medialis.base import cache_folder, jit
from medialis.base._box_tree_kernels import nearest_places
from medialis.base._kernels import group_keys
from medialis.hosts import compile_ahead

PACKAGE = Path(cache_folder.PACKAGE)
BUILD = PACKAGE.parent / "kernel_library" / "build.py"
library = runpy.run_path(str(BUILD))

made = pytest.mark.skipif(not jit.record(), reason="kernels are not made ahead: make kernels")
whole = pytest.mark.skipif(
    os.environ.get("MEDIALIS_KERNELS") == "numba", reason="numba compiles in this run"
)


def test_every_kernel_that_python_calls_is_listed():
    """One that is added has to be in the list that is compiled from."""
    wanted = set()
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if not path.name.endswith("kernels.py") and "kernels import" in text:
            wanted |= called_in(path)
    listed = set(library["exported"]())
    assert not wanted - listed, "python benchmarks/record_kernels.py"


def called_in(path):
    """The kernels that a module imports by name: objects with a Python function in them."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").endswith("kernels"):
            module = importlib.import_module(node.module)
            for alias in node.names:
                if hasattr(getattr(module, alias.name), "py_func"):
                    found.add(f"{node.module.removeprefix('medialis.')}:{alias.name}")
    return found


@made
@whole
def test_what_is_made_is_what_is_listed():
    """Where modules are made they are those of the sources and of the list as they are."""
    for name, variants in library["exported"]().items():
        feature = name.partition(".")[0]
        for about in filter(None, map(jit.record().get, modules_of(feature))):
            assert about["stamp"] == jit.stamp_of(feature), f"make kernels: {feature}"
            codes = {code for code, _ in about["kernels"][name]}
            assert codes == {jit.code_of(words) for words in variants}, f"make kernels: {name}"


def modules_of(feature):
    return [f"{feature}/{jit.MADE}", f"{feature}/{jit.MADE_V3}"]


@made
@whole
def test_balls_have_code_for_newer_processors_which_is_chosen(monkeypatch):
    """Elsewhere the code for all is taken. `self_test.py` holds both against numba."""
    where, name = "skeleton._ball_kernels", "shrink_balls"
    plain, newer = map(jit.record().get, modules_of("skeleton"))
    if newer is None:
        pytest.skip("modules for newer processors are made on x86-64 alone")
    dispatch = jit._module("base", jit.DISPATCH)
    ((_, symbol),) = newer["kernels"][f"{where}:{name}"]
    for runs, module in ((1, jit.MADE_V3), (0, jit.MADE)):
        monkeypatch.setattr(dispatch, "RUNS_V3", runs)
        ((_, function),) = jit._variants(where, name)
        assert function is getattr(jit._module("skeleton", module), symbol)
    assert plain["kernels"] == newer["kernels"]


BLOCKED = """
import sys, threading
class Block:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("numba", "llvmlite"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Block())
import medialis
from medialis.shape import samples
given = {"view_curve_skeleton": {"pairs": 10, "size": 96}, "medial_mesh": {"balls": 20}}
shape, bracket = (samples._MADE[name][0](64) for name in ("creature", "bracket"))
def run(name):
    result = medialis.run(name, bracket if name == "midsurface" else shape, **given.get(name, {}))
    medialis.draw_result(result, width=320, height=240)
names = [one.name for one in medialis.OPERATIONS]
for name in names[::2]:
    run(name)
failed = []
def run_all(some):
    try:
        for name in some:
            run(name)
    except BaseException as error:
        failed.append(f"{name}: {error}")
threads = [threading.Thread(target=run_all, args=(names[k::4],)) for k in (1, 3)]
for one in threads: one.start()
for one in threads: one.join()
assert not failed, failed
assert not {"numba", "llvmlite"} & set(sys.modules)
"""


@made
@whole
@pytest.mark.slow
def test_every_operation_runs_where_there_is_no_numba():
    """With its picture, also in threads."""
    environment = {n: v for n, v in os.environ.items() if n != "MEDIALIS_KERNELS"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", BLOCKED],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


def copied(folder):
    """Copy what `find_root` and `group_keys` need of the package, with the made modules."""
    (folder / "medialis").mkdir()
    for name in ("__init__.py", "__init__.pyi", "base"):
        source, target = PACKAGE / name, folder / "medialis" / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, target)
    return folder / "medialis" / "base"


GROUP = """
import logging, sys
logging.basicConfig(format="%(message)s")
import numpy as np
from medialis.base import jit
from medialis.base._kernels import group_keys
order = np.zeros(3, np.int32)
group_keys(np.array([1, 0, 0], np.int64), np.zeros(4, np.int64), order)
assert list(order) == [1, 2, 0]
from medialis.base._box_tree_kernels import nearest_places
places = np.zeros((1, 2))
nearest_places(np.zeros((1, 3)), np.ones((1, 3, 3)), places)
print("numba" in sys.modules)
"""


def grouped(folder):
    """Whether numba was needed, and the lines of the log."""
    environment = dict(os.environ, PYTHONPATH=str(folder))
    environment.pop("MEDIALIS_KERNELS", None)
    done = subprocess.run(
        [sys.executable, "-c", GROUP], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip() == "True", done.stderr.splitlines()


@made
@whole
@pytest.mark.slow
@pytest.mark.parametrize(
    ("damage", "said"),
    [
        ("none", ""),
        ("deleted", "No such file"),
        ("cut off", "is cut off"),
        ("of another Python", "were made for another-python"),
        ("no module at all", "cannot be loaded"),
        ("record of another kind", "cannot be looked up"),
    ],
)
def test_a_module_that_is_not_whole_is_left_to_numba(tmp_path, damage, said):
    """The answer is the same, and the log says so once."""
    base = copied(tmp_path)
    (module,) = base.glob(f"{jit.MADE}*{jit.TAG}*")
    record = base / jit.RECORD.name
    if damage == "deleted":
        module.unlink()
    elif damage == "cut off":
        module.write_bytes(module.read_bytes()[:-5000])
    elif damage == "of another Python":
        record.rename(base / "made-another-python.json")
    elif damage == "no module at all":
        module.write_bytes(b"x" * module.stat().st_size)
    elif damage == "record of another kind":
        record.write_text("{")
    numba, lines = grouped(tmp_path)
    assert numba == (damage != "none")
    assert len(lines) == (damage != "none") and all(said in line for line in lines), lines


@made
@whole
@pytest.mark.slow
def test_an_edited_kernel_is_not_run_from_what_was_made(tmp_path):
    """In a clone sources change; the old code must not answer for them."""
    base = copied(tmp_path)
    with (base / "_kernels.py").open("a") as stream:
        stream.write("\n# edited\n")
    assert grouped(tmp_path) == (True, [])


def test_the_stamp_follows_called_kernels():
    """The code of a kernel holds that of the kernels it calls, in other features too."""
    assert "base/_box_tree_kernels.py" in jit.sources_of("sheets")
    assert "skeleton/importance/_walk_kernels.py" in jit.sources_of("sheets")
    assert "walls/_kernels.py" not in jit.sources_of("sheets")


@made
@whole
def test_what_fits_no_variant_never_gets_to_the_code(monkeypatch):
    """The made functions look at no type: another one would be read as if it were the right one."""
    assert os.environ["MEDIALIS_KERNELS"] == "made", "a module that was imported has changed it"
    monkeypatch.setattr(group_keys, "dispatcher", None)  # another test may have had it compiled
    keys, ends = np.zeros(3, np.int64), np.zeros(3, np.int64)
    wrong = [
        (keys.astype(np.int16), ends, np.zeros(3, np.int32)),
        (keys.astype(float), ends, np.zeros(3, np.int32)),
        (np.zeros(6, np.int64)[::2], ends, np.zeros(3, np.int32)),
        (keys.astype(">i8"), ends, np.zeros(3, np.int32)),
        (keys.reshape(3, 1), ends, np.zeros(3, np.int32)),
        (list(keys), ends, np.zeros(3, np.int32)),
        (keys, ends),
        (keys, ends, None),
        (keys, ends, np.zeros(3, np.int32), 1),
    ]
    group_keys(keys, ends, np.zeros(3, np.int32))
    for arguments in wrong:
        with pytest.raises(medialis.MedialisError, match="Not made ahead: base"):
            group_keys(*arguments)
    with pytest.raises(TypeError, match="by place"):
        group_keys(keys, ends, out=keys)


@made
@whole
def test_read_only_arrays_fit_and_give_the_same():
    queries = np.random.default_rng(0).normal(size=(50, 3))
    corners = np.random.default_rng(1).normal(size=(50, 3, 3))
    first, second = np.zeros((50, 2)), np.zeros((50, 2))
    nearest_places(queries, corners, first)
    queries.flags.writeable = corners.flags.writeable = False
    nearest_places(queries, corners, second)
    assert first.tobytes() == second.tobytes() and first.any()


def test_no_kernel_runs_threads():
    """What is made ahead counts references to arrays without locks (`build.py`)."""
    for path in PACKAGE.rglob("*kernels.py"):
        found = re.search(r"\b(prange|parallel=|objmode)", path.read_text(encoding="utf-8"))
        assert found is None, f"{path}: {found}"


def test_other_threads_run_while_a_kernel_does():
    queries, corners = np.zeros((200_000, 3)), np.ones((200_000, 3, 3))
    places, ended = np.zeros((200_000, 2)), threading.Event()

    def work():
        for _ in range(20):
            nearest_places(queries, corners, places)
        ended.set()

    nearest_places(queries[:1], corners[:1], places[:1])  # loaded or compiled
    thread, ticks = threading.Thread(target=work), 0
    thread.start()
    while not ended.is_set():
        ticks += 1
        time.sleep(0.0005)
    thread.join()
    assert ticks > 25  # one between two calls is all that a held lock would let through


def test_without_code_and_without_numba_a_sentence_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "medialis.base.compiling", None)
    monkeypatch.setenv("MEDIALIS_KERNELS", "")

    def nothing():
        raise AssertionError

    with pytest.raises(ModuleNotFoundError):  # of our own module: no sentence hides that
        jit.kernel(nothing)()
    monkeypatch.delitem(sys.modules, "medialis.base.compiling")
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(medialis.MedialisError, match="numba is missing: `pip install numba`"):
        jit.kernel(nothing)()


def test_what_is_not_made_can_be_noted(tmp_path, monkeypatch):
    """By this the list grows: a run of the tests notes what it misses."""
    note = tmp_path / "noted.txt"
    monkeypatch.setenv("MEDIALIS_KERNELS", f"note:{note}")
    assert jit.kernel(lambda a, b: a[0] + b)(np.array([2.0]), 1) == 3.0
    name, operations, words = note.read_text().strip().split("|")
    assert name.endswith(":<lambda>") and operations == ""
    assert json.loads(words) == ["f8:1C", "i8"]
    examples = [compile_ahead.example(word) for word in json.loads(words)]
    assert jit.words_of(tuple(examples)) == ["f8:1C", "i8"]


def test_settings_that_change_code_leave_it_to_numba(monkeypatch):
    jit.record.cache_clear()
    try:
        monkeypatch.setenv("NUMBA_BOUNDSCHECK", "1")
        assert jit.record() == {}
    finally:
        jit.record.cache_clear()


def test_the_log_says_it_once(monkeypatch, caplog):
    monkeypatch.setattr(jit, "_said", [])
    with caplog.at_level(logging.WARNING, logger="medialis"):
        jit._warn("are of clay")
        jit._warn("are of wax")
    assert [record.getMessage()[:31] for record in caplog.records] == [
        "Kernels made ahead are of clay."
    ]


def test_a_wheel_is_built_with_the_numba_that_was_tried(monkeypatch):
    """Its module compiler is no promise of its makers: without an end it would break one day."""
    backend = runpy.run_path(str(PACKAGE.parents[1] / "build_backend.py"))
    monkeypatch.delenv("MEDIALIS_PURE", raising=False)
    if backend["why_pure"]() is not None:
        pytest.skip("no wheel with machine code can be built here")
    (numba,) = (x for x in backend["get_requires_for_build_wheel"]() if x.startswith("numba>"))
    assert "<" in numba and ">=" in numba


@made
def test_the_record_names_features_that_have_kernels():
    """One whose kernels had moved stayed in the record, and so in wheels (fixed)."""
    features = {name.partition(".")[0] for name in library["exported"]()}
    assert {one.partition("/")[0] for one in jit.record()} <= features
