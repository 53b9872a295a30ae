"""The front page works as it is printed: every block, and every command of its table."""

import contextlib
import re
import shlex
import shutil
from html.parser import HTMLParser

import make_outline
import pytest
from code_blocks import blocks, run_bash, run_python
from website.pages import DOCS, ROOT

import medialis
from medialis.base.kept import DEFAULT_LIMIT
from medialis.cli import main
from medialis.show.viewer.page import has_library

README = ROOT / "README.md"
SCREEN = 55
"""Lines of a window."""

needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")


def commands() -> list[str]:
    """Commands of the table "I want to ...", in its order."""
    table = README.read_text("utf-8").partition("## I want to")[2].partition("\n## ")[0]
    return re.findall(r"`(medialis [^`]+)`", table.partition("`medialis sample`")[0])


def test_it_is_two_screens():
    assert len(README.read_text("utf-8").splitlines()) <= 2 * SCREEN


@pytest.mark.slow
@needs_bash
def test_every_block_runs_in_its_order_and_leaves_its_results(tmp_path, monkeypatch):
    """A second command overwrote files of the first one, and the shape was not there (fixed)."""
    monkeypatch.chdir(tmp_path)
    found = blocks(README)
    assert [language for language, _ in found] == ["bash", "python"]
    run_bash(found[0][1], tmp_path)
    names = {}
    run_python(found[1][1], README, names)
    assert names["curve"].branch_count > 5 and names["walls"].min() > 0
    made = {p.parent.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("manifest.json")}
    folders = {f"creature-medialis/{n}" for n in ("thickness", "curve_skeleton", "armature")}
    assert made == {*folders, "thin places"}


@pytest.mark.slow
def test_every_command_of_the_table_runs_in_its_order(tmp_path, monkeypatch, small_samples):
    """But for those that are examples of help texts, which run in tests/cli, and leave nothing."""
    monkeypatch.chdir(tmp_path)
    examples = {
        f"medialis {one.name.replace('_', '-')} {arguments}"
        for one in medialis.OPERATIONS
        for arguments, _ in one.examples
    }
    used = [word for command in commands() for word in command.split() if "/" in word]
    chosen = [
        command
        for command in commands()
        if command not in examples or any(f"/{command.split()[1]}/" in word for word in used)
    ]
    assert 10 <= len(chosen) < len(commands())
    for name in ("creature", "scan", "teeth", "bracket"):
        assert main(["sample", name]) == 0
    assert len(commands()) > 12
    with medialis.memory_limit(DEFAULT_LIMIT):
        for command in chosen:
            words = shlex.split(command)[1:]
            if words[0] == "batch":
                (tmp_path / "many").mkdir()
                shutil.move(tmp_path / "creature.ply", tmp_path / "many")
                with contextlib.chdir("many"):
                    assert main(words) == 0
                assert (tmp_path / "many" / "results" / "results.html").is_file()
            elif words[0] != "view" or has_library():
                assert main(words) == 0, command
    made = {p.parent.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("manifest.json")}
    words = [command.split() for command in chosen]
    asked = {
        f"{w[2].removesuffix('.ply')}-medialis/{w[1].replace('-', '_')}"
        for w in words
        if len(w) > 2 and w[1] not in ("batch", "view") and "-o" not in w
    }
    assert asked <= made and "checked" in made


@pytest.mark.slow
@pytest.mark.skipif(not (DOCS / "pictures").is_dir(), reason="an sdist has no pictures")
def test_the_drawing_is_what_its_program_draws():
    """And it is well formed, with a title for those who do not see it."""
    text = (DOCS / "pictures" / "medial_axis.svg").read_text("utf-8")
    numbers = r"-?\d+\.\d"
    drawn = make_outline.drawing()
    assert re.sub(numbers, "0", drawn) == re.sub(numbers, "0", text)
    pairs = zip(re.findall(numbers, drawn), re.findall(numbers, text), strict=True)
    assert all(abs(float(a) - float(b)) <= 0.1001 for a, b in pairs)
    tags = []
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, _: tags.append(tag)
    parser.feed(text)
    assert "title" in tags and tags.count("circle") > 100


@pytest.mark.slow
def test_the_discs_of_the_drawing_hold_no_point_of_the_outline():
    points, normals = make_outline.outline()
    centers, radius, second = make_outline.largest_discs(points, normals)
    away = ((points[None] - centers[:, None]) ** 2).sum(axis=2) ** 0.5
    assert (away.min(axis=1) >= radius * (1 - 1e-8)).all()
    contact = ((points[second] - centers) ** 2).sum(axis=1) ** 0.5
    assert abs(contact / radius - 1).max() < 1e-8
