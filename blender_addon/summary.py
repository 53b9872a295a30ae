# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel and the reports tell about a result."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from medialis import Layer, Result, operation
from medialis.hosts import value_lines

PROPERTY = "medialis_summary"
"""Custom property of objects: the lines of `lines`."""


def headline(result: Result, layers: Sequence[Layer], name: str) -> str:
    """Return one sentence: operation, object, points of the first layer, seconds."""
    count = f"{len(layers[0].points)} points" if layers else "no points"
    label = operation(result.operation).label
    return f"{label} of {name}: {count}, {result.seconds['total']:.1f} s"


def lines(result: Result, layers: Sequence[Layer], name: str, earlier: int = 0) -> str:
    """Return the summary, a line each: the headline, values, and messages marked "! " or "!! ".

    Two marks are a warning: the user may want to do something.

    `earlier` objects of the same layers are there already; Blender numbers the new ones.
    """
    messages = list(result.messages)
    if earlier:
        one = earlier == 1
        messages.append(
            f"{earlier} earlier result{'' if one else 's'} of this kind {'is' if one else 'are'} "
            "still there; delete what is not needed."
        )
    return "\n".join(
        [
            headline(result, layers, name),
            *value_lines(result.values, result.shape.unit),
            *(f"{_mark(message)} {message}" for message in messages),
        ]
    )


def _mark(message: str) -> str:
    return "!!" if getattr(message, "level", logging.INFO) >= logging.WARNING else "!"
