"""The house: which module may import what, and no circles."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from make_house import PACKAGES, PICTURE, dotted, imports, modules, picture

from medialis.base import cache_folder

PACKAGE = Path(cache_folder.PACKAGE)
imports = cache(imports)  # several tests read each file
# fmt: off
FLOORS = [
    "base", "formats", "shape", "operations",
    "skeleton", "sheets", "curves", "medial_meshes", "robots", "walls", "segments", "clouds",
    "rigging",
    "show", "exchange", "hosts", "batches", "cli", "__main__",
]
# fmt: on
"""Each imports from itself and from those before it."""

AROUND_KERNELS = {"cache_folder.py", "compiling.py", "jit.py"}
"""Python code that kernels need, or that needs numba."""


def is_kernel_module(path):
    return path.name.endswith("_kernels.py")


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_point_downwards(path):
    relative = path.relative_to(PACKAGE)
    if relative.as_posix() == "__init__.py":
        return
    own = FLOORS.index(relative.parts[0].removesuffix(".py"))
    for name in imports(path):
        parts = name.split(".")
        if parts[0] != "medialis":
            continue
        assert len(parts) > 1, f"{relative} imports the public package"
        assert FLOORS.index(parts[1]) <= own, f"{relative} imports {name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_imports_itself_by_way_of_others(package):
    """Six circles were there in 2.0, three of them in the adapters (mended)."""
    known = {dotted(path, package): path for path in modules(package)}
    arrows = {
        name: {other for other in imports(path, package) if other in known and other != name}
        for name, path in known.items()
    }
    if package == "medialis":
        del arrows["medialis"]  # the public names, which are loaded when they are asked for
    done, open_ = set(), []

    def walk(name):
        if name in open_:
            raise AssertionError(" -> ".join([*open_[open_.index(name) :], name]))
        if name in done or name not in arrows:
            return
        open_.append(name)
        for other in sorted(arrows[name]):
            # A package that re-exports its modules is above them: importing one of them from
            # beside it is no circle.
            if not name.startswith(f"{other}."):
                walk(other)
        open_.pop()
        done.add(name)

    for name in sorted(arrows):
        walk(name)


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_only_kernel_modules_import_numba(path):
    """And kernels use only numpy, numba and each other: all they compile is in the cache's hash."""
    names = {name.split(".")[0] for name in imports(path)}
    if not is_kernel_module(path) and path.name not in AROUND_KERNELS:
        assert "numba" not in names
    if not is_kernel_module(path):
        return
    assert path in cache_folder.kernel_sources()
    allowed = {".".join(("medialis", *p.relative_to(PACKAGE).with_suffix("").parts))
               for p in modules() if is_kernel_module(p) or p.name == "jit.py"}  # fmt: skip
    for name in imports(path):
        root = name.split(".")[0]
        if root == "medialis":
            assert any(name == one or name.startswith(f"{one}.") for one in allowed), name
        else:
            assert root in {"numpy", "numba", "math", "typing", "__future__"}, name


@pytest.mark.parametrize("folder", sorted({path.parent for path in modules()} - {PACKAGE}))
def test_each_folder_says_what_it_is(folder):
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))
    assert text and len(text.splitlines()) >= 5, "what it is, in about ten lines"
    files = [path.stem for path in folder.glob("*.py") if path.name != "__init__.py"]
    assert any(name in text for name in files), "which file to read first"


def test_the_picture_of_the_folders_is_what_the_imports_say():
    """`python docs/make_house.py` draws it anew."""
    assert PICTURE.read_text(encoding="utf-8") == picture()


def test_the_way_of_a_shape_names_functions_that_are_there():
    text = (PICTURE.parents[1] / "architecture.md").read_text(encoding="utf-8")
    steps = re.findall(r"^\| \d+ \|.*\| `(.*)` \| `(.*)` \|$", text, re.MULTILINE)
    assert len(steps) == 12
    for file, function in steps:
        path = next(p for p in (PACKAGE / file, PICTURE.parents[2] / file) if p.exists())
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert function in {node.name for node in tree.body if hasattr(node, "name")}, file


LONGEST, PLACEHOLDER = 160, 6


def sentences(path):
    """Give each sentence that a function may say, and its length: 6 characters a value."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = [one for one in ast.walk(tree) if isinstance(one, ast.FunctionDef)]
    docstrings = {ast.get_docstring(one, clean=False) for one in functions}
    for node in (node for one in functions for node in ast.walk(one)):
        if isinstance(node, ast.JoinedStr):
            parts = [
                part.value if isinstance(part, ast.Constant) else "x" * PLACEHOLDER
                for part in node.values
            ]
            yield "".join(parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str | None):
            yield "" if node.value in docstrings else node.value or ""


def test_no_message_is_long():
    """What functions say is read in one line: 160 characters, help texts apart."""
    folders = [path for path in modules() if path.stem != "arguments"]
    said = {text for path in folders for text in sentences(path) if text[:1].isupper()}
    said = {text for text in said if text.endswith(".") and "\n" not in text}
    assert len(said) > 200
    assert [text for text in said if len(text) > LONGEST] == []
