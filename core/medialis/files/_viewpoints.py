"""Where the points of a scan were seen from, as files say it."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from medialis.progress import Message, counted

_SAID = re.compile(r"(?i)^\W*(?:viewpoint|(?:scanner|sensor)[ _](?:position|origin))\b[\s:=]*(.*)$")


def said_viewpoints(comments: Iterable[str]) -> NDArray[np.float64]:
    """Return the positions in comments such as `VIEWPOINT x y z`, (v, 3).

    What follows x y z, a direction in files of the Point Cloud Library, is passed over.

    Examples
    --------
    >>> said_viewpoints(["VIEWPOINT 0 1.5 2 1 0 0 0", "scanner position: 4 5 6", "viewpoint lost"])
    array([[0. , 1.5, 2. ],
           [4. , 5. , 6. ]])
    """
    places = []
    for comment in comments:
        if said := _SAID.match(comment):
            try:
                place = [float(word) for word in re.split(r"[\s,;]+", said[1].strip())[:3]]
            except ValueError:
                continue
            if len(place) == 3 and np.isfinite(place).all():
                places.append(place)
    return np.array(places).reshape(-1, 3)


def for_each_point(
    points: NDArray[np.float64], places: NDArray[np.float64]
) -> tuple[NDArray[np.float64] | None, tuple[Message, ...]]:
    """Return the viewpoint of each point, the nearest of several, and what to tell."""
    if len(places) == 0:
        return None, ()
    nearest, least = np.zeros(len(points), np.intp), np.full(len(points), np.inf)
    for i, place in enumerate(places):
        with np.errstate(all="ignore"):  # points may be NaN or huge
            distance = np.abs(points - place).max(axis=1)
        closer = distance < least
        nearest[closer], least[closer] = i, distance[closer]
    text = f"The file names {counted(len(places), 'viewpoint')}."
    if len(places) > 1:
        text += " Each point is taken as seen from the nearest one."
    return places[nearest], (Message(text, "viewpoints", viewpoints=len(places)),)
