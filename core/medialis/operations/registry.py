"""All operations, and the one function that runs any of them."""

from __future__ import annotations

import importlib
import time
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

from medialis.base.device import Device, use_device
from medialis.base.errors import InvalidOptionError, InvalidShapeError, nearest
from medialis.base.kept import kept
from medialis.base.options import Options
from medialis.base.progress import Message, Progress, ProgressCallback
from medialis.base.threads import thread_limit
from medialis.operations.declaration import Operation
from medialis.operations.names import RENAMED, Named, named_operations, renamed_note
from medialis.operations.positions import moved, near_origin, offset_of
from medialis.operations.result import Outcome, Result
from medialis.shape.reading import ShapeLike, as_shape
from medialis.shape.shape import Shape

OPERATIONS: tuple[Operation, ...]
"""Every `Operation(...)` that a feature declares, in the order in which hosts list them."""


def __getattr__(name: str) -> Any:
    """Load all operations when they are first asked for: a command needs its own alone."""
    if name != "OPERATIONS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = tuple(_loaded(named) for named in named_operations())
    return globals()[name]


def _loaded(named: Named) -> Operation:
    declared = getattr(importlib.import_module(named.module), named.constant)
    assert isinstance(declared, Operation)
    return declared


CAD_FACE = "cad_face"
"""The attribute of faces that numbers the faces of a CAD model."""

SMALLEST_SIZE, LARGEST_SIZE = 1e-30, 1e30
"""Diagonals for which sixth powers and the float32 depths of pictures stay in range."""


def operation(name: str) -> Operation:
    """Return an operation by its name, its name with dashes, or its MeshLab-style name.

    Raises
    ------
    InvalidOptionError
        When there is none; the sentence lists them.

    See Also
    --------
    run : runs it.

    Examples
    --------
    >>> import medialis
    >>> medialis.operation("thickness").label
    'Thickness'
    """
    name = RENAMED.get(name, name)
    if "OPERATIONS" not in globals():  # one operation needs no other
        for named in named_operations():
            if name in (named.name, named.command):
                return _loaded(named)
    every: tuple[Operation, ...] = globals().get("OPERATIONS") or __getattr__("OPERATIONS")
    for candidate in every:
        if name in (candidate.name, candidate.name.replace("_", "-"), candidate.filter_name):
            return candidate
    known = [candidate.name for candidate in every]
    near = nearest(name, known)
    there = f"{near} There are" if near else "; there are"
    raise InvalidOptionError(f"There is no operation {name!r}{there} {', '.join(known)}.")


def run(
    name: str,
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    **parameters: Any,
) -> Result:
    """Run any registered operation on a shape, as every host does.

    It computes what the function of the same name does, adds layers and values, and raises when
    there is nothing to show.

    Parameters
    ----------
    name : str
        As in `operation`.
    shape : Shape, path, (vertices, faces), or mesh of another library
        Of trimesh, PyVista, Open3D, meshio or pymeshlab; all but a `Shape` is repaired first.
    threads : int, optional
        At most this many; all processors when missing.
    device : {"auto", "cpu", "gpu"}, optional
        Device for computing; see `use_device`.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.
    **parameters
        Parameters of the operation; lengths are fractions of the bounding-box diagonal, or such as
        "1mm", "0.5%" and `mm(1)`.

    Raises
    ------
    InvalidOptionError
        For an unknown operation or parameter, or a bad value.
    InvalidShapeError
        When the shape cannot be used, or its diagonal is not within 1e-30 to 1e30.
    Cancelled
        When `progress` asks for it.

    See Also
    --------
    operation : what is known of one.
    write_result, draw_result : what to do with the result.
    batch : over many files.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("surface_skeleton", medialis.organic_shape(56), subsample=0.01)
    >>> result.layers[0].name, result.values["skeleton_points"] > 100
    ('surface_skeleton', True)
    """
    chosen = operation(name)
    options = chosen.resolve(parameters)
    progress = Progress.of(progress)
    if name in RENAMED:
        progress.note(renamed_note(name), "renamed_operation")
    data = as_shape(shape, progress)
    _require_size(data)
    options = options.measured(data, progress)
    # A host makes a new shape for each run: what is kept was computed from the first of its kind.
    data = kept(run, data, None, lambda: data, progress)
    clock = time.perf_counter()
    offset = offset_of(data)
    far = bool(offset.any())
    near = kept(near_origin, data, None, lambda: near_origin(data), progress) if far else data
    asked, before = options, len(progress.messages)
    with thread_limit(threads), use_device(device):
        options = options.with_auto_resolved(near, progress)
        outcome = chosen.run(near, options, progress)
    numbers = _numbers_chosen(asked, progress.messages[before:])
    outcome = moved(outcome, offset)
    outcome = _with_patches(outcome, data)
    if "diagonal" in outcome.values:  # of the shape as given: samples may reach a little further
        outcome = replace(outcome, values={**outcome.values, "diagonal": data.diagonal})
    progress.seconds["total"] = time.perf_counter() - clock
    return Result(
        **{f.name: getattr(outcome, f.name) for f in fields(Outcome)},
        operation=chosen.name,
        parameters=asked.values() | numbers,
        automatic=tuple(numbers),
        seconds=dict(progress.seconds),
        messages=tuple(progress.messages),
    )


def _numbers_chosen(options: Options, messages: Sequence[Message]) -> dict[str, float]:
    """Return the number that was chosen first for each automatic option."""
    told = [m.data["values"] for m in reversed(messages) if m.code == "automatic"]
    numbers = {name: value for chosen in told for name, value in chosen.items()}
    return {name: numbers[name] for name in options.auto_starts() if name in numbers}


def _with_patches(outcome: Outcome, shape: Shape) -> Outcome:
    """Tell the patches of the shape on the layers that have its faces."""
    patches = shape.patches
    if patches is None:
        return outcome
    layers = tuple(
        replace(layer, face_attributes={**layer.face_attributes, CAD_FACE: patches})
        if layer.on_input and layer.faces is not None and len(layer.faces) == len(patches)
        else layer
        for layer in outcome.layers
    )
    new = dict(zip(map(id, outcome.layers), layers, strict=True))
    return replace(outcome, layers=layers, shown=tuple(new.get(id(x), x) for x in outcome.shown))


def _require_size(shape: Shape) -> None:
    """Refuse sizes for which areas and pictures would overflow or vanish; 0 has its own sentences.

    Raises
    ------
    InvalidShapeError
    """
    if shape.diagonal > 0 and not SMALLEST_SIZE <= shape.diagonal <= LARGEST_SIZE:
        raise InvalidShapeError(
            f"The bounding-box diagonal must be within {SMALLEST_SIZE:g} to {LARGEST_SIZE:g}, got "
            f"{shape.diagonal:g}: scale the shape to another unit."
        )
