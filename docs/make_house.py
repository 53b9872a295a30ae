"""Draw the folders of the core and the adapters, with an arrow from each to what it imports.

    python docs/make_house.py          # writes docs/pictures/folders.svg

Boxes, their texts and arrows are read from the sources, so the picture cannot be wrong; a test
compares it. An arrow that follows from two others is left out: where A needs B and B needs C, no
arrow goes from A to C. A box stands above everything it imports.
"""

from __future__ import annotations

import ast
import textwrap
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CORE = ROOT / "core" / "medialis"
PICTURE = ROOT / "docs" / "pictures" / "folders.svg"
ADAPTERS = {
    "blender_addon": ROOT / "blender_addon",
    "medialis_meshset": ROOT / "meshlab_plugin" / "medialis_meshset",
    "medialis_meshlab": ROOT / "meshlab_plugin" / "medialis_meshlab",
}
PACKAGES = {"medialis": CORE, **ADAPTERS}
BOX_WIDTH, BOX_HEIGHT, GAP, FLOOR = 208, 74, 18, 116
"""Sizes in pixels: of a box, between boxes, from floor to floor."""

STYLE = """\
text { font: 12px sans-serif; fill: #33475b; }
.name { font: bold 15px sans-serif; fill: #1b2a3a; }
rect { fill: #eef3f7; stroke: #33475b; stroke-width: 1.2; }
.feature { fill: #d9ebf8; }
.adapter { fill: #fbe9cf; }
path { stroke: #5b7084; stroke-width: 1.3; fill: none; marker-end: url(#tip); }
#tip path { fill: #5b7084; stroke: none; }
@media (prefers-color-scheme: dark) {
  text { fill: #b9c7d4; } .name { fill: #e8eef4; }
  rect { fill: #24313d; stroke: #9fb3c6; } .feature { fill: #1d3f59; } .adapter { fill: #54401f; }
}"""


def modules(package: str = "medialis") -> list[Path]:
    """Return the source files of a package; scripts that stand for themselves are left out."""
    paths = sorted(PACKAGES[package].rglob("*.py"))
    left_out = {"packaging", "examples"}
    return [path for path in paths if not left_out & set(path.relative_to(PACKAGES[package]).parts)]


def dotted(path: Path, package: str = "medialis") -> str:
    """Return the name by which a file is imported."""
    parts = path.relative_to(PACKAGES[package]).with_suffix("").parts
    return ".".join((package, *parts)).removesuffix(".__init__")


