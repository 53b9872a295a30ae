"""The command `medialis sample`: a shape to try things on, as a file."""

from __future__ import annotations

import argparse
from pathlib import Path

from medialis.cli.arguments import EXIT_OK, nearest
from medialis.cli.display import say
from medialis.errors import FileError, InvalidOptionError
from medialis.files.ply_attributes import write_ply
from medialis.surface.samples import SAMPLES, sample_shape


def write_sample(options: argparse.Namespace) -> int:
    """Write a sample, or list them all; return the exit code."""
    name = options.name
    if name is None:
        for known, text in SAMPLES.items():
            say(f"{known:10} {text}")
        return EXIT_OK
    if name not in SAMPLES:
        raise InvalidOptionError(
            f"There is no sample {name}{nearest(name, SAMPLES) or '.'} There are "
            f"{', '.join(SAMPLES)}."
        )
    path = Path(options.output or f"{name}.ply")
    shape = sample_shape(name)
    if path.exists():
        raise FileError(f"Nothing was written: there is a file {path} already; name another.")
    write_ply(path, shape.points, faces=shape.faces)
    faces = f", {shape.face_count:,} triangles" if shape.face_count else ""
    say(f"{path}: {SAMPLES[name]} ({shape.point_count:,} points{faces})")
    return EXIT_OK
