"""Cases of the kind `files`: damaged files, and things that are no files, for every reader."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import io
import json
import os
import resource
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import medialis
from fuzz.good_files import GoodFile, good_files, small_tube
from fuzz.kinds import GIGABYTE, Case, Fault, Kind
from fuzz.mutations import mutated
from fuzz.opened import opened
from medialis.batches.batch import write_table
from medialis.batches.jobs import Job, find_files, plan, run_job
from medialis.cli.commands import main
from medialis.curves.operation import write_curve_skeleton
from medialis.formats.json_npz import read_npz
from medialis.formats.ply_attributes import read_ply_attributes, write_ply

MOST_MEMORY = GIGABYTE
"""Bytes that a case may take from the system, and a process that reads for it."""

SMALL, MOST_SECONDS = 1_000_000, 20.0
"""Files of so many bytes at most are read or refused in so much processor time, by all processes.
"""

LONGEST_SENTENCE = 1500

NAMES = (
    *("...{0}", "a{0}", "a{0}", "a{0}", "a{0}", "a{0}{0}", "a", ".{0}", "a.weird", "a.{1}"),
    *(
        "\x1b[31mred\x1b[0m{0}",
        "two\nlines{0}",
        " {0}",
        "-o{0}",
        "=1+1{0}",
        "\udcff{0}",
        "%s{{}}{0}",
    ),
    *("a{2}", "a{0}.", "con{0}", "ünïcode ²{0}", "'\"`$(x){0}"),
)
"""{0} is the ending of the format, {1} the same without dot, {2} in capitals."""


def run(case: Case) -> None:
    """Damage a good file, or make something that is no file, and read it."""
    rng = case.rng
    goods = _goods()
    good = rng.choice(goods)
    others = [other.data for other in goods if other.reader == good.reader] or [b""]
    others.append(rng.choice(goods).data)
    data = good.data
    if good.reader == "manifest":
        data = _good_manifest(case.home)
    if case.number >= len(goods):  # the first cases are the good files themselves
        data = mutated(rng, data, others)
    else:
        good = goods[case.number]
        data = good.data if good.reader != "manifest" else _good_manifest(case.home)
    name = rng.choice(NAMES) if rng.random() < 0.2 and case.number >= len(goods) else "a{0}"
    ending = good.ending
    path = case.folder / name.format(ending, ending[1:], ending.upper())
    if rng.random() < 0.03 and case.number >= len(goods):
        path = _no_file(case, path)
    else:
        path.write_bytes(data)
    reader = good.reader
    if reader == "mesh" and rng.random() < 0.25:
        reader = rng.choice(("info", "job"))
    before, begin = _peak_memory(), _processor_seconds()
    try:
        with opened() as paths:
            READERS[reader](path, case)
    except medialis.MedialisError as error:
        if case.number < len(goods):
            raise Fault("a good file was refused", f"{path.name}: {error}") from error
        _check_sentence(str(error), path)
    _check_opened(paths, path, case)
    if len(data) > SMALL:
        return
    own, others = _peak_memory(), _peak_memory(resource.RUSAGE_CHILDREN)
    # A process that is started counts, until it runs another program, what this one has.
    grown = max(own - before, others if others > own else 0)
    if grown > MOST_MEMORY:
        raise Fault(f"memory of the reader {reader}", f"{grown / GIGABYTE:.1f} GiB for {path.name}")
    used = _processor_seconds() - begin
    if used > MOST_SECONDS:
        raise Fault(f"slow: the reader {reader}", f"{used:.1f} s for {path.name}", again=True)


def _check_opened(paths: list[str], path: Path, case: Case) -> None:
    """No file outside of the folder of the input, and of those of the fuzzers, is opened."""
    ours = tuple(f"{os.path.realpath(folder)}{os.sep}" for folder in (case.folder, case.home))
    own = os.path.realpath(path) if "\0" not in os.fspath(path) else ""
    paths = [place for place in paths if f"{place}{os.sep}" not in ours]  # the folder itself
    if outside := [place for place in paths if not place.startswith(ours) and place != own]:
        raise Fault("a file outside of the folder of the input was opened", "\n".join(outside))


def _no_file(case: Case, path: Path) -> Path:
    """Make a pipe, a folder, a device or a link in place of a file."""
    kind = case.rng.randrange(8)
    if kind == 0:
        os.mkfifo(path)
    elif kind == 1:
        path.mkdir()
    elif kind == 2:
        path.symlink_to("/dev/zero")
    elif kind == 3:
        path.symlink_to(path.name)
    elif kind == 4:
        path.write_bytes(b"")
    elif kind == 5:
        return Path(case.rng.choice(("/dev/zero", "/dev/null", "/proc/self/mem", "a\0b", "", ".")))
    elif kind == 6:
        return path.with_name("x" * 300 + path.name)
    return path  # 7: missing


def _read_mesh(path: Path, case: Case) -> None:
    shape = medialis.read_shape(path)
    if not (np.isfinite(shape.points).all() and np.isfinite(shape.normals).all()):
        raise Fault("a shape was read with NaN")
    lengths = np.linalg.norm(shape.normals, axis=1)
    if not ((np.abs(lengths - 1) < 1e-6) | (lengths == 0)).all():
        raise Fault("a shape was read with normals that are no unit vectors", f"{lengths}")


def _read_attributes(path: Path, case: Case) -> None:
    data = read_ply_attributes(path)
    for name, values in data.attributes.items():
        if len(values) != len(data.points):
            raise Fault("an attribute has not one row for each point", name)
    with contextlib.suppress(medialis.MedialisError):  # not every foreign name can be written
        write_ply(
            case.folder / "again.ply",
            data.points,
            data.faces,
            data.edges,
            data.attributes,
            data.face_attributes,
        )


def _read_npz(path: Path, case: Case) -> None:
    for name, values in read_npz(path).items():
        if values.dtype.hasobject:
            raise Fault("an array of objects was read", name)


def _read_curve(path: Path, case: Case) -> None:
    """What was read must be of use: its measures, and all formats to write."""
    graph = medialis.read_curve_skeleton(path)
    _ = graph.branches, graph.degrees, graph.end_points, graph.mean_radii, graph.edge_lengths
    for ending in ("json", "swc", "graphml", "obj", "ply"):
        write_curve_skeleton(case.folder / f"again.{ending}", graph)
    again = medialis.read_curve_skeleton(case.folder / "again.json")
    if not np.array_equal(graph.nodes, again.nodes) or not np.array_equal(graph.edges, again.edges):
        raise Fault("a curve skeleton is another one after writing and reading")


def _read_pairs(path: Path, case: Case) -> None:
    medialis.run("geodesic_path", _tube(), pairs=os.fspath(path))


def _read_seeds(path: Path, case: Case) -> None:
    medialis.run(
        "mean_shift_segments", _tube(), seeds="none", add_seeds=os.fspath(path), refine=0.0
    )


def _read_manifest(path: Path, case: Case) -> None:
    """A resumed batch takes the manifest as done, or computes anew; it never fails."""
    try:
        if path.is_symlink() or not path.is_file():
            return
        content = path.read_bytes()
    except OSError:  # a name that is too long, memory that is not there
        return
    job = _manifest_job(case.home)
    target = job.folder("thickness") / "manifest.json"
    own = os.fsencode(case.home)
    target.write_bytes(content.replace(b"@HOME@", own))
    row = job.finished("thickness")
    if row is not None:
        write_table([row], case.folder)
    elif case.number < len(_goods()):
        raise Fault("a finished job is not known as such")
    find_files([job.output], case.folder)


def _info(path: Path, case: Case) -> None:
    """The command line says one line of printable text, and ends with 0 or 2."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["info", "--", os.fspath(path)])
    said = out.getvalue() + err.getvalue()
    if code not in (0, 2) or err.getvalue().count("\n") > 1:
        raise Fault("info did not end with one line", f"{code}: {err.getvalue()}")
    strange = [c for c in said if c != "\n" and (ord(c) < 32 or 127 <= ord(c) < 160)]
    if strange:
        raise Fault("info prints control characters", repr(said))


