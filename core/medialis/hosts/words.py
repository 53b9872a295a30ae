"""Names and numbers as hosts write them."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from decimal import Decimal
from typing import Any

import numpy as np


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
