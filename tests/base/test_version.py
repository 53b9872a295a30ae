"""The version is that of pyproject.toml; whoever cannot read it there states the same one."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]


def stated(file, pattern):
    """All that a pattern finds at the beginning of lines of a file."""
    return re.findall(f"^{pattern}", (ROOT / file).read_text("utf-8"), re.MULTILINE)


def test_the_newest_release_of_the_changelog_is_this_version():
    headings = stated("CHANGELOG.md", r"## (.*)$")
    assert headings[0] == "[Unreleased]"
    releases = [re.fullmatch(r"\[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d)", h) for h in headings[1:]]
    assert releases and all(releases) and releases[0][1] == VERSION
    dates = [release[2] for release in releases]
    assert dates == sorted(dates, reverse=True)
    assert stated("CITATION.cff", "date-released: (.*)$") == dates[:1]


def test_every_copy_of_the_version_is_the_same():
    assert stated("CITATION.cff", "version: (.*)$") == [VERSION]
    manifest = (ROOT / "blender_addon" / "blender_manifest.toml").read_text("utf-8")
    assert tomllib.loads(manifest)["version"] == VERSION


def test_pages_name_the_files_of_this_version():
    """Zips of the extension and wheels, as the pages tell readers to look for them."""
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]:
        named = re.findall(r"medialis-(\d+\.\d+\.\d+)", page.read_text("utf-8"))
        assert set(named) <= {VERSION}, page.name
