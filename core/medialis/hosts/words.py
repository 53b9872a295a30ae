"""Names and numbers as hosts write them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Mapping, Sequence
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidOptionError
from medialis.options import Kind, Parameter

MOST_PICKED = 100
"""Vertices that are taken as the ends of paths: nobody picks more by hand."""


def title(name: str) -> str:
    """Return the name of a layer, attribute or image for people.

    Examples
    --------
    >>> title("curve_skeleton")
    'curve skeleton'
    """
    return name.replace("_", " ")


def label_name(name: str, label: int) -> str:
    """Return the name of a segment, for groups and materials.

    Examples
    --------
    >>> label_name("part", 3), label_name("part", -1)
    ('part 003', 'part none')
    """
    return f"{name} none" if label < 0 else f"{name} {label:03d}"


def identifier(name: str) -> str:
    """Return a name as expressions can hold it: letters, digits, underscores.

    Examples
    --------
    >>> identifier("3 % of size")
    '_3___of_size'
    """
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{word}" if word[:1].isdigit() else word


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, or with _2, _3, ... when it is taken in any case of letters.

    Examples
    --------
    >>> free_name("radius", ["Radius", "radius_2"])
    'radius_3'
    """
    known = {other.lower() for other in taken}
    number, free = 1, name
    while free.lower() in known:
        number += 1
        free = f"{name}_{number}"
    return free


def distinct_names(
    attributes: Mapping[str, Any], face_attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the face attributes under names that those of the points do not have.

    Examples
    --------
    >>> distinct_names({"part": 0}, {"part": 1, "side": 2})
    {'part_of_face': 1, 'side': 2}
    """
    return {
        f"{name}_of_face" if name in attributes else name: values
        for name, values in face_attributes.items()
    }


def picked_lines(parameter: Parameter, vertices: Sequence[int] | NDArray[np.int64]) -> str:
    r"""Return the file of an option that lists vertices, or pairs of them, for picked ones.

    A path runs from each to the next.

    Raises
    ------
    InvalidOptionError
        When there is no pair, or there are too many for hand-picked ones.

    Examples
    --------
    >>> import medialis
    >>> options = medialis.operation("geodesic_path").parameters
    >>> (pairs,) = [option for option in options if option.selection]
    >>> picked_lines(pairs, [3, 8, 5])
    '3 8\n8 5\n'
    """
    rows = [int(row) for row in vertices]
    if parameter.selection != "pair":
        return "".join(f"{row}\n" for row in rows)
    if not 2 <= len(rows) <= MOST_PICKED:
        raise InvalidOptionError(
            f"Select 2 to {MOST_PICKED} vertices, the ends of paths, one after the other; "
            f"{len(rows)} {'is' if len(rows) == 1 else 'are'} selected."
        )
    return "".join(f"{one} {other}\n" for one, other in itertools.pairwise(rows))


def as_typed(value: float, *, percent: bool = False) -> float:
    """Return the number that a user typed into a widget that keeps single precision.

    Parameters
    ----------
    value : float
        What the widget holds.
    percent : bool
        It holds per cent, and the fraction is wanted.

    Examples
    --------
    >>> import numpy as np
    >>> as_typed(np.float32(0.03)), as_typed(np.float32(0.03), percent=True)
    (0.03, 0.0003)
    """
    meant = Decimal(str(np.float32(value)))  # the shortest decimal that it stands for
    return float(meant / 100 if percent else meant)


def with_labels(text: str, parameters: Sequence[Parameter]) -> str:
    """Return a message in the words that people see in a host: labels and their values.

    Messages name options as Python has them, ``denoise = off``.

    Parameters
    ----------
    text : str
    parameters : sequence of Parameter
        Of the operation.

    Examples
    --------
    >>> import medialis
    >>> options = medialis.operation("surface_skeleton").parameters
    >>> with_labels("A smoothed copy was used (denoise = off turns this off).", options)
    'A smoothed copy was used (Noise: Off turns this off).'
    >>> with_labels("Use refine = 0.01.", options)
    'Use Refine edges above: 1 %.'
    """
    by_name = {p.name: p for p in parameters}
    names = "|".join(map(re.escape, by_name))
    given = re.compile(rf"\b({names})\s*=\s*([\w%-]+(?:\.\d+)?)")
    return given.sub(lambda found: _labelled(by_name[found[1]], found[2]), text) if names else text


def _labelled(parameter: Parameter, value: str) -> str:
    words = title(value).capitalize()
    if parameter.kind is Kind.BOOL:
        words = {"True": "On", "False": "Off"}.get(value, words)
    elif parameter.kind is Kind.LENGTH and re.fullmatch(r"[\d.]+", value):
        words = f"{100 * float(value):g} %"
    return f"{parameter.label}: {words}"
