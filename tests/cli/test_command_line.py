"""The command line as a new user and as another program meet it."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import medialis
import plates
from medialis.cli.arguments import with_dashes, with_method
from medialis.cli.commands import main
from medialis.formats.json_npz import read_npz
from medialis.formats.ply_attributes import read_ply_attributes, write_ply
from medialis.operations.registry import OPERATIONS


@pytest.fixture(scope="module")
def creature(tmp_path_factory) -> Path:
    shape = medialis.organic_shape(56)
    path = tmp_path_factory.mktemp("shapes") / "creature with space ä.ply"
    write_ply(path, shape.points, faces=shape.faces)
    return path


def run(*arguments: object) -> int:
    return main([str(a) for a in arguments])


@pytest.mark.slow
def test_surface_skeleton_writes_what_the_manifest_says(creature, tmp_path, capsys):
    out = tmp_path / "new" / "out"
    assert run("surface-skeleton", creature, "-o", out, "--json") == 0
    manifest = json.loads(capsys.readouterr().out)
    assert sorted(Path(f).name for f in manifest["files"]) == sorted(p.name for p in out.iterdir())
    assert Path(manifest["picture"]).read_bytes().startswith(b"\x89PNG")
    assert manifest["operation"] == "surface_skeleton"
    assert {"tree", "balls", "read", "write", "total"} <= set(manifest["seconds"])
    assert json.loads((out / "manifest.json").read_text())["values"] == manifest["values"]


@pytest.mark.slow
def test_files_hold_bitwise_the_arrays_of_the_python_call(creature, tmp_path):
    assert run("surface-skeleton", creature, "-o", tmp_path / "out", "--no-picture") == 0
    result = medialis.run("surface_skeleton", medialis.read_shape(creature))
    stored = read_npz(tmp_path / "out" / "surface_skeleton.npz")
    assert stored.keys() == result.arrays.keys()
    for name, array in result.arrays.items():
        assert stored[name].dtype == array.dtype
        assert stored[name].tobytes() == np.ascontiguousarray(array).tobytes(), name
    layer = result.layers[0]
    ply = read_ply_attributes(tmp_path / "out" / "surface_skeleton.ply")
    assert ply.points.tobytes() == np.ascontiguousarray(layer.points).tobytes()
    for name, array in layer.attributes.items():
        assert ply.attributes[name].tobytes() == np.ascontiguousarray(array).tobytes(), name
        assert ply.attributes[name].dtype == array.dtype


@pytest.mark.slow
def test_one_and_two_threads_write_the_same_bytes(creature, tmp_path):
    for threads in (1, 2):
        assert (
            run("surface-skeleton", creature, "-o", tmp_path / str(threads), "--threads", threads)
            == 0
        )
    for name in (
        "surface_skeleton.ply",
        "samples.ply",
        "surface_skeleton.npz",
        "surface_skeleton.png",
    ):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes(), name


@pytest.mark.slow
def test_progress_lines_rise_to_one(creature, tmp_path, capsys):
    assert run("surface-skeleton", creature, "-o", tmp_path / "out", "--progress", "lines") == 0
    lines = capsys.readouterr().err.splitlines()
    assert all(re.fullmatch(r"PROGRESS [01]\.\d{4} [\w ]+", line) for line in lines), lines
    fractions = [float(line.split()[1]) for line in lines]
    assert fractions == sorted(fractions) and fractions[0] == 0.0 and fractions[-1] == 1.0


@pytest.mark.slow
def test_parameters_reach_the_operation(creature, tmp_path, capsys):
    flags = ["--side", "both", "--tolerance", "0.001", "--subsample", "0.05", "--refine", "0"]
    flags += ["--largest-radius", "0.3", "--json", "--color-by", "spoke_angle", "--turntable", "2"]
    assert run("surface-skeleton", creature, "-o", tmp_path / "out", *flags) == 0
    manifest = json.loads(capsys.readouterr().out)
    assert manifest["parameters"] == {
        "side": "both", "tolerance": 0.001, "subsample": 0.05, "refine": 0.0,
        "largest_radius": 0.3, "importance": True, "threshold": "auto", "denoise": "auto",
        "creases": 30.0, "fans": True,
    }  # fmt: skip
    assert (tmp_path / "out" / "turntable_001.png").exists()


@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_every_operation_has_help(chosen, capsys):
    """That each runs: `test_every_example_of_help_runs_and_is_told_on_one_screen`."""
    with pytest.raises(SystemExit) as stop:
        run(chosen.name.replace("_", "-"), "--help")
    assert stop.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    for parameter in chosen.parameters:
        assert "--" + parameter.name.replace("_", "-") in text
        assert parameter.help.split(".")[0] in text


def test_names_with_underscores_are_understood(creature, tmp_path, capsys):
    """`medialis surface_skeleton` was an unknown command, `--no_picture` an unknown option."""
    out = tmp_path / "out"
    given = ["--no_picture", "--largest_radius=200%"]
    assert run("surface_skeleton", creature, "-o", out, *given) == 0
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["parameters"]["largest_radius"] == 2.0 and manifest["picture"] is None
    assert run("describe", "soft_edges") == run("describe", "soft-edges") == 0
    assert capsys.readouterr().err == ""


def test_underscores_of_file_names_stay():
    words = ["thickness", "--no_picture", "--", "--my_part.ply"]
    assert with_dashes(words) == ["thickness", "--no-picture", "--", "--my_part.ply"]


def test_info_tells_of_far_points(tmp_path, capsys):
    path = tmp_path / "far.obj"
    corners = np.vstack([np.eye(3), np.zeros((1, 3)), 1e5 + np.eye(3)])
    faces = [[4, 2, 1], [4, 3, 2], [4, 1, 3], [1, 2, 3], [5, 6, 7]]
    text = "".join("v {} {} {}\n".format(*row) for row in corners.tolist())
    path.write_text(text + "".join("f {} {} {}\n".format(*row) for row in faces))
    assert run("info", path) == 0 and "far" in capsys.readouterr().out


def test_describe_gives_the_registry_as_json(capsys):
    assert run("describe", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads(json.dumps([o.describe() for o in OPERATIONS]))
    assert run("describe", "surface-skeleton") == 0
    assert "tolerance" in capsys.readouterr().out


def test_list_names_every_operation(capsys):
    assert run("list") == 0
    out = capsys.readouterr().out
    assert all(o.name.replace("_", "-") in out for o in OPERATIONS)


def test_info_tells_the_diagnosis(creature, capsys):
    assert run("info", creature, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["closed"] is True and told["genus"] == 0 and told["orientation"] == "out"
    assert run("info", creature) == 0
    assert "closed" in capsys.readouterr().out


def test_info_joins_the_triangles_of_stl_before_it_judges(tmp_path, capsys):
    """A closed part was told as 60 components with 60 holes (fixed)."""
    points, faces = plates.boxes((0, 60, 0, 40, 0, 4))
    corners = np.asarray(points, float)[np.asarray(faces)]
    lines = ["solid part"]
    for triangle in corners:
        ends = (f"vertex {x} {y} {z}" for x, y, z in triangle)
        lines += ["facet normal 0 0 0", "outer loop", *ends, "endloop", "endfacet"]
    (tmp_path / "part.stl").write_text("\n".join([*lines, "endsolid part"]))
    assert run("info", tmp_path / "part.stl") == 0
    out = capsys.readouterr().out
    assert "in 1 component\nclosed, genus 0" in out and "size 60 x 40 x 4\n" in out
    assert "as operations see it" not in out and "duplicate" not in out


def test_info_tells_what_repair_makes_of_it(tmp_path, capsys):
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0], [0, 0, 1.0]]
    path = tmp_path / "torn.ply"
    write_ply(path, corners, faces=[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 4]])
    assert run("info", path, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert not told["closed"] and told["repaired"]["closed"] and "Welded" in told["messages"][0]
    assert run("info", path) == 0
    assert "as operations see it:\nmesh of 4 vertices" in capsys.readouterr().out

    write_ply(path, [[0, 0, 0], [1, 0, 0], [2, 0, 0]], faces=[[0, 1, 2]])  # without area
    assert run("info", path, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["repaired"] is None and "refuse" in told["messages"][-1]


@pytest.mark.slow
def test_demo_makes_the_built_in_shape_and_yours(creature, tmp_path, capsys):
    assert run("demo", creature, "-o", tmp_path / "demo") == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith(".png") and Path(last).exists()
    assert (tmp_path / "demo" / "organic_shape" / "surface_skeleton.png").exists()


def triangle(path: Path) -> None:
    write_ply(path, np.eye(3), faces=[[0, 1, 2]])


def coincident(path: Path) -> None:
    write_ply(path, np.ones((50, 3)))


def flat(path: Path) -> None:
    write_ply(path, np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), faces=[[0, 1, 2]])


def one_point(path: Path) -> None:
    write_ply(path, np.zeros((1, 3)))


BAD_FILES = {
    "empty.ply": (b"", "empty"),
    "garbage.ply": (b"this is not a mesh at all\n" * 5, "ply"),
    "binary.obj": (bytes(range(256)) * 8, ""),
    "nan.obj": (b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN"),
    "inf.off": (b"OFF\n3 1 0\n0 0 inf\n1 0 0\n0 1 0\n3 0 1 2\n", "infini"),
    "range.off": (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "7"),
    "short.off": (b"OFF\n300 1 0\n0 0 0\n1 0 0\n", "300"),
    "huge.ply": (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\n"
        b"property float x\nproperty float y\nproperty float z\nend_header\n",
        "999999999999",
    ),
    "triangle.ply": (triangle, "flat"),
    "same.ply": (coincident, ""),
    "flat.ply": (flat, "area"),
    "point.ply": (one_point, ""),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_bad_files_are_one_sentence_and_nothing_is_written(name, tmp_path, capsys):
    content, told = BAD_FILES[name]
    path = tmp_path / name
    if callable(content):
        content(path)
    else:
        path.write_bytes(content)
    assert run("surface-skeleton", path, "-o", tmp_path / "out") == 2
    said = capsys.readouterr()
    assert said.out == "" and len(said.err.splitlines()) == 1
    assert said.err.startswith("medialis: ") and told in said.err, said.err
    assert sorted(p.name for p in tmp_path.iterdir()) == [name]


def test_a_truncated_binary_file_says_how_much_came(creature, tmp_path, capsys):
    path = tmp_path / "cut.ply"
    path.write_bytes(creature.read_bytes()[:5000])
    assert run("surface-skeleton", path, "-o", tmp_path / "out") == 2
    assert re.search(r"announces \d+ vertices, only \d+ were found", capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


BAD_OPTIONS = [
    (["--tolerance", "-1"], "tolerance"),
    (["--tolerance", "nan"], "tolerance"),
    (["--tolerance", "much"], "tolerance"),
    (["--side", "upper"], "inner, outer, both"),
    (["--subsample", "7"], "subsample"),
    (["--refine", "1e-9"], "points"),
    (["--largest-radius", "0"], "largest_radius"),
    (["--threads", "0"], "threads"),
    (["--threads", "two"], "--threads"),
    (["--turntable", "-3"], "turntable"),
    (["--color-by", "taste"], "taste"),
    (["--speed", "9"], "--speed"),
    (["--progress", "loud"], "progress"),
]


@pytest.mark.parametrize(("flags", "told"), BAD_OPTIONS, ids=lambda v: str(v))
def test_bad_options_are_one_sentence(flags, told, creature, tmp_path, capsys):
    assert run("surface-skeleton", creature, "-o", tmp_path / "out", *flags) == 2
    said = capsys.readouterr()
    assert len(said.err.splitlines()) == 1 and told in said.err, said.err
    assert said.out == "" and list(tmp_path.iterdir()) == []


def test_missing_file_folder_and_unknown_command(tmp_path, capsys):
    for arguments in (
        ["surface-skeleton", tmp_path / "no.ply"],
        ["surface-skeleton", tmp_path],
        ["info", tmp_path / "no.ply"],
        ["describe", "nothing"],
        ["juggle"],
        [],
    ):
        assert run(*arguments) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_output_that_is_a_file_is_refused(creature, tmp_path, capsys):
    (tmp_path / "out").write_text("mine")
    assert run("surface-skeleton", creature, "-o", tmp_path / "out") == 2
    assert "out" in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_unwritable_output_is_refused_before_the_work(creature, capsys):
    """/proc accepts no new folder, not even from root."""
    if not Path("/proc/self").exists():
        pytest.skip("needs a folder that nobody can write to (/proc)")
    assert run("surface-skeleton", creature, "-o", "/proc/medialis/out") == 2
    assert "/proc" in capsys.readouterr().err


def test_help_and_list_load_no_compiled_code():
    """Nor mail, TLS and a browser, that modules of the standard library bring; files neither."""
    code = (
        "import sys; from medialis.cli.commands import main; main(['list']);"
        "from medialis.show import writing; from medialis.base import version;"
        "version.package_version(); unwanted = {'numba', 'scipy', 'email', 'ssl', 'webbrowser'};"
        "assert not unwanted & set(sys.modules), unwanted & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="sends the interrupt signal of Unix")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_leaves_nothing_behind(creature, tmp_path, number):
    """Ctrl-C or kill while it works: exit code 130, one line, no file and no temporary folder."""
    flags = ["-o", "out", "--refine", "0.005", "--progress", "lines", "--turntable", "400"]
    child = subprocess.Popen(
        [sys.executable, "-m", "medialis", "surface-skeleton", str(creature), *flags],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        # A shell starts background jobs, and so perhaps these tests, with the signal ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    for line in child.stderr:
        if "picture" in line:
            break
    time.sleep(0.2)
    assert [p.name for p in tmp_path.iterdir()] != []  # it was writing
    child.send_signal(number)
    rest = child.stderr.read().splitlines()
    child.stderr.close()
    assert child.wait(timeout=60) == 130
    assert rest[-1] == "medialis: cancelled, nothing was written."
    assert list(tmp_path.iterdir()) == []


def test_control_characters_of_a_name_do_nothing(tmp_path, capsys):
    """A file whose name held escape sequences changed colours and title of the terminal (fixed)."""
    name = tmp_path / "a\x1b[31m\x07\r.xyz"
    assert main(["info", str(name)]) == 2
    name.write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n") if os.name != "nt" else None
    main(["info", str(name)])
    said = capsys.readouterr()
    assert not set("\x1b\x07\r") & set(said.out + said.err)
    assert "a\\x1b[31m\\x07" in said.err and "a\\x1b[31m\\x07" in said.out


STALLING = """\
import importlib.abc, sys, time

