"""Results as people get them: they show themselves, in a browser, a notebook and a page."""

from __future__ import annotations

import functools
import html
import os
from dataclasses import fields
from pathlib import Path
from typing import Any

from medialis.operations import registry
from medialis.operations import result as results
from medialis.operations.result import Outcome, value_lines


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
