"""Results as people get them: they show themselves, and are read back from the folders of results.

They show in a browser, a notebook and a page; `read_result` reads what `write_result` wrote.
"""

from __future__ import annotations

import functools
import json
import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from medialis.base.disk import Folder
from medialis.base.errors import FileError, InvalidOptionError, InvalidShapeError, NotPassedError
from medialis.base.options import Kind
from medialis.base.progress import Message
from medialis.formats.files import file_bytes, reading, write_text
from medialis.formats.json_npz import read_npz
from medialis.formats.output_folder import MANIFEST
from medialis.formats.ply_attributes import read_ply_attributes
from medialis.operations import registry
from medialis.operations import result as results
from medialis.operations.result import FilterUnit, Layer, Outcome, value_lines
from medialis.shape.shape import Shape


class Result(results.Result):
    """What `medialis.run` and `medialis.read_result` give; see `medialis.operations.result`."""

    @classmethod
    def of(cls, result: results.Result) -> Result:
        """Return a result of the registry as one that shows itself."""
        return cls(**{one.name: getattr(result, one.name) for one in fields(result)})

    @property
    def graph(self) -> Any:
        """The curve skeleton of the result; None: it has none."""
        return self.extras.get("graph")

    @property
    def rig(self) -> Any:
        """Its bones; None: it has none."""
        return self.extras.get("bones")

    @property
    def skin(self) -> Any:
        """Weights of the bones on the points of the given shape; None: it has none."""
        return self.extras.get("skin")

    @property
    def passed(self) -> bool | None:
        """Whether the shape passes the check; None where there is no check, or no verdict."""
        return self.values.get("passed")

    def require(self) -> Result:
        """Return the result itself, where the shape passes or the operation checks nothing.

        Raises
        ------
        NotPassedError
            With the verdict, where it does not pass or there is no verdict.
        """
        if not self.values.get("passed", True):
            raise NotPassedError(str(self.values["verdict"]))
        return self

    def viewer_html(
        self, path: str | os.PathLike[str], *others: Outcome, title: str | None = None
    ) -> None:
        """Write one HTML file that shows the result in three dimensions, by itself.

        Parameters
        ----------
        path : path
            An existing file is replaced.
        *others : Result
            Of the same shape: more layers to switch on.
        title : str, optional
            Of the page; the operation when missing.

        Raises
        ------
        FileError
            When the page cannot be written, or the library that it draws with is missing.
        """
        from medialis.show.viewer.page import write_viewer

        write_viewer(path, (self, *others), title or self.title)

    def write_report(
        self, path: str | os.PathLike[str], *, source: str | None = None
    ) -> tuple[Path, Path]:
        """Write the report as one HTML file, and the same numbers beside it as JSON.

        Parameters
        ----------
        path : path
            Ends with .html; existing files are replaced.
        source : str, optional
            Name of the shape, for titles.

        Returns
        -------
        tuple of Path
            The page and the JSON file.

        Raises
        ------
        FileError
            When they cannot be written.
        """
        from medialis.show.reports.report import report_texts

        page = Path(path)
        files = page, page.with_suffix(".json")
        texts = report_texts(self, source=source)
        for file, text in zip(files, texts.values(), strict=True):
            write_text(file, text)
        return files

    def show(self, *others: Outcome) -> Path | None:
        """Show the result in three dimensions: in the notebook, else in the browser.

        Returns
        -------
        Path or None
            The page that the browser was given; None in a notebook.
        """
        from medialis.show.viewer.page import show_page, viewer_page

        return show_page(viewer_page((self, *others), self.title), self.operation)

    def _repr_html_(self) -> str:
        """Return what notebooks show: a small picture beside the values."""
        import html

        from medialis.show.picture import picture_html

        lines = [*value_lines(self.values, self.shape.unit), *map(str, self.messages)]
        told = "<br>".join(html.escape(line) for line in lines)
        return (
            '<div style="display:flex;gap:1em;align-items:flex-start;flex-wrap:wrap">'
            f"{picture_html(self)}<div style='flex:1 1 20em'><b>{html.escape(self.title)}</b><br>"
            f"{told}</div></div>"
        )


@functools.wraps(registry.run)
def run(*given: Any, **options: Any) -> Result:
    """Run an operation; its result shows itself."""
    return Result.of(registry.run(*given, **options))


run.__annotations__ = {**registry.run.__annotations__, "return": Result}


OF_LAYERS = (
    *("name", "color_by", "color_map", "filter_by", "filter_default", "number_by", "on_input"),
    *("auxiliary", "role"),
)
LISTS = ("labels", "color_limits", "formats")
"""What a manifest tells of layers as it is, and as lists."""
LOOKS = ("color_by", "color_limit", "classes")
"""What it tells of the layers that pictures show, which may look otherwise than those written."""


