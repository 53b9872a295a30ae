# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel and the reports tell about a result."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from medialis import Layer, Result, operation
from medialis.hosts import value_lines, with_labels

PROPERTY = "medialis_summary"
"""Custom property of objects: the lines of `lines`."""


def headline(result: Result, layers: Sequence[Layer], name: str) -> str:
    """Return one sentence: operation, object, points of the first layer, seconds."""
    count = f"{len(layers[0].points)} points" if layers else "no points"
    label = operation(result.operation).label
    return f"{label} of {name}: {count}, {result.seconds['total']:.1f} s"


def lines(result: Result, layers: Sequence[Layer], name: str) -> str:
    """Return the summary, a line each: the headline, values, and messages marked "! " or "!! ".

    Two marks are a warning: the user may want to do something.
    """
    options = operation(result.operation).parameters
    return "\n".join(
        [
            headline(result, layers, name),
            *value_lines(result.values, result.shape.unit),
            *(f"{_mark(m)} {with_labels(m, options)}" for m in result.messages),
        ]
    )


def _mark(message: str) -> str:
    return "!!" if getattr(message, "level", logging.INFO) >= logging.WARNING else "!"