def _run_job(path: Path, case: Case) -> None:
    """A batch makes rows, and nothing outside of its folder."""
    out = case.folder / "out"
    out.mkdir()
    before = set(case.folder.rglob("*"))
    jobs = plan(["thickness"], [path], out, parameters={"thickness": {"refine": 0.0}})
    rows = [row for job in jobs for row in run_job(replace(job, picture=False, threads=1))]
    write_table(rows, out)
    for row in rows:
        if row.sentence.startswith("Unexpected error"):
            raise Fault(f"a batch meets {row.sentence[:120]}", row.sentence)
    outside = [p for p in set(case.folder.rglob("*")) - before if not p.is_relative_to(out)]
    if outside:
        raise Fault("a batch writes outside of its folder", f"{outside}")


READERS: dict[str, Callable[[Path, Case], None]] = {
    **{"mesh": _read_mesh, "attributes": _read_attributes, "npz": _read_npz, "curve": _read_curve},
    **{
        "job": _run_job,
        "pairs": _read_pairs,
        "seeds": _read_seeds,
        "manifest": _read_manifest,
        "info": _info,
    },
}


@functools.cache
def _goods() -> tuple[GoodFile, ...]:
    """All good files; pairs, seeds and manifests as often as all meshes together."""
    files = good_files()
    through = {"trimesh": (".glb", ".gltf", ".dae"), "cascadio": (".step",)}
    through |= {"laspy": (".las", ".laz"), "lazrs": (".laz",), "pye57": (".e57",)}
    for library, endings in through.items():
        if importlib.util.find_spec(library) is None:
            files = [file for file in files if file.ending not in endings]
    single = [file for file in files if file.reader in ("pairs", "seeds", "manifest", "curve")]
    return (*files, *single, *single)


