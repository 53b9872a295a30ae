"""Kernel of where balls touch the surface (see hidden_walls.py)."""

from __future__ import annotations

from medialis._kernels.jit import kernel


@kernel
def touch_from_outside(
    rows, centers, features, contact_faces, contact_weights, points, normals, faces, face_normals,
    out,
):  # fmt: skip
    """Mark the balls whose center lies in front of the surface at their second contact."""
    for row in rows:
        face, outward = contact_faces[row], 0.0
        for axis in range(3):
            if face >= 0:
                place = 0.0
                for j in range(3):
                    place += contact_weights[row, j] * points[faces[face, j], axis]
                normal = face_normals[face, axis]
            else:
                sample = features[row, 1]
                place, normal = points[sample, axis], normals[sample, axis]
            outward += (place - centers[row, axis]) * normal
        out[row] = outward < 0.0
