"""Build the gallery and docs site: pages, pictures by running the operations, HTML, browser check.

python docs/make_site.py [--pictures kept] [--output build/site]
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import time
from pathlib import Path

from check_site import check
from website.drawing import PAGE_PICTURES, draw_all
from website.generated_pages import gallery, parameter_page, parameters_index, reference
from website.pages import DOCS, ROOT, navigation, stage
from website.strips import state

from medialis.operations.registry import OPERATIONS

WEBSITE = DOCS / "website"


def write_pages(source: Path, cache: Path, redraw: bool) -> None:
    """Write everything that Sphinx reads: pages, pictures, generated pages, tables of contents."""
    pages = stage(source)
    draw_all(cache, PAGE_PICTURES if redraw else ())
    if redraw:
        for name in PAGE_PICTURES:
            shutil.copyfile(cache / f"pages/{name}.png", source / f"pictures/{name}.png")
    generated = {
        **{f"parameters/{o.name}": parameter_page(o, pages, cache) for o in OPERATIONS},
        "parameters/index": parameters_index(),
        "gallery": gallery(pages, cache),
        **reference(),
    }
    for name, text in generated.items():
        path = source / f"{name}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    others = shutil.ignore_patterns("*.json", "pages", "viewers")
    shutil.copytree(cache, source / "parameters/pictures", ignore=others)
    (cache / "viewers").mkdir(exist_ok=True)
    shutil.copytree(cache / "viewers", source / "extra" / "viewers")
    _link_parameters(source, pages)
    _add_contents(source / "index.md", pages)
    shutil.copyfile(WEBSITE / "conf.py", source / "conf.py")
    shutil.copytree(WEBSITE / "static", source / "static")


def _link_parameters(source: Path, pages: list[str]) -> None:
    for chosen in OPERATIONS:
        if chosen.name in pages:
            with (source / f"{chosen.name}.md").open("a", encoding="utf-8") as file:
                file.write(f"\n[All parameters, drawn](parameters/{chosen.name}.md)\n")


def _add_contents(index: Path, pages: list[str]) -> None:
    """Append the tables of contents, one for each section, to the first page."""
    text = index.read_text(encoding="utf-8")
    index.write_text(text.replace("in the gallery", "in the [gallery](gallery.md)"), "utf-8")
    sections = {"Overview": ["gallery"], **navigation(pages)}
    sections["Reference"] = ["parameters/index", "reference/index"]
    with index.open("a", encoding="utf-8") as file:
        for caption, found in sections.items():
            names = "\n".join(found)
            file.write(f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{names}\n```\n")


def main(arguments: list[str]) -> int:
    """Build the site and check it; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "site")
    parser.add_argument(
        "--pictures", choices=("drawn", "kept"), default="drawn", help="draw them, or take docs/'s"
    )
    given = parser.parse_args(arguments)
    build = given.output.parent
    source, cache = build / "site-source", build / "site-pictures" / state()
    shutil.rmtree(source, ignore_errors=True)
    shutil.rmtree(given.output, ignore_errors=True)
    cache.mkdir(parents=True, exist_ok=True)
    clock = time.perf_counter()
    write_pages(source, cache, given.pictures == "drawn")
    print(f"pages and pictures: {time.perf_counter() - clock:.0f} s")
    sphinx = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    subprocess.run([*sphinx, source, given.output], check=True)
    print(f"site: {time.perf_counter() - clock:.0f} s, {given.output / 'index.html'}")
    return check(given.output)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