@functools.cache
def _tube() -> medialis.Shape:
    points, faces = small_tube()
    return medialis.make_shape(points, faces)


@functools.cache
def _manifest_job(home: Path) -> Job:
    """Return a job that is finished, with its results in `home`."""
    source = home / "a.ply"
    points, faces = small_tube()
    write_ply(source, points, faces)
    os.utime(source, ns=(0, 0))
    given = {"thickness": {"refine": 0.0}}
    (job,) = plan(["thickness"], [source], home / "out", parameters=given, picture=False)
    (row,) = run_job(replace(job, threads=1))
    if row.status != "done":
        raise Fault("the job of the manifests failed", row.sentence)
    return job


@functools.cache
def _good_manifest(home: Path) -> bytes:
    """Return the manifest of a finished job with a mark in place of what the machine says."""
    job = _manifest_job(home)
    text = (job.folder("thickness") / "manifest.json").read_text().replace(str(home), "@HOME@")
    manifest = json.loads(text)
    manifest["seconds"] = dict.fromkeys(sorted(manifest["seconds"]), 0.5)
    return json.dumps(manifest, indent=2).encode()


def _check_sentence(text: str, path: Path) -> None:
    if len(text.replace(os.fspath(path), "")) > LONGEST_SENTENCE:
        raise Fault("a sentence of thousands of letters", text)
    if not text.strip():
        raise Fault("an error without a sentence")


def _peak_memory(whose: int = resource.RUSAGE_SELF) -> int:
    """Bytes that the process had at most, or the largest of those that it began."""
    return resource.getrusage(whose).ru_maxrss * 1024


def _processor_seconds() -> float:
    """Of this process and of those that it began and that have ended."""
    spent = os.times()
    return time.process_time() + spent.children_user + spent.children_system


KIND = Kind(run, processor_seconds=20.0, wall_seconds=300.0, memory=8 * GIGABYTE, share=2.0)