class Stall(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            print("stalled", file=sys.stderr, flush=True)
            time.sleep(60)

sys.meta_path.insert(0, Stall())
"""


@pytest.mark.skipif(os.name == "nt", reason="sends the interrupt signal of Unix")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_packages_are_loaded_is_one_line(creature, tmp_path, number):
    """Ctrl-C within the first second gave a traceback of an import and exit code 1 (fixed)."""
    (tmp_path / "hook").mkdir()
    (tmp_path / "hook" / "sitecustomize.py").write_text(STALLING)
    (tmp_path / "work").mkdir()
    places = [str(tmp_path / "hook"), *filter(None, sys.path)]
    child = subprocess.Popen(
        [sys.executable, "-m", "medialis", "surface-skeleton", str(creature), "-o", "out"],
        cwd=tmp_path / "work",
        env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert child.stderr.readline() == "stalled\n"
    child.send_signal(number)
    said, told = child.communicate(timeout=30)
    assert (child.returncode, said) == (130, "")
    assert told == "medialis: cancelled, nothing was written.\n"
    assert list((tmp_path / "work").iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="needs pipes as Unix has them")
def test_a_child_whose_host_died_ends_and_leaves_nothing(creature, tmp_path):
    """Nobody reads its progress any more: it stops at the next line, and writes no result."""
    flags = ["-o", "out", "--refine", "0.005", "--host", "--progress", "lines"]
    child = subprocess.Popen(
        [sys.executable, "-m", "medialis", "surface-skeleton", str(creature), *flags],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
    )
    assert child.stderr.readline().startswith(b"PROGRESS")
    child.stderr.close()
    child.wait(timeout=60)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_closed_pipe_is_not_an_error():
    done = subprocess.run(
        f"{sys.executable} -m medialis describe --json | head -c 10 >/dev/null; echo ok",
        shell=True, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout == "ok\n" and done.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("words", ["list", "--help", "--version", "thickness --help"])
def test_output_that_cannot_be_printed_is_one_sentence(words):
    """A full disk behind `medialis list > file` was a traceback; behind --help nothing (fixed)."""
    command = [sys.executable, "-m", "medialis", *words.split()]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, env=buffered)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps a working folder")
@pytest.mark.parametrize(
    "words", ["thickness a.ply", "thickness {} -o out", "thickness {}", "batch thickness {} -o out",
              "batch thickness . -o out", "batch thickness a.ply -o {}.out", "demo -o out"]
)  # fmt: skip
def test_a_removed_working_folder_is_one_sentence(creature, tmp_path, words, capsys, monkeypatch):
    """It was a failure to print the output, or a traceback (fixed)."""
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    assert main([word.replace("{}", str(creature)) for word in words.split()]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1 and error.startswith("medialis: Cannot "), error
    assert "print" not in error


@pytest.mark.slow
def test_names_in_any_script_are_printed(creature, tmp_path):
    """A file name that the terminal or the pipe (on Windows cp1252) lacks was a traceback."""
    path = tmp_path / "\u5f62.ply"
    path.write_bytes(creature.read_bytes())
    done = subprocess.run(
        [sys.executable, "-m", "medialis", "info", str(path)],
        env={**os.environ, "PYTHONIOENCODING": "cp1252"}, capture_output=True, check=True,
    )  # fmt: skip
    assert b"\\u5f62.ply" in done.stdout and done.stderr == b""


@pytest.mark.slow
def test_an_unknown_attribute_is_refused_with_and_without_a_picture(creature, tmp_path, capsys):
    """Only the drawing looked at it, so operations with their own images took any name."""
    for name in ("surface-skeleton", "ball-reconstruction"):
        out = tmp_path / name
        assert run(name, creature, "-o", out, "--no-picture", "--color-by", "taste") == 2
        assert "taste" in capsys.readouterr().err and not out.exists()


def test_warmup_compiles_what_all_operations_need_and_is_remembered(capsys, tmp_path, monkeypatch):
    """It ran every operation, with pictures: 27 s where all was made ahead of time."""
    from medialis.base import cache_folder, jit
    from medialis.hosts import compile_ahead

    asked = []
    monkeypatch.setenv("MEDIALIS_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compile_ahead, "compile_ahead", lambda names, _: asked.append(names))
    cache_folder.kernel_cache.cache_clear()
    try:
        for made in (True, False):
            for module in (compile_ahead, jit):
                monkeypatch.setattr(
                    module, "record", lambda made=made: {"skeleton": 1} if made else {}
                )
            cache_folder.make_kernel_cache()
            assert main(["warmup"]) == 0
            told = "there is nothing to compile" if made else "Kernels ready in"
            assert told in capsys.readouterr().out
            assert cache_folder.kernels_are_compiled() is not made
    finally:
        cache_folder.kernel_cache.cache_clear()
    listed = {name for one in compile_ahead.all_listed() for name in one.operations}
    assert {name for names in asked for name in names} == listed


def test_warnings_are_told_as_such(creature, tmp_path, capsys):
    """The manifest says which messages are warnings, with their codes and counts."""
    assert run("surface-skeleton", creature, "-o", tmp_path / "out", "--no-picture") == 0
    printed = capsys.readouterr().out.splitlines()
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert {note["warning"] for note in manifest["notes"]} == {True, False}
    for message, note in zip(manifest["messages"], manifest["notes"], strict=True):
        assert f"{'warning' if note['warning'] else 'note'}: {message}" in printed
    (hidden,) = [note for note in manifest["notes"] if note["code"] == "hidden_points"]
    assert hidden["data"]["hidden"] == manifest["values"]["hidden_points"]


def test_curve_skeletons_from_views_are_a_method(tmp_path, capsys):
    """To a person they are a curve skeleton; the operation has its own name."""
    given = ["curve-skeleton", "a.ply", "--method=views"]
    assert with_method(given) == ["view-curve-skeleton", "a.ply"]
    for words in ("curve-skeleton a.ply --method balls", "parts --method views",
                  "curve-skeleton -- --method views", "curve-skeleton --method"):  # fmt: skip
        assert with_method(words.split()) == words.split()
    file = tmp_path / "none.ply"
    assert main(["curve-skeleton", str(file), "--method", "views", "--pairs", "0"]) == 2
    assert "pairs" in capsys.readouterr().err  # an option of the views
    assert main(["curve-skeleton", str(file), "--method", "balls"]) == 2
    assert "no such file" in capsys.readouterr().err