def imports(path: Path, package: str = "medialis") -> set[str]:
    """Return modules and names that a file imports anywhere, TYPE_CHECKING blocks left out."""
    found: set[str] = set()
    own = dotted(path, package).split(".")
    if path.name != "__init__.py":
        own = own[:-1]

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = own[: len(own) - node.level + 1] if node.level else []
            module = ".".join([*above, *([node.module] if node.module else [])])
            found.add(module)
            found.update(f"{module}.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return found


def folder_imports() -> dict[str, set[str]]:
    """Return for each folder of the core, and each adapter, the ones whose modules it imports."""
    arrows: dict[str, set[str]] = {
        path.name: set() for path in CORE.iterdir() if (path / "__init__.py").is_file()
    }
    for path in modules():
        name = path.relative_to(CORE).parts[0]
        for other in imports(path) if name in arrows else ():
            parts = other.split(".")
            if parts[0] == "medialis" and len(parts) > 1 and parts[1] != name:
                arrows[name].update({parts[1]} & arrows.keys())
    core = set(arrows)
    for adapter in ADAPTERS:
        arrows[adapter] = set()
        for path in modules(adapter):
            for other in imports(path, adapter):
                parts = other.split(".")
                if parts[0] == "medialis":  # the public names stand in no folder
                    arrows[adapter].update({"".join(parts[1:2])} & core)
                elif parts[0] in ADAPTERS and parts[0] != adapter:
                    arrows[adapter].add(parts[0])
    return arrows


def _below(arrows: dict[str, set[str]], name: str) -> set[str]:
    """Return everything that a folder imports, by way of others as well."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        new = arrows[waiting.pop()] - found
        found |= new
        waiting += new
    return found


def _places(arrows: dict[str, set[str]]) -> dict[str, tuple[float, float]]:
    """Put each folder on the floor above all it imports, over the middle of what it needs."""
    floors: dict[str, int] = {}
    while len(floors) < len(arrows):
        for name in sorted(arrows.keys() - floors.keys()):
            if arrows[name] <= floors.keys():
                floors[name] = max((floors[other] + 1 for other in arrows[name]), default=0)
    widest = max(list(floors.values()).count(floor) for floor in floors.values())
    width = widest * (BOX_WIDTH + GAP)
    places: dict[str, tuple[float, float]] = {}
    for floor in range(max(floors.values()) + 1):
        row = [name for name in sorted(floors) if floors[name] == floor]
        over = {
            name: sum(places[other][0] for other in arrows[name]) / max(1, len(arrows[name]))
            for name in row
        }
        row.sort(key=lambda name: (over[name], name))
        for i, name in enumerate(row):
            x = width * (i + 0.5) / len(row) - BOX_WIDTH / 2
            places[name] = (x, FLOOR * (max(floors.values()) - floor))
    return places


def _text(name: str) -> str:
    """Return the first sentence of a folder's text."""
    folder = PACKAGES.get(name, CORE / name)
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))
    return (
        (text or "")
        .replace("`", "")
        .split("\n\n")[0]
        .replace("\n", " ")
        .split(". ")[0]
        .split(" (thesis")[0]
    )


def picture() -> str:
    """Return the picture as SVG."""
    arrows = folder_imports()
    direct = {
        name: {a for a in others if not any(a in _below(arrows, b) for b in others - {a})}
        for name, others in arrows.items()
    }
    places = _places(direct)
    features = {path.parent.relative_to(CORE).parts[0] for path in CORE.glob("*/**/*operation.py")}
    width = max(x for x, _ in places.values()) + BOX_WIDTH + GAP / 2
    height = max(y for _, y in places.values()) + BOX_HEIGHT + GAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 {-GAP / 2:g} {width:g} {height:g}">',
        "<title>The folders of medialis: an arrow leads to what a folder imports</title>",
        f"<style>{STYLE}</style>",
        '<marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto"><path d="M0 0 8 4 0 8z"/></marker>',
    ]
    for name in sorted(direct):
        x, y = places[name]
        for other in sorted(direct[name]):
            to, bottom = places[other]
            start, end = y + BOX_HEIGHT, bottom
            across, down = x + BOX_WIDTH / 2, to + BOX_WIDTH / 2
            bend = (end - start) / 2 if end - start < FLOOR else FLOOR / 2
            parts.append(
                f'<path d="M{across:g} {start:g}C{across:g} {start + bend:g} '
                f'{down:g} {end - bend:g} {down:g} {end:g}"/>'
            )
    for name in sorted(places):
        x, y = places[name]
        kind = "adapter" if name in ADAPTERS else "feature" if name in features else "ground"
        parts.append(
            f'<rect class="{kind}" x="{x:g}" y="{y:g}" width="{BOX_WIDTH}" '
            f'height="{BOX_HEIGHT}" rx="7"/>'
            f'<text class="name" x="{x + 9:g}" y="{y + 19:g}">{escape(name)}</text>'
        )
        lines = textwrap.wrap(_text(name), 30, max_lines=3, placeholder=" ...")
        for i, line in enumerate(lines):
            parts.append(f'<text x="{x + 9:g}" y="{y + 35 + 15 * i:g}">{escape(line)}</text>')
    return "\n".join([*parts, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
    print(PICTURE.relative_to(ROOT))
