"""The page of the viewer where the user is: in a notebook, or in the browser."""

from __future__ import annotations

import html
import importlib
import re
import sys
import tempfile
import webbrowser
from pathlib import Path
from typing import Any

HEIGHT = 560
"""Pixels in a notebook."""


def show_page(text: str, name: str) -> Path | None:
    """Show a page in the notebook that asks, else in the browser.

    Returns
    -------
    Path or None
        The file that the browser was given; None in a notebook.
    """
    shell = _notebook()
    if shell is not None:
        display = importlib.import_module("IPython.display")
        display.display(display.HTML(frame(text)))
        return None
    words = re.sub(r"\W+", "-", name).strip("-") or "view"
    path = Path(tempfile.mkdtemp(prefix="medialis-")) / f"{words}.html"
    path.write_text(text, encoding="utf-8")
    webbrowser.open(path.as_uri())
    return path


def frame(text: str, height: int = HEIGHT) -> str:
    """Return a page as a frame for another page, with all that it needs inside."""
    return (
        f'<iframe srcdoc="{html.escape(text)}" width="100%" height="{height}" '
        'style="border:0;border-radius:10px" allow="fullscreen"></iframe>'
    )


def _notebook() -> Any:
    """Return the shell of the notebook that runs this, None elsewhere (IPython in a terminal)."""
    if "IPython" not in sys.modules:
        return None
    shell = importlib.import_module("IPython").get_ipython()
    return shell if hasattr(shell, "kernel") else None
