"""Pages that are written from the registry and the package: parameters, gallery, reference."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import medialis
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.registry import OPERATIONS
from medialis.show.annotation import number_text
from website.pages import operation_of
from website.strips import (
    Panel,
    can_be_seen,
    changing_values,
    default_picture,
    default_viewer,
    strip,
)

KINDS = {
    Kind.FLOAT: "number",
    Kind.INT: "whole number",
    Kind.BOOL: "yes or no",
    Kind.CHOICE: "choice",
    Kind.LENGTH: "fraction of the size",
    Kind.ANGLE: "degrees",
    Kind.FILE: "file",
}


def shown(parameter: Parameter, value: Any) -> str:
    """Return a value as people read it."""
    if parameter.kind is Kind.BOOL:
        return "yes" if value else "no"
    if parameter.kind in (Kind.CHOICE, Kind.FILE) or isinstance(value, str):
        return str(value) or "none"
    if parameter.kind is Kind.INT:
        return str(int(value))
    return f"{value:.6g}" + (" degrees" if parameter.kind is Kind.ANGLE else "")


def _range(parameter: Parameter) -> str:
    if parameter.kind is Kind.CHOICE:
        return ", ".join(f"`{choice}`" for choice in parameter.choices)
    if parameter.kind in (Kind.BOOL, Kind.FILE):
        return ""
    return f"{shown(parameter, parameter.low)} to {shown(parameter, parameter.high)}"


def command_line_flag(parameter: Parameter) -> str:
    """Return the flag of the command line."""
    flag = "--" + parameter.name.replace("_", "-")
    return f"{flag}, --no-{flag[2:]}" if parameter.kind is Kind.BOOL else flag


def parameter_page(operation: Operation, pages: list[str], pictures: Path) -> str:
    """Return the page of an operation: its names in every program, and all its parameters."""
    first, _, more = operation.help.partition("\n")
    dashed = operation.name.replace("_", "-")
    lines = [
        f"# {operation.label}: parameters",
        f"{first} ({operation.source})" if operation.source else first,
        more.strip(),
        *(
            f"[The page of this operation](../{page}.md) explains it with pictures."
            for page in pages
            if operation_of(page) is operation
        ),
        "| program | name |\n|---|---|\n"
        f"| command line | `medialis {dashed} FILE` |\n"
        f'| Python | `medialis.run("{operation.name}", shape)` |\n'
        f"| Blender | `bpy.ops.medialis.{operation.name}()` |\n"
        f"| MeshLab and pymeshlab | `{operation.filter_name}` |",
        "Parameters have the same names everywhere: those below in Python, Blender, MeshLab and "
        "pymeshlab, with dashes on the command line. Lengths are fractions of the bounding-box "
        "diagonal in Python and on the command line (0.01 is 1 %), and per cent in Blender and "
        "MeshLab. Angles are in degrees."
        + (" Needs a mesh: point clouds have no faces." if operation.needs_faces else ""),
        _overview(operation),
        *(_section(operation, parameter, pictures) for parameter in operation.parameters),
    ]
    return "\n\n".join(line for line in lines if line) + "\n"


def _overview(operation: Operation) -> str:
    rows = [
        f"| [{p.label}](#{_anchor(p)}) | `{p.name}` | `{command_line_flag(p)}` | {KINDS[p.kind]} "
        f"| {shown(p, p.default)} | {_range(p)} |"
        for p in operation.parameters
    ]
    head = "| label | name | flag | kind | default | range |\n|---|---|---|---|---|---|"
    return "\n".join([head, *rows]) if rows else "It has no parameters."


def _anchor(parameter: Parameter) -> str:
    """Anchor that MyST gives to the heading of a parameter."""
    return re.sub(r"[^\w -]", "", parameter.label.lower()).replace(" ", "-")


def _section(operation: Operation, parameter: Parameter, pictures: Path) -> str:
    text = parameter.full_help + (" Hosts fold it away under *More*." if parameter.advanced else "")
    lines = [f"## {parameter.label}", f"`{parameter.name}`: {text}"]
    panels = strip(operation, parameter, pictures)
    if panels and can_be_seen(panels):
        figures = "\n".join(_figure(parameter, panel, changing_values(panels)) for panel in panels)
        lines.append(f"::::{{container}} strip{_width(panels)}\n{figures}\n::::")
    elif panels:
        lines.append(_numbers(parameter, panels))
    elif parameter.kind is not Kind.FILE:
        lines.append("On the shape of these pictures it changes nothing.")
    return "\n\n".join(lines)


def _width(panels: Sequence[Panel]) -> str:
    """Return the class of a strip whose pictures need the whole width of the page each."""
    return " wide" if any(p.glance and len(p.glance[0]) > 2 * len(p.glance) for p in panels) else ""


def _numbers(parameter: Parameter, panels: Sequence[Panel]) -> str:
    """Return what a strip would not show: a table of the numbers that change."""
    names = changing_values(panels)[:3]
    text = "The pictures of its values look the same"
    if not names:
        return text + "."
    head = "| ".join(["", parameter.label.lower(), *(n.replace("_", " ") for n in names), ""])
    rows = [
        "| ".join(["", shown(parameter, p.value), *(f"{p.values[n]:.6g}" for n in names), ""])
        for p in panels
    ]
    return "\n".join([f"{text}; in numbers:\n", head, "|---" * (len(names) + 1) + "|", *rows])


def _figure(parameter: Parameter, panel: Panel, names: Sequence[str]) -> str:
    value = shown(parameter, panel.value)
    default = " (default)" if panel.value == parameter.default else ""
    title = f"{parameter.label}: {value}"
    if panel.picture is None:
        return f":::{{container}} refused\n**{value}**{default}\n\n{panel.error}\n:::"
    caption = f"**{value}**{default}"
    for name in names[:1]:
        number = panel.values[name]
        text = str(number) if isinstance(number, int) else number_text(number)
        caption += f"\n{name.replace('_', ' ')}: {text}"
    options = f":alt: {title}\n:target: ../_images/{panel.picture}"
    return f":::{{figure}} pictures/{panel.picture}\n{options}\n\n{caption}\n:::"


def parameters_index() -> str:
    """Return the page that lists the pages of all operations."""
    rows = [
        f"| [{o.label}]({o.name}.md) | {', '.join(p.label.lower() for p in o.parameters)} |"
        for o in OPERATIONS
    ]
    tree = "\n".join(o.name for o in OPERATIONS)
    return (
        "# Parameters\n\nEvery parameter of every operation: its names, its range, and what it "
        "does, drawn at values from low to high.\n\n| operation | parameters |\n|---|---|\n"
        + "\n".join(rows)
        + f"\n\n```{{toctree}}\n:hidden:\n\n{tree}\n```\n"
    )


def gallery(pages: list[str], pictures: Path) -> str:
    """Return the page of cards: a picture and a sentence for each operation, by group."""
    lines = ["# Gallery", "Every operation at its defaults, on a shape that is made by code."]
    for group in dict.fromkeys(o.group for o in OPERATIONS):
        lines.append(f"## {group}\n\n::::{{container}} cards")
        for chosen in (o for o in OPERATIONS if o.group == group):
            page = next((p for p in pages if p == chosen.name), f"parameters/{chosen.name}")
            page = next((p for p in pages if operation_of(p) is chosen), page)
            name, viewer = default_picture(chosen, pictures), default_viewer(chosen, pictures)
            turn = f' <a href="{viewer}">Turn it.</a>' if viewer else ""
            lines.append(
                f":::{{figure}} parameters/pictures/{name}\n:alt: {chosen.label}\n"
                f":target: {page}.html\n\n[{chosen.label}]({page}.md)\n"
                f"{chosen.help.splitlines()[0]}{turn}\n:::"
            )
        lines.append("::::")
    return "\n\n".join(lines) + "\n"


GROUP = re.compile(r"^(\w[\w ]*):\n((?:    .*\n?)+)", re.MULTILINE)
"""A group of public names in the docstring of the package."""


def groups() -> dict[str, list[str]]:
    """Return the public names by group, as the docstring of the package has them."""
    found = GROUP.findall(inspect.getdoc(medialis) or "")
    return {title: names.replace(",", " ").split() for title, names in found}


def reference() -> dict[str, str]:
    """Return the pages of the Python reference by name: one for each group."""
    pages, rows = {}, []
    for title, names in groups().items():
        page = title.lower().replace(" ", "_")
        things = [name for name in names if callable(getattr(medialis, name))]
        entries = "\n\n".join(_entry(name) for name in things)
        pages[f"reference/{page}"] = (
            f"# {title}\n\n```{{eval-rst}}\n.. currentmodule:: medialis\n\n{entries}\n```\n"
        )
        rows.append(f"- [{title}]({page}.md): " + ", ".join(f"`{name}`" for name in names))
    tree = "\n".join(page.rpartition("/")[2] for page in pages)
    pages["reference/index"] = (
        "# Python reference\n\nThe public names of `import medialis`; "
        "[what each is for](../api.md).\n\n"
        + "\n".join(rows)
        + f"\n\n```{{toctree}}\n:hidden:\n\n{tree}\n```\n"
    )
    return pages


def _entry(name: str) -> str:
    thing = getattr(medialis, name)
    if inspect.isclass(thing):
        members = "" if issubclass(thing, Exception) else "\n   :members:"
        return f".. autoclass:: {name}{members}"
    return f".. autofunction:: {name}"
