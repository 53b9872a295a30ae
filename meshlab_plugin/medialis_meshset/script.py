# SPDX-License-Identifier: GPL-3.0-or-later
"""The filter script of a MeshSet: without the filters that we apply on the way, and with our own.

pymeshlab records every filter that it applies, and runs no other; it keeps what it does not know in
a script that it loads. So our filters are written into its script, and run from here.
"""

from __future__ import annotations

import os
import tempfile
import xml.etree.ElementTree as Xml
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from itertools import groupby
from pathlib import Path
from typing import Any

import pymeshlab

from medialis.hosts import AUTO, Filter, Kind, filters

HEADER = "<!DOCTYPE FilterScript>\n"
TYPES = {
    **{Kind.FLOAT: "RichFloat", Kind.ANGLE: "RichFloat", Kind.INT: "RichInt"},
    **{Kind.BOOL: "RichBool", Kind.CHOICE: "RichEnum", Kind.FILE: "RichString"},
    Kind.LENGTH: "RichAbsPerc",
}


@contextmanager
def filter_script_kept(mesh_set: pymeshlab.MeshSet) -> Iterator[None]:
    """Give the MeshSet its filter script back at the end of the block."""
    before = _script_of(mesh_set)
    try:
        yield
    finally:
        _load(mesh_set, before)


def record(mesh_set: pymeshlab.MeshSet, chosen: Filter, values: Mapping[str, Any]) -> None:
    """Write a filter into the script; `values` has all parameters, lengths as fractions."""
    script = _script_of(mesh_set)
    step = Xml.SubElement(script, "filter", name=chosen.title)
    for parameter in (*chosen.parameters, *chosen.host_parameters):
        value = values[parameter.name]
        more: dict[str, str] = {}
        automatic = parameter.auto is not None and value == AUTO
        kind = "RichString" if automatic else TYPES[parameter.kind]
        if parameter.kind is Kind.LENGTH and not automatic:  # per cent: 3 of 100
            value, more = 100.0 * value, {"min": "0", "max": "100"}
        elif parameter.kind is Kind.CHOICE:
            more = {f"enum_val{i}": word for i, word in enumerate(parameter.choices)}
            more["enum_cardinality"] = str(len(parameter.choices))
            value = parameter.choices.index(value)
        text = str(value).lower() if parameter.kind is Kind.BOOL else str(value)
        about = {"name": parameter.name, "type": kind, "value": text, **more}
        Xml.SubElement(step, "Param", {**about, "description": parameter.label, "tooltip": ""})
    _load(mesh_set, script)


def apply_script(
    mesh_set: pymeshlab.MeshSet,
    apply_theirs: Callable[[pymeshlab.MeshSet], None],
    run_ours: Callable[[str, dict[str, Any]], Any],
) -> None:
    """Run the filters of the script in their order, ours and those of pymeshlab."""
    script = _script_of(mesh_set)
    titles = {chosen.title: chosen for chosen in filters()}
    with filter_script_kept(mesh_set):
        steps = groupby(script, key=lambda step: titles.get(step.get("name", "")))
        for chosen, group in steps:
            if chosen is None:
                part = Xml.Element(script.tag)
                part.extend(group)
                _load(mesh_set, part)
                apply_theirs(mesh_set)
                continue
            for step in group:
                run_ours(chosen.name, _given(chosen, step))


def _given(chosen: Filter, step: Xml.Element) -> dict[str, Any]:
    """Return the parameters of a step as a filter takes them."""
    known = {p.name: p for p in (*chosen.parameters, *chosen.host_parameters)}
    given: dict[str, Any] = {}
    for row in step:
        parameter, text = known.get(row.get("name", "")), row.get("value", "")
        if parameter is None:
            continue
        if parameter.auto is not None and text == AUTO:
            given[parameter.name] = AUTO
        elif parameter.kind is Kind.LENGTH:
            share = float(text) / (float(row.get("max", "100")) or 1.0)
            given[parameter.name] = pymeshlab.PercentageValue(100.0 * share)
        elif parameter.kind is Kind.BOOL:
            given[parameter.name] = text == "true"
        elif parameter.kind is Kind.FILE:
            given[parameter.name] = text
        else:
            whole = parameter.kind in (Kind.INT, Kind.CHOICE)
            given[parameter.name] = int(text) if whole else float(text)
    return given


def _script_of(mesh_set: pymeshlab.MeshSet) -> Xml.Element:
    with tempfile.TemporaryDirectory(prefix="medialis-") as folder:
        file = Path(folder) / "script.mlx"
        _save_filter_script(mesh_set, str(file))
        return Xml.fromstring(file.read_text(encoding="utf-8"))


def _load(mesh_set: pymeshlab.MeshSet, script: Xml.Element) -> None:
    _clear_filter_script(mesh_set)
    if not len(script):
        return
    with tempfile.TemporaryDirectory(prefix="medialis-") as folder:
        file = Path(folder) / "script.mlx"
        file.write_text(HEADER + Xml.tostring(script, "unicode"), encoding="utf-8")
        with _standard_error_silent():
            _load_filter_script(mesh_set, str(file))


_save_filter_script = pymeshlab.MeshSet.save_filter_script
_load_filter_script = pymeshlab.MeshSet.load_filter_script
_clear_filter_script = pymeshlab.MeshSet.clear_filter_script


@contextmanager
def _standard_error_silent() -> Iterator[None]:
    """Send to nowhere what C++ code prints: MeshLab prints a line for each filter that it loads.

    Where there is no such stream, there is nothing to silence.
    """
    with ExitStack() as stack:
        with suppress(OSError):
            kept = os.dup(2)
            stack.callback(os.close, kept)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            stack.callback(os.close, nowhere)
            os.dup2(nowhere, 2)
            stack.callback(os.dup2, kept, 2)
        yield
