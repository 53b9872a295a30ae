"""Shapes to try things on, each by one name: made, not shipped."""

from __future__ import annotations

import numpy as np

from medialis.errors import InvalidOptionError
from medialis.model.shape import Shape
from medialis.surface.generate import organic_shape
from medialis.surface.generate_arch import dental_arch
from medialis.surface.reading import make_shape

SAMPLES = {
    "creature": "a creature with four legs, ears and a tail, closed: for everything",
    "teeth": "a dental arch with 14 teeth, open below: for bump segments",
    "scan": "points of the creature as a scanner sees them, with noise and outliers: for clouds",
}
"""What each is, by its name."""

NOISE, OUTLIERS = 0.002, 0.05
"""Of the scan: deviation as a part of the diagonal, and share of outliers."""


def sample_shape(name: str) -> Shape:
    """Make one of the shapes that examples and tutorials use.

    Parameters
    ----------
    name : str
        "creature", "teeth" or "scan".

    Returns
    -------
    Shape

    Raises
    ------
    InvalidOptionError
        When there is none of this name; the sentence lists them.

    See Also
    --------
    organic_shape, dental_arch : the same with options.
    read_shape : from a file.

    Examples
    --------
    >>> import medialis
    >>> medialis.sample_shape("scan").faces is None
    True
    """
    if name == "creature":
        return organic_shape()
    if name == "teeth":
        return dental_arch()[0]
    if name == "scan":
        return _scan(organic_shape())
    raise InvalidOptionError(f"There is no sample {name!r}; there are {', '.join(SAMPLES)}.")


def _scan(shape: Shape) -> Shape:
    """Return noisy points of a surface, and some anywhere around it."""
    rng = np.random.default_rng(0)
    low, high = shape.bounds
    points = shape.points + rng.normal(scale=NOISE * shape.diagonal, size=shape.points.shape)
    astray = rng.uniform(low, high, (int(OUTLIERS * len(points)), 3))
    return make_shape(np.concatenate([points, astray]))
