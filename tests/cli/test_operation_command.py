"""Results beside each other, what is said of them, and words that are nearly right."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import medialis
from medialis.base.kept import DEFAULT_LIMIT
from medialis.base.progress import Progress
from medialis.cli.commands import main
from medialis.cli.display import file_meanings, summary_lines
from medialis.formats.ply_attributes import write_ply
from medialis.operations.registry import OPERATIONS
from medialis.operations.result import value_text
from medialis.shape.samples import SAMPLES
from medialis.show.writing import Pictures, Written, write_files

SCREEN, WIDE = 40, 100


@pytest.fixture(scope="module")
def creature(tmp_path_factory):
    shape = medialis.organic_shape(56)
    path = tmp_path_factory.mktemp("shapes") / "creature.ply"
    write_ply(path, shape.points, faces=shape.faces)
    return path


@pytest.fixture
def here(creature, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(creature, tmp_path / "creature.ply")
    return tmp_path


def run(*arguments: object) -> int:
    return main([str(a) for a in arguments])


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_a_second_operation_leaves_the_first_alone(here):
    """`thickness` and `surface-skeleton` had one folder, and one samples.ply for both."""
    assert run("surface-skeleton", "creature.ply", "--no-picture") == 0
    before = contents(here / "creature-medialis")
    assert run("thickness", "creature.ply", "--no-picture") == 0
    after = contents(here / "creature-medialis")
    assert before.items() <= after.items()
    assert {Path(name).parts[0] for name in after} == {"surface_skeleton", "thickness"}


@pytest.mark.slow
def test_the_same_result_may_be_written_again(here, capsys):
    assert run("thickness", "creature.ply", "--no-picture", "--threshold", "2%") == 0
    assert run("thickness", "creature.ply", "--no-picture", "--threshold", "2 %") == 0
    assert run("thickness", "creature.ply", "--threshold", "2%") == 0
    assert capsys.readouterr().err == ""
    assert (here / "creature-medialis" / "thickness" / "thickness.png").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("what", ["unit", "input", "version", "operation", "damaged"])
def test_another_result_is_not_overwritten(what, here, capsys):
    command = ["thickness", "creature.ply", "-o", "out", "--no-picture"]
    assert run(*command) == 0
    folder, told = here / "out", {"unit": "another unit"}
    manifest = json.loads((folder / "manifest.json").read_text())
    if what == "unit":
        command += ["--unit", "mm"]
    elif what == "operation":
        command[0], told[what] = "point-types", "operation thickness"
    elif what == "input":
        os.utime(here / "creature.ply", ns=(1, 1))
        told[what] = "another input"
    elif what == "version":
        (folder / "manifest.json").write_text(json.dumps({**manifest, "medialis": "0.1"}))
        told[what] = "of medialis 0.1"
    else:
        (folder / "manifest.json").write_text("{")
        told[what] = "of the operation unknown"
    before = contents(folder)
    assert run(*command) == 2
    said = capsys.readouterr().err
    assert told[what] in said and "--overwrite" in said and said.count("\n") == 1
    assert contents(folder) == before
    assert run(*command, "--overwrite") == 0
    new = json.loads((folder / "manifest.json").read_text())
    assert sorted(p.name for p in folder.iterdir()) == sorted(Path(f).name for f in new["files"])


@pytest.mark.slow
def test_another_threshold_replaces_its_own_earlier_result(here, capsys):
    """One can try thresholds without --overwrite; what somebody has edited is not lost."""
    command = ["thickness", "creature.ply", "-o", "out", "--no-picture", "--refine", "0"]
    folder = here / "out"
    assert run(*command, "--threshold", "2%") == 0 and run(*command, "--threshold", "3%") == 0
    said = capsys.readouterr().out
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["replaced"] == {"threshold": "2 %"} and "earlier result (threshold 2 %)" in said
    assert manifest["lengths"]["threshold"] == "3 %"
    assert {p.name for p in folder.iterdir()} == {Path(f).name for f in manifest["files"]}
    (folder / "notes.txt").write_text("mine")
    assert run(*command, "--threshold", "3%") == 0, "the same once more"
    assert json.loads((folder / "manifest.json").read_text())["replaced"] == {}
    with (folder / "thickness.ply").open("ab") as stream:
        stream.write(b"mine")
    whole = (folder / "manifest.json").read_bytes()
    for damage, named in (({}, "thickness.ply"), ({"contents": [1]}, "manifest.json"),
                          ({"contents": {"../a": {}, "a\0": 1}}, "a")):  # fmt: skip
        (folder / "manifest.json").write_text(json.dumps({**json.loads(whole), **damage}))
        before = contents(folder)
        assert run(*command, "--threshold", "4%") == 2
        said = capsys.readouterr().err
        assert named in said and "has changed since it was written" in said
        assert contents(folder) == before
    (folder / "manifest.json").write_bytes(whole)
    assert run(*command, "--threshold", "4%", "--overwrite") == 0
    assert (folder / "notes.txt").read_text() == "mine"


@pytest.mark.slow
def test_what_another_run_wrote_meanwhile_is_not_replaced(here):
    """Only what was there when the run began is its own earlier result."""
    shape = medialis.organic_shape(56)
    results = [medialis.run("thickness", shape, refine=0, threshold=t) for t in (0.02, 0.03)]
    without = Pictures(main=False)
    write_files(results[0], "out", Written(pictures=without, earlier=b""), Progress())
    with pytest.raises(medialis.FileError, match="with another threshold"):
        write_files(results[1], "out", Written(pictures=without, earlier=b""), Progress())
    there = (here / "out" / "manifest.json").read_bytes()
    write_files(results[1], "out", Written(pictures=without, earlier=there), Progress())


@pytest.mark.slow
def test_overwriting_leaves_no_file_of_the_old_result(here):
    result = medialis.run("surface_skeleton", medialis.organic_shape(56))
    medialis.write_result(result, here / "out")
    (here / "out" / "notes.txt").write_text("mine")
    other = medialis.run("point_types", medialis.organic_shape(56))
    with pytest.raises(medialis.FileError, match="operation surface_skeleton"):
        medialis.write_result(other, here / "out")
    medialis.write_result(other, here / "out", overwrite=True)
    names = {p.name for p in (here / "out").iterdir()}
    assert "notes.txt" in names and not {n for n in names if n.startswith("surface_skeleton")}


@pytest.mark.slow
def test_another_shape_of_the_same_options_is_another_result(here):
    medialis.write_result(medialis.run("point_types", medialis.organic_shape(56)), "out")
    medialis.write_result(medialis.run("point_types", medialis.organic_shape(56)), "out")
    with pytest.raises(medialis.FileError, match="of another shape"):
        medialis.write_result(medialis.run("point_types", medialis.organic_shape(60)), "out")


@pytest.mark.slow
def test_files_of_no_result_stay(here, capsys):
    (here / "out").mkdir()
    (here / "out" / "samples.ply").write_text("mine")
    command = ["thickness", "creature.ply", "-o", "out", "--no-picture"]
    assert run(*command) == 2 and "samples.ply" in capsys.readouterr().err
    assert contents(here / "out") == {"samples.ply": b"mine"}
    assert run(*command, "--overwrite") == 0


@pytest.mark.slow
def test_a_folder_with_files_of_somebody_else_is_refused(here, capsys):
    """Results were written beside them without a question (fixed)."""
    (here / "out").mkdir()
    (here / "out" / "letter.txt").write_text("mine")
    assert run("thickness", "creature.ply", "-o", "out", "--no-picture") == 2
    said = capsys.readouterr().err
    assert "letter.txt" in said and "--overwrite" in said and said.count("\n") == 1
    assert contents(here / "out") == {"letter.txt": b"mine"}
    result = medialis.run("thickness", medialis.organic_shape(56))
    without = medialis.Pictures(main=False)
    (here / "out" / "letter.txt").rename(here / "out" / ".DS_Store")  # the system's own
    medialis.write_result(result, here / "out", pictures=without)
    (here / "out" / "letter.txt").write_text("mine")
    medialis.write_result(result, here / "out", pictures=without)  # beside a result it stays
    assert (here / "out" / "letter.txt").read_text() == "mine"


@pytest.mark.slow
def test_an_overwriting_that_fails_leaves_the_old_result(here, monkeypatch):
    medialis.write_result(medialis.run("surface_skeleton", medialis.organic_shape(56)), "out")
    before = contents(here / "out")
    (here / "out" / "samples.npz").mkdir()
    other = medialis.run("point_types", medialis.organic_shape(56))
    monkeypatch.setattr(
        "medialis.show.writing.write_json", lambda *_: (_ for _ in ()).throw(OSError(28, "x"))
    )
    with pytest.raises(OSError, match="x"):
        medialis.write_result(other, "out", overwrite=True)
    assert contents(here / "out") == before


@pytest.mark.slow
@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_every_example_of_help_runs_and_is_told_on_one_screen(
    chosen, tmp_path, monkeypatch, capsys, small_samples
):
    """With what each of its files is; the wrapped lines name the first ones, --verbose all."""
    monkeypatch.chdir(tmp_path)
    seen = set()
    with medialis.memory_limit(DEFAULT_LIMIT):
        for arguments, _ in chosen.examples:
            shape, *options = shlex.split(arguments)
            if not Path(shape).exists():
                assert run("sample", shape.removesuffix(".ply")) == 0
            capsys.readouterr()
            assert run(chosen.name.replace("_", "-"), shape, *options, "--verbose") == 0
            out = capsys.readouterr().out.splitlines()
            ((folder, path),) = {p.parent: p for p in tmp_path.rglob("manifest.json")
                                 if p.parent not in seen}.items()  # fmt: skip
            seen.add(folder)
            manifest = json.loads(path.read_text())
            assert all(text for text in file_meanings(manifest).values()), file_meanings(manifest)
            listed = [line.split()[0] for line in out if line.startswith("  ")]
            assert {p.name for p in folder.iterdir()} <= set(listed)
            wrapped = list(summary_lines(manifest, WIDE))
            assert len(wrapped) <= SCREEN and max(map(len, wrapped)) <= WIDE


@pytest.mark.slow
def test_what_is_no_graph_and_has_no_bones_is_not_told_so(here):
    """The envelope and the balls for robots were, by their endings (fixed)."""
    shape = medialis.organic_shape(56)
    result = medialis.run("medial_mesh", shape, balls=6, quality="fast", samples=500, cover=True)
    medialis.write_result(result, "out")
    manifest = json.loads(Path("out/manifest.json").read_text())
    meanings = file_meanings(manifest)
    assert {"medial_mesh_envelope.glb", "ball_cover.json", "ball_cover.urdf"} <= set(meanings)
    assert all(text and "graph" not in text and "bones" not in text for text in meanings.values())


def test_the_length_of_welds_has_a_unit():
    assert value_text("weld_length", 2.5, "mm") == "2.5 mm"


@pytest.mark.slow
def test_thin_spots_are_a_table_with_units(here, capsys):
    assert run("thickness", "creature.ply", "--no-picture", "--unit", "mm", "--spots", "7") == 0
    out = capsys.readouterr().out
    manifest = json.loads(Path("creature-medialis/thickness/manifest.json").read_text())
    spots = manifest["values"]["spots"]
    assert len(spots) > 5 and f"{len(spots) - 5} more" in out
    rows = [line.split() for line in out.splitlines() if line.split()[1:2] == ["wall"]]
    assert [row[2:4] for row in rows] == [[f"{s['value']:.4g}", "mm"] for s in spots[:5]]
    assert re.search(rf"^  diagonal +{manifest['values']['diagonal']:.4g} mm$", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["thicknes", "x.ply"], "did you mean thickness?"),
        (["thickness", "creature.ply", "--treshold", "1"], "did you mean --threshold?"),
        (["sample", "creatur"], "did you mean creature?"),
        (["thickness", "."], "medialis batch thickness ."),
        (["thickness", "a b.ply", "c.ply"], "medialis batch thickness 'a b.ply' c.ply"),
        (["zzz"], "medialis --help"),
    ],
)
def test_nearly_right_words_get_a_hint(words, hint, here, capsys):
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert hint in said and said.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLES)
def test_samples_are_shapes_that_can_be_read_and_are_never_replaced(
    name, here, capsys, small_samples
):
    assert run("sample", name, "-o", "new.ply") == 0
    shape = medialis.read_shape("new.ply")
    made = medialis.sample_shape(name)
    assert shape.point_count == made.point_count and shape.face_count == made.face_count
    before = Path("new.ply").read_bytes()
    assert run("sample", name, "-o", "new.ply") == 2
    assert Path("new.ply").read_bytes() == before
    assert run("sample") == 0 and name in capsys.readouterr().out


def test_samples_are_ply_files(here, capsys):
    """One that was called .stl was a PLY file, which other programs could not read (fixed)."""
    assert run("sample", "bracket", "-o", "bracket.stl") == 2
    assert (
        "call the file bracket.ply" in capsys.readouterr().err and not Path("bracket.stl").exists()
    )


def test_there_is_no_other_sample():
    with pytest.raises(medialis.InvalidOptionError, match="creature"):
        medialis.sample_shape("dodo")


def test_every_operation_says_what_it_writes_and_gives_an_example():
    for chosen in OPERATIONS:
        assert chosen.examples and chosen.layers
        for arguments, meaning in chosen.examples:
            assert Path(arguments.split()[0]).stem in SAMPLES and meaning


def completion_script(shell: str, capsys) -> str:
    assert run("completion", shell) == 0
    return capsys.readouterr().out


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["thick"], {"thickness"}),
        (["thickness", "--kin"], {"--kind"}),
        (["thickness", "--kind", "di"], {"diameter"}),
        (["thickness", "crea"], {"creature.ply"}),
        (["completion", ""], {"bash", "zsh", "fish"}),
        (["batch", "point"], {"point-types"}),
        (["sample", "sc"], {"scan"}),
    ],
)
def test_bash_completes(words, expected, here, capsys):
    pytest.importorskip("shtab")
    Path("script").write_text(completion_script("bash", capsys))
    typed = " ".join(f"'{word}'" for word in words)
    code = f"source ./script; COMP_WORDS=(medialis {typed}); COMP_CWORD={len(words)}; "
    code += '_shtab_medialis; printf "%s\\n" "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == expected


def test_other_shells_get_all_commands(capsys):
    pytest.importorskip("shtab")
    for shell in ("zsh", "fish"):
        script = completion_script(shell, capsys)
        assert all(o.name.replace("_", "-") in script for o in OPERATIONS)
    (kind,) = (line for line in script.splitlines() if "thickness" in line and "-l kind" in line)
    assert '"diameter radius"' in kind


def test_completion_without_its_library_is_one_sentence(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert run("completion", "bash") == 2
    assert 'Completion needs shtab: pip install "medialis[completion]"' in capsys.readouterr().err


@pytest.mark.slow
def test_help_computes_nothing():
    """Neither numba nor scipy is loaded to print the help of an operation."""
    code = "import sys; from medialis.cli import main\ntry: main(['thickness', '--help'])\n"
    code += "except SystemExit: pass\nprint({'numba', 'scipy', 'matplotlib'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"
    assert "examples:" in done.stdout and "thin_spots.ply" in done.stdout