def read_result(folder: str | os.PathLike[str]) -> Result:
    """Read a result from its folder.

    Parameters
    ----------
    folder : path
        From `write_result`, the command line or a batch.

    Returns
    -------
    Result
        With its layers, values, arrays, graph (where JSON was written) and messages, without
        pictures, bones and skin weights.

    Raises
    ------
    FileError
        When there is no result, or a file of it is missing.
    InvalidShapeError
        When a file is damaged.

    See Also
    --------
    write_result : writes the folder.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = medialis.write_result(result, folder, pictures=medialis.Pictures(main=False))
    ...     again = medialis.read_result(folder)
    >>> again.values["thickness_min"] == result.values["thickness_min"]
    True
    """
    base = Path(folder)
    with ExitStack() as stack:
        try:
            folder_there = stack.enter_context(Folder.at(base))
            there = folder_there.about(MANIFEST) is not None
        except OSError:
            there = False
        if not there:
            raise FileError(f"{base} holds no result: there is no {MANIFEST} in it.")
        stack.enter_context(folder_there.held())  # names in the manifest lead nowhere else
        stack.enter_context(reading(base / MANIFEST))
        manifest = json.loads(file_bytes(os.fspath(base / MANIFEST)))
        layers = {row["name"]: _layer(folder_there, row) for row in manifest["layers"]}
        name = str(manifest["operation"])
        arrays = read_npz(folder_there.path_of(f"{name}.npz"))
        return Result(
            shape=_shape(arrays, layers, unit=manifest.get("unit"), up=manifest.get("up")),
            layers=tuple(layers.values()),
            values=manifest["values"],
            arrays=arrays,
            shown=tuple(_shown(layers, manifest)),
            extras=_extras(folder_there, name),
            operation=name,
            parameters=manifest["parameters"],
            seconds=manifest["seconds"],
            messages=tuple(map(_message, manifest["messages"], manifest["notes"])),
            automatic=tuple(manifest.get("automatic", ())),
        )


def _shown(layers: Mapping[str, Layer], manifest: Mapping[str, Any]) -> Iterator[Layer]:
    """Yield the layers that pictures show, as they look there; older manifests do not tell how."""
    names = manifest.get("shown", ())
    for name, look in zip(names, manifest.get("looks", [{}] * len(names)), strict=True):
        known = {one: look[one] for one in LOOKS if one in look}
        classes = tuple(
            (str(kind), tuple(map(float, rgb))) for kind, rgb in look.get("classes", ())
        )
        yield replace(layers[name], **known | {"classes": classes})


def _extras(folder: Folder, name: str) -> dict[str, Any]:
    """Read what the operation's own formats give back; nothing where none of them was written."""
    try:
        formats = registry.operation(name).formats
    except InvalidOptionError:  # of another version
        return {}
    files = [(one, f"{name}.{one.name}") for one in formats]
    there = [(one, file) for one, file in files if one.read and folder.about(file) is not None]
    return {one.of: one.read(folder.path_of(file)) for one, file in there if one.read}


def _layer(folder: Folder, row: Mapping[str, Any]) -> Layer:
    unit = row["filter_unit"]
    told: dict[str, Any] = {name: row.get(name) for name in OF_LAYERS}
    return Layer(
        **vars(read_ply_attributes(folder.path_of(f"{row['name']}.ply"))),
        filter_unit=FilterUnit(**{**unit, "kind": Kind(unit["kind"])}),
        facts=row.get("facts", {}),
        **told | {name: tuple(row.get(name, ())) for name in LISTS},
    )


def _message(text: str, note: Mapping[str, Any]) -> Message:
    level = logging.WARNING if note["warning"] else logging.INFO
    return Message(text, note["code"], level, **note["data"])


def _shape(arrays: Mapping[str, Any], layers: Mapping[str, Layer], **told: Any) -> Shape:
    """Return the surface as computed on: from the arrays, else the layer that shows it.

    Raises
    ------
    InvalidShapeError
        When neither has it.
    """
    if {"points", "normals"} <= arrays.keys():
        faces = arrays.get("faces")
        return Shape(arrays["points"], arrays["normals"], faces, **told)
    surfaces = [layer for layer in layers.values() if layer.name == "samples" or layer.on_input]
    for layer in [*surfaces, *layers.values()]:
        normals = layer.attributes.get("normal", np.zeros(layer.points.shape))
        return Shape(layer.points, normals, layer.faces, **told)
    raise InvalidShapeError("it holds no points.")
