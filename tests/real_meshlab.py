"""The real MeshLab for tests: build the plugin against its source, run filters by meshlabserver.

Nothing of the system is changed: a folder of its own holds copies of MeshLab's programs beside a
folder with its plugins and ours, which is where these programs look first.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest

from medialis.hosts import Filter, filters

PROJECT = Path(__file__).resolve().parents[1]
PLUGIN = PROJECT / "meshlab_plugin" / "filter_medialis"
SOURCES = Path(os.environ.get("MEDIALIS_MESHLAB_SOURCES", PROJECT / "build"))
LIBRARIES = (Path("/usr/lib/x86_64-linux-gnu/meshlab"), Path("/usr/lib/meshlab"))
NOTES = ("medialis-filters.json", "medialis-program.txt")


def filter_named(name: str) -> Filter:
    """A filter by its Python name, or by the name of its operation."""
    return next(f for f in filters() if name in (f.name, f.operation.name))


def need(program: str) -> str:
    """Path of a program; the test skips where it is missing."""
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"needs the program {program}")
    return found


def build_plugin(libraries: Path, release: str) -> Path:
    """Build the plugin, or bring it up to date, for one MeshLab; the test skips without source."""
    source = SOURCES / f"meshlab-{release.removesuffix('d')}"
    if not (source / "src" / "common").is_dir():
        pytest.skip(f"needs MeshLab's source in {source}, see docs/meshlab.md")
    for program in ("cmake", "c++", "make"):
        need(program)
    fcntl = pytest.importorskip("fcntl", reason="needs file locks as Unix has them")
    folder = PROJECT / "build" / f"plugin-{release}"
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:  # several test processes may want it at once
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = subprocess.run(
            [sys.executable, str(PROJECT / "meshlab_plugin" / "build.py"), str(libraries)],
            env={**os.environ, "MESHLAB_SOURCES": str(SOURCES)},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning:" not in done.stderr, done.stderr
    return folder / "libfilter_medialis.so"


def medialis_program(folder: Path) -> Path:
    """A program that runs this checkout, wherever it is installed or not."""
    program = folder / "medialis"
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH="{PROJECT / "core"}" exec "{sys.executable}" -m medialis "$@"\n'
    )
    program.chmod(0o755)
    return program


@contextmanager
def x_server() -> Iterator[str]:
    """A display without a screen; gives its name."""
    read, write = os.pipe()
    command = [need("Xvfb"), "-displayfd", str(write), "-screen", "0", "1280x900x24"]
    server = subprocess.Popen(
        [*command, "+extension", "GLX"], pass_fds=[write], stderr=subprocess.DEVNULL
    )
    os.close(write)
    try:
        with os.fdopen(read) as stream:
            yield ":" + stream.readline().strip()
    finally:
        server.terminate()
        server.wait(timeout=30)


@dataclass
class MeshLab:
    """A MeshLab 2020.09 with the plugin."""

    folder: Path
    environment: dict[str, str]

    def run(
        self,
        inputs: Sequence[Path],
        entry: Filter,
        values: Mapping[str, Any] | None = None,
        *,
        more: Sequence[str] = (),
        size: float | None = None,
        environment: Mapping[str, str | None] | None = None,
    ) -> str:
        """Load layers, run one filter, do what `more` says; return what meshlabserver printed."""
        script = self.folder / "script.mlx"
        script.write_text(filter_script(entry, inputs[-1], values or {}, size), encoding="utf-8")
        chosen = {**self.environment, **(environment or {})}
        arguments = [a for path in inputs for a in ("-i", str(path))]
        done = subprocess.run(
            [str(self.folder / "meshlabserver"), *arguments, *more, "-s", str(script)],
            env={k: v for k, v in chosen.items() if v is not None},
            capture_output=True,
            timeout=300,
        )
        # Crashes at its end are its own: seen in Debian's meshlabserver without any plugin of ours.
        return (done.stdout + done.stderr).decode("utf-8", "replace")


def filter_script(
    entry: Filter, path: Path, values: Mapping[str, Any], size: float | None = None
) -> str:
    """A script of one filter with all parameters, as MeshLab saves it on a shape of this size."""
    if size is None:
        size = float(np.linalg.norm(np.ptp(medialis_points(path), axis=0)))
    rows = []
    for parameter in (*entry.parameters, *entry.host_parameters):
        value = values.get(parameter.name, parameter.default)
        kind = parameter.kind.value
        more = ""
        if parameter.auto is not None:  # a text: "auto", or a number with its unit
            if value != "auto":
                value = f"{100 * value:.17g}%" if kind == "length" else f"{value:.17g}"
            kind = "text"
        elif kind == "length":
            value, more = value * size, f' min="0" max="{size}"'
        elif kind == "choice":
            shown = "".join(f' enum_val{i}="{c}"' for i, c in enumerate(parameter.choices))
            more = f' enum_cardinality="{len(parameter.choices)}"{shown}'
            value = parameter.choices.index(value)
        elif kind == "file":
            more = ' exts_cardinality="0"'
        names = {
            **{"length": "AbsPerc", "choice": "Enum", "file": "OpenFile", "bool": "Bool"},
            **{"int": "Int", "float": "Float", "angle": "Float", "text": "String"},
        }
        text = str(value).lower() if kind == "bool" else str(value)
        about = f'type="Rich{names[kind]}" name="{parameter.name}" value={quoteattr(text)}{more}'
        rows.append(f"<Param {about}/>")
    body = "\n  ".join(rows)
    return (
        f"<!DOCTYPE FilterScript>\n<FilterScript>\n <filter name={quoteattr(entry.title)}>\n"
        f"  {body}\n </filter>\n</FilterScript>\n"
    )


def medialis_points(path: Path) -> np.ndarray:
    """Points of a mesh file."""
    from medialis.formats.meshes import read_mesh

    return read_mesh(path).points


def make_meshlab(folder: Path, display: str) -> MeshLab:
    """Put copies of MeshLab's programs, links to its plugins and our plugin into a folder."""
    programs = [need("meshlabserver"), need("meshlab")]
    libraries = next((path for path in LIBRARIES if (path / "plugins").is_dir()), None)
    if libraries is None:
        pytest.skip("needs the plugins of Debian's MeshLab 2020.09")
    plugin = build_plugin(libraries, "2020.09")
    (folder / "plugins").mkdir(parents=True)
    for program in programs:
        shutil.copy(program, folder)
    for known in (libraries / "plugins").glob("*.so"):
        if known.name != plugin.name:
            (folder / "plugins" / known.name).symlink_to(known)
    for file in (plugin, plugin.parent / NOTES[0]):
        shutil.copy(file, folder / "plugins")
    for name in ("runtime", "temporary", "home"):
        (folder / name).mkdir(mode=0o700)
    environment = {
        **os.environ,
        "DISPLAY": display,
        "HOME": str(folder / "home"),
        "LD_LIBRARY_PATH": str(libraries),
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "MEDIALIS_PROGRAM": str(medialis_program(folder)),
        "TMPDIR": str(folder / "temporary"),
        "XDG_RUNTIME_DIR": str(folder / "runtime"),
    }
    # The kernels that this user has compiled already are found there.
    cache = os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))
    return MeshLab(folder, {**environment, "XDG_CACHE_HOME": cache})
