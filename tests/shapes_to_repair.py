"""Input that repair changes."""

import numpy as np

import medialis


def damaged() -> tuple[np.ndarray, np.ndarray]:
    """A shape with an unused vertex in row 5, a twin of the first at the end and a double face."""
    shape = medialis.organic_shape(56)
    points = np.insert(shape.points, 5, 9.0, axis=0)
    faces = shape.faces + (shape.faces >= 5)
    return np.concatenate([points, points[:1]]), np.concatenate([faces, faces[:1]])
