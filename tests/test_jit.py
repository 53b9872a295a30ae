"""The kernel cache, and which module may import what."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from medialis._kernels import cache_folder

PACKAGE = Path(cache_folder.PACKAGE)
LAYERS = [
    {"errors", "progress", "threads", "validation", "version", "kept", "options", "_kernels"},
    {"model"},
    {"files"},
    {"surface"},
    {"balls"},
    {"paths"},
    {"mesh"},
    {"fields"},
    {"sheets"},
    {"clouds"},
    {"render"},
    {"curves"},
    {"rigging"},
    {"segments"},
    {"operations"},
    {"hosts"},
    {"reports"},
    {"batches"},
    {"cli", "__main__"},
]
"""Each imports from its own layer and those above it in this list."""

COMPUTE = """\
import numpy as np
from medialis._kernels.union_find_kernels import find_root
print(find_root(np.array([0, 0, 1], np.int32), 2))
"""


def modules():
    return sorted(PACKAGE.rglob("*.py"))


def is_kernel_module(path):
    return path.parent.name == "_kernels" or path.name.endswith("_kernels.py")


def imports(path):
    """Names of all modules that a file imports anywhere, TYPE_CHECKING blocks left out."""
    found = set()

    def visit(node):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
            if node.module == "medialis":
                found.update(f"medialis.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return found


def layer(name):
    return next(i for i, names in enumerate(LAYERS) if name in names)


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_point_downwards(path):
    relative = path.relative_to(PACKAGE)
    if relative.as_posix() == "__init__.py":
        return
    own = layer(relative.parts[0].removesuffix(".py"))
    for name in imports(path):
        parts = name.split(".")
        if parts[0] != "medialis":
            continue
        assert len(parts) > 1, f"{relative} imports the public package"
        assert layer(parts[1]) <= own, f"{relative} imports {name}"


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_only_kernel_modules_import_numba(path):
    """And kernels use only numpy, numba and each other: all they compile is in the cache's hash."""
    names = {name.split(".")[0] for name in imports(path)}
    if not is_kernel_module(path):
        assert "numba" not in names
        return
    assert path in cache_folder.kernel_sources()
    if path.name not in (
        "box_tree.py",
        "cache_folder.py",
        "jit.py",
        "nearest.py",
    ):  # Python code around kernels
        for name in imports(path):
            root = name.split(".")[0]
            if root == "medialis":
                assert is_kernel_module(PACKAGE / Path(*name.split(".")[1:]).with_suffix(".py"))
            else:
                assert root in {"numpy", "numba", "math", "__future__"}, name


def test_importing_the_package_loads_no_compiled_code():
    code = "import sys, medialis, medialis.cli.commands; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_hash_covers_every_kernel_source(tmp_path, monkeypatch):
    """A changed, added or renamed kernel file means another folder: never stale machine code."""
    kernels, topic = tmp_path / "_kernels", tmp_path / "topic"
    kernels.mkdir()
    topic.mkdir()
    (kernels / "a.py").write_text("one")
    (topic / "_b_kernels.py").write_text("two")
    (topic / "other.py").write_text("three")
    monkeypatch.setattr(cache_folder, "PACKAGE", tmp_path)
    cache_folder.kernel_cache.cache_clear()
    seen = []

    def folder():
        cache_folder.kernel_cache.cache_clear()
        return cache_folder.kernel_cache()

    try:
        seen.append(folder())
        (topic / "other.py").write_text("no kernel")
        assert folder() == seen[0]
        (topic / "_b_kernels.py").write_text("changed")
        seen.append(folder())
        (kernels / "c.py").write_text("")
        seen.append(folder())
        (kernels / "c.py").rename(kernels / "d.py")
        seen.append(folder())
        assert len(set(seen)) == 4
    finally:
        monkeypatch.undo()
        cache_folder.kernel_cache.cache_clear()


def test_environment_names_the_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "b"))
    monkeypatch.delenv("MEDIALIS_CACHE_DIR", raising=False)
    assert cache_folder.user_cache() == tmp_path / "b"
    monkeypatch.setenv("MEDIALIS_CACHE_DIR", str(tmp_path / "a"))
    assert cache_folder.user_cache() == tmp_path / "a"
    monkeypatch.delenv("MEDIALIS_CACHE_DIR")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    if sys.platform.startswith("linux"):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "c"))
        assert cache_folder.user_cache() == tmp_path / "c" / "medialis"
    assert "medialis" in cache_folder.user_cache().parts


def test_a_finished_warmup_is_remembered_for_these_kernels(tmp_path, monkeypatch):
    monkeypatch.setenv("MEDIALIS_CACHE_DIR", str(tmp_path))
    cache_folder.kernel_cache.cache_clear()
    try:
        cache_folder.mark_compiled()  # no folder yet: nothing to remember, no error
        assert not cache_folder.kernels_are_compiled()
        cache_folder.kernel_cache().mkdir()
        cache_folder.mark_compiled()
        assert cache_folder.kernels_are_compiled()
        monkeypatch.setattr(cache_folder, "kernel_sources", list)
        cache_folder.kernel_cache.cache_clear()
        assert not cache_folder.kernels_are_compiled()
    finally:
        cache_folder.kernel_cache.cache_clear()


def compute(folder):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", COMPUTE],
        env={**os.environ, "MEDIALIS_CACHE_DIR": str(folder)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_damaged_cache_is_compiled_anew(tmp_path):
    """A truncated file in the cache made every later computation fail (fixed)."""
    expected = "0"
    assert compute(tmp_path) == expected
    files = sorted(path for path in tmp_path.rglob("*") if path.is_file())
    assert any(path.suffix == ".nbc" for path in files)
    assert all(path.parent == files[0].parent for path in files)
    for path in files:
        path.write_bytes(path.read_bytes()[:10])
    assert compute(tmp_path) == expected
    repaired = [path for path in files if path.suffix == ".nbc" and path.stat().st_size > 10]
    assert repaired


@pytest.mark.slow
def test_unwritable_cache_still_computes(tmp_path):
    (tmp_path / "file").write_text("a file where the folder should be")
    assert compute(tmp_path / "file") == "0"


def test_kernels_release_the_lock():
    from medialis.balls._ball_kernels import shrink_balls

    assert shrink_balls.targetoptions["nogil"]
