"""Which section of the site a page of `docs/` belongs to, and the pages as Sphinx reads them.

A page named like an operation is found by itself, and so is every tutorial. All others are named by
the patterns below; a page that none of them finds is an error, not a page that nobody can reach.
"""

from __future__ import annotations

import os
import re
import shutil
from fnmatch import fnmatch
from pathlib import Path

from medialis.operations.declaration import Operation
from medialis.operations.registry import OPERATIONS

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent

SECTIONS = {
    "Basics": ("adoption", "medial_axis", "choosing", "faq", "limits", "citing"),
    "Tutorials": ("tutorials/*",),
    "In other programs": ("blender*", "meshlab*", "pymeshlab*", "other_programs"),
    "Many and large shapes": ("batch*", "report*", "huge*", "gpu", "robot_balls"),
    "Looking at results": ("viewer",),
    "Thesis": ("thesis_*",),
    "Python": ("api", "glossary", "writing", "versions"),
    "Project": (
        "promises",
        "architecture*",
        "decisions",
        "accuracy",
        "peers",
        "benchmarks*",
        "whole_runs",
        "roadmap",
        "contributing",
        "changelog",
    ),
}
"""Patterns of pages, without `.md`; the sections of the operations come before them."""

FROM_ROOT = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Pages of the root of the repository, and what they are called on the site."""

PICTURE = re.compile(r"^!\[(?P<alt>[^\]]*)\]\((?P<file>[^)\s:]+\.png)\)$", re.MULTILINE)
"""A picture that stands alone on its line."""

LINK = re.compile(r"(?P<before>!?\[[^\]]*\]\()(?P<target>[^)\s]+)(?P<after>\))")
FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)


def source_pages() -> dict[str, Path]:
    """Return the file of every page that is written by hand, by its name on the site."""
    files = (path for path in DOCS.rglob("*.md") if path.parent.name != "paper")  # for a journal
    pages = {p.relative_to(DOCS).with_suffix("").as_posix(): p for p in files}
    pages |= {Path(name).stem: ROOT / source for source, name in FROM_ROOT.items()}
    return dict(sorted(pages.items()))


def operation_of(page: str) -> Operation | None:
    """Return the operation that a page is about: its name begins like the page's, or reversed."""
    named = [o for o in OPERATIONS if o.name == page]
    alike = [o for o in OPERATIONS if o.name.startswith(page) or page.startswith(o.name)]
    return (named or alike or [None])[0]


def navigation(pages: list[str]) -> dict[str, list[str]]:
    """Return the pages of every section, in the order of the registry, then of the patterns.

    Raises
    ------
    LookupError
        When a page is in no section; the sentence says what to do.
    """
    order = {chosen.name: number for number, chosen in enumerate(OPERATIONS)}
    sections: dict[str, list[str]] = {chosen.group: [] for chosen in OPERATIONS}
    sections |= {name: [] for name in SECTIONS}
    about = {page: operation_of(page) for page in pages if page != "index"}
    for page, chosen in sorted(about.items(), key=lambda item: order.get(item[0], len(order))):
        section = next(
            (s for s, names in SECTIONS.items() if any(fnmatch(page, name) for name in names)),
            chosen.group if chosen else None,
        )
        if section is None:
            raise LookupError(
                f"docs/{page}.md is in no section of the site: name the page like its operation, "
                "or add it to SECTIONS in docs/website/pages.py."
            )
        sections[section].append(page)
    return {name: found for name, found in sections.items() if found}


def links(text: str) -> list[str]:
    """Return the targets of all links and images of a page, code left out."""
    return [match["target"] for match in LINK.finditer(FENCE.sub("", text))]


def stage(target: Path) -> list[str]:
    """Copy all pages and the files they link to, and return the names of the pages.

    Links that leave `docs/` are led to a page of the site, or to a copy of the file under `files/`.
    """
    pages = source_pages()
    for name, source in pages.items():
        text = source.read_text(encoding="utf-8")
        here = target / f"{name}.md"
        here.parent.mkdir(parents=True, exist_ok=True)

        def lead(match: re.Match[str], source: Path = source, here: Path = here) -> str:
            place = _place(match["target"], source, target)
            if place is None:
                return match[0]
            anchor = match["target"].partition("#")[2]
            relative = os.path.relpath(place, here.parent) + (f"#{anchor}" if anchor else "")
            return match["before"] + relative + match["after"]

        depth = "../" * name.count("/")
        here.write_text(_enlarged(LINK.sub(lead, text), depth), encoding="utf-8")
    return list(pages)


def _enlarged(text: str, depth: str) -> str:
    """Lead from each picture to the picture alone, in full size."""

    def figure(match: re.Match[str]) -> str:
        alt = " ".join(match["alt"].split())
        name = match["file"].rpartition("/")[2]
        options = f":alt: {alt}\n:target: {depth}_images/{name}"
        return f":::{{image}} {match['file']}\n{options}\n:::"

    return PICTURE.sub(figure, text)


def _place(link: str, source: Path, target: Path) -> Path | None:
    """Where the file that a link names lies on the site; None for addresses and anchors."""
    file = link.partition("#")[0]
    if not file or re.match(r"[a-z]+:", file):
        return None
    path = (source.parent / file).resolve()
    if path.name in FROM_ROOT and path.parent == ROOT:
        return target / FROM_ROOT[path.name]
    if path == ROOT / "README.md":
        return target / "index.md"
    if path.suffix == ".md":
        return target / path.relative_to(DOCS)
    inside = path.is_relative_to(DOCS)
    place = target / path.relative_to(DOCS) if inside else target / "files" / path.relative_to(ROOT)
    if path.is_file() and not place.exists():
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, place)
    return place
