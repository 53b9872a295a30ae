"""The pages as they lie in the repository: links, pictures, sections. No site is built."""

import re

import make_pictures
import make_thesis_figures
import pytest
from website import pages

SOURCES = {**pages.source_pages(), "README": pages.ROOT / "README.md"}
MADE = {*make_pictures.PICTURES, *make_thesis_figures.FIGURES}
whole = pytest.mark.skipif(
    not (pages.ROOT / ".github").is_dir(),
    reason="pictures and workflows are in the repository, not in an sdist",
)


def anchors(path) -> set[str]:
    """The anchors that headings get, on code hosts and by MyST."""
    text = pages.FENCE.sub("", path.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ +(.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@whole
@pytest.mark.parametrize("name", SOURCES)
def test_links_lead_somewhere(name):
    source = SOURCES[name]
    for link in pages.links(source.read_text(encoding="utf-8")):
        if re.match(r"[a-z]+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (source.parent / file).resolve() if file else source
        assert target.is_file(), f"{source.name} names {link}"
        if anchor:
            assert anchor in anchors(target), f"{source.name} names {link}"


def test_every_page_has_a_section():
    """The list of sections is the table of contents, so a page without one cannot be reached."""
    names = list(pages.source_pages())
    found = [page for section in pages.navigation(names).values() for page in section]
    assert sorted([*found, "index"]) == sorted(names)


def test_a_page_without_a_section_is_named():
    with pytest.raises(LookupError, match=r"docs/wishes\.md is in no section .* SECTIONS"):
        pages.navigation(["wishes", "index"])


def test_pages_are_found_by_the_name_of_their_operation():
    assert pages.navigation(["thickness", "tutorials/a", "huge"]) == {
        "Thickness": ["thickness"],
        "Tutorials": ["tutorials/a"],
        "Many and large shapes": ["huge"],
    }


def test_every_picture_that_is_made_is_shown():
    """A picture that no page shows is a leftover; one that no program makes is out of date."""
    shown = {
        link.rpartition("/")[2].removesuffix(".png")
        for path in SOURCES.values()
        for link in pages.links(path.read_text(encoding="utf-8"))
        if link.endswith(".png")
    }
    assert not MADE - shown


@whole
def test_staged_pages_link_to_what_is_there(tmp_path):
    """Links out of docs/ are led to pages of the site or to copies, and none is lost."""
    names = pages.stage(tmp_path)
    assert "changelog" in names and (tmp_path / "index.md").is_file()
    for name in names:
        page = tmp_path / f"{name}.md"
        for link in pages.links(page.read_text(encoding="utf-8")):
            file = link.partition("#")[0]
            if file and not re.match(r"[a-z]+:", file):
                assert (page.parent / file).is_file(), f"{name} names {link}"


@whole
@pytest.mark.parametrize("name", ["architecture", "decisions", "promises", "thesis_map"])
def test_files_that_pages_name_are_there(name):
    """Paths in backticks: of the core, of the tests, or of the repository."""
    text = pages.FENCE.sub("", SOURCES[name].read_text(encoding="utf-8"))
    roots = [pages.ROOT / folder for folder in ("core/medialis", "tests", ".")]
    named = {path for path in re.findall(r"`([\w./]+/[\w.]*)`", text) if "..." not in path}
    assert named
    missing = {path for path in named if not any((root / path).exists() for root in roots)}
    assert not missing
    ours = ("core", "tests", "docs", "benchmarks", "blender_addon", "meshlab_plugin")
    files = {path.name for folder in ours for path in (pages.ROOT / folder).rglob("*.py")}
    assert set(re.findall(r"`(\w+\.py)`", text)) <= files
