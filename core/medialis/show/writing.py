"""What a folder holds already: no result is overwritten or mixed with another one unawares.

Writing results: PLY layers, NPZ arrays, PNG pictures and a JSON manifest, all or nothing.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from medialis.base.disk import Folder, open_file
from medialis.base.errors import FileError, InvalidOptionError
from medialis.base.options import AUTO, Length, Options
from medialis.base.progress import Message, Progress, ProgressCallback
from medialis.base.validation import IntArray, as_choice
from medialis.base.version import package_version
from medialis.formats.files import Drawn, absolute, write_text
from medialis.formats.gltf import write_gltf
from medialis.formats.json_npz import write_json, write_npz
from medialis.formats.output_folder import MANIFEST, OutputFolder, remove_left
from medialis.formats.ply_attributes import write_layer_ply
from medialis.formats.shells import CALCULIX, write_inp, write_msh
from medialis.formats.text_meshes import write_obj
from medialis.formats.vtk import write_vtp, write_vtu
from medialis.operations import registry
from medialis.operations.declaration import Format
from medialis.operations.result import Layer, Result
from medialis.shape.surface import Surface
from medialis.show.picture import draw_panels, draw_result, draw_turntable, require_attribute
from medialis.show.png import reduced, write_png
from medialis.show.raster import Style
from medialis.show.result import LISTS, LOOKS, OF_LAYERS

DIFFERENCES = {
    "operation": "of the operation {}",
    "input_stamp": "of another input or an older state of it",
    "shape": "of another shape",
    "input_unit": "in another unit",
    "input_up": "with another axis up",
    "medialis": "of medialis {}",
}
"""What tells results apart, and what is said of the one that is there."""

OF_SYSTEMS = ("desktop.ini", "thumbs.db", "icon\r")
"""Files that Windows and macOS put into folders by themselves, besides hidden ones."""


def input_stamp(file: str | os.PathLike[str]) -> list[str | int]:
    """Path, size and time of change of a file: another input under a name is another input.

    Raises
    ------
    OSError
        When there is no such file.
    """
    found = Path(file).stat()
    return [str(absolute(file)), found.st_size, found.st_mtime_ns]


def as_given(options: Options) -> dict[str, Any]:
    """Return all options by name, lengths with a unit as text."""
    return {n: str(v) if isinstance(v, Length) else v for n, v in options.values().items()}


def parameters_given(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a result as given: lengths with a unit as text, or "auto"."""
    automatic = dict.fromkeys(manifest.get("automatic", ()), AUTO)
    return {**manifest["parameters"], **manifest.get("lengths", {}), **automatic}


def manifest_in(folder: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Return the manifest in a folder; empty where it is damaged, None where there is none."""
    try:
        with Folder.at(folder) as there:
            return manifest_of(there)
    except OSError:
        return None


def manifest_of(folder: Folder) -> dict[str, Any] | None:
    """Return the manifest in an open folder; empty where it is damaged or no regular file."""
    if folder.about(MANIFEST) is None:
        return None
    try:
        found = json.loads(folder.read(MANIFEST))
        return found if isinstance(found, dict) else {}
    except (OSError, ValueError, RecursionError):
        return {}


def check_same(
    folder: str | os.PathLike[str], about: Mapping[str, Any], earlier: bytes | None = None
) -> bytes:
    """Refuse a folder with a result that is not the one that is about to be written there.

    So is one without a result that has files of somebody else. What a killed run was moving there
    is put back before. The same operation on the same input with other options may be replaced,
    if its files are as it wrote them.

    Parameters
    ----------
    folder : path
    about : dict
        Entries of the new manifest, "parameters" as they were given.
    earlier : bytes, optional
        The manifest that may be replaced: that which was there when the run began; any when
        missing.

    Returns
    -------
    bytes
        The manifest that may be replaced; none is empty.

    Raises
    ------
    FileError
    """
    remove_left(folder)
    with ExitStack() as stack:
        try:
            there = stack.enter_context(Folder.at(folder))
        except OSError:  # not there, or writing tells what is wrong
            return b""
        if there.about(MANIFEST) is None:
            check_open(there, folder, about)
            return b""
        if earlier is None:
            earlier = _manifest_bytes(there)
        check_open(there, folder, about, earlier=earlier)
        return earlier


def check_open(
    there: Folder,
    folder: str | os.PathLike[str],
    about: Mapping[str, Any],
    names: Iterable[str] = (),
    *,
    earlier: bytes = b"",
) -> None:
    """Refuse an open folder as `check_same` does, or for files of these names of no result.

    Raises
    ------
    FileError
    """
    before = manifest_of(there)
    if before is None:
        if found := strangers(there, [str((about.get("input_stamp") or [""])[0])]):
            raise FileError(
                f"Nothing was written to {os.fspath(folder)}: it holds a file {found[0]} and no "
                "result. Name another folder, or write beside it: --overwrite (overwrite=True)."
            )
    elif told := _told_apart(before, about):
        raise _refused(folder, f"it holds a result {', '.join(told)}")
    elif changed := changed_parameters(before, about):
        if _manifest_bytes(there) != earlier:
            raise _refused(folder, f"it holds a result with another {', '.join(changed)}")
        if edited := _edited(there, before):
            raise _refused(folder, f"its file {edited} has changed since it was written")
    own = set(files_of(before))
    taken = [n for n in names if n not in own and n != MANIFEST and there.about(n) is not None]
    if taken:
        raise _refused(folder, f"there is a file {taken[0]} already, which is of no result")


def _told_apart(there: Mapping[str, Any], about: Mapping[str, Any]) -> list[str]:
    """Return what tells a result from another one, in words."""
    return [
        text.format(there.get(name, "unknown"))
        for name, text in DIFFERENCES.items()
        if name in about and there.get(name) != about[name]
    ]


def changed_parameters(there: Mapping[str, Any], about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that another result of an operation has otherwise, as they were."""
    before, now = parameters_given(there), dict(about["parameters"])
    names = [name for name in {**before, **now} if before.get(name) != now.get(name)]
    return {name: before.get(name) for name in names}


def _manifest_bytes(there: Folder) -> bytes:
    try:
        return bytes(there.read(MANIFEST))
    except OSError:
        return b""


def _edited(there: Folder, manifest: Mapping[str, Any]) -> str:
    """Return a file of a result that is not as it was written; "" where all are.

    One that is missing is no loss; a list of them that is damaged tells nothing.
    """
    contents = manifest.get("contents")
    for name, told in contents.items() if isinstance(contents, dict) else [(MANIFEST, None)]:
        try:
            if there.about(name) is None:
                continue
            with there.open(name) as stream:
                same = content(stream, Progress()) == told
        except (OSError, ValueError):
            same = False
        if not same:
            return str(name)
    return ""


def strangers(there: Folder, inputs: Sequence[str | os.PathLike[str]]) -> list[str]:
    """Return the files in a folder that are no inputs, nor of those that systems put there."""
    try:
        names = there.names()
    except OSError:  # not to be listed
        return []
    own = {absolute(file).name for file in inputs if absolute(file).parent == there.path}
    shown = [name for name in names if not name.startswith(".") and name.lower() not in OF_SYSTEMS]
    return [name for name in shown if name not in own and not there.is_folder(name)]


def files_of(manifest: Mapping[str, Any] | None) -> list[str]:
    """Return the names of the files of a result, its manifest included."""
    try:
        return [Path(name).name for name in (manifest or {}).get("files", [])]
    except TypeError:  # damaged
        return []


def _refused(folder: str | os.PathLike[str], why: str) -> FileError:
    return FileError(
        f"Nothing was written to {os.fspath(folder)}: {why}. Name another folder, or say that it "
        "may be replaced: --overwrite (in Python overwrite=True)."
    )


WIDTH, HEIGHT = 2000, 1500
"""Pixels of the main picture before what is empty is cut off."""

LAYER_FORMATS: dict[str, tuple[str, Callable[..., None]]] = {
    "vtp": (".vtp", write_vtp),
    "vtu": (".vtu", write_vtu),
    "msh": (".msh", write_msh),
    "inp": (".inp", write_inp),
    "ccx": (CALCULIX, write_inp),
}
"""Endings and writers of what each layer may be written as besides PLY."""

WITH_UNIT = ("inp", "ccx")
"""Those whose files say the unit of lengths."""

SHELLS = ("msh", "inp", "ccx")
"""Those for layers with triangles, as shell elements: for Gmsh, Abaqus and CalculiX."""


def _write_obj(path: Path, layer: Layer, unit: str | None) -> None:
    write_obj(path, Drawn(layer.points, _triangles(layer)), unit=unit)


def _write_glb(path: Path, layer: Layer, unit: str | None) -> None:
    write_gltf(path, Surface.of_checked(layer.points, _triangles(layer)), path.stem, unit=unit)


def _triangles(layer: Layer) -> IntArray:
    if layer.faces is None or not len(layer.faces):
        raise InvalidOptionError("There are no triangles to write.")
    return layer.faces


TRIANGLE_FORMATS = (Format("obj", _write_obj), Format("glb", _write_glb))
"""For layers that name them in `Layer.formats`; those of features stand with their operations."""


THUMBNAIL, THUMBNAIL_WIDTH = "thumbnail.png", 250


ATTRIBUTES = ("attributes", "face_attributes")


def describe_result(result: Result, **more: Any) -> dict[str, Any]:
    """Return the manifest: operation, parameters, seconds per stage, values, messages."""
    # Others tell a shape as computed on by its checksum.
    known = result.shape.identity
    notes = [m.data for m in result.messages if isinstance(m, Message) and m.code == "length"]
    return {
        "medialis": package_version(),
        "operation": result.operation,
        **{name: dict(getattr(result, name)) for name in ("parameters", "seconds", "values")},
        "lengths": {str(data["option"]): str(data["given"]) for data in notes},
        "automatic": list(result.automatic),
        "unit": result.shape.unit,
        "up": result.shape.up,
        "shape": known.hex() if isinstance(known, bytes) else "",
        "messages": [str(message) for message in result.messages],
        "notes": [_note(message) for message in result.messages],
        "layers": [
            {
                "points": len(layer.points),
                "faces": 0 if layer.faces is None else len(layer.faces),
                "edges": 0 if layer.edges is None else len(layer.edges),
                **{name: getattr(layer, name) for name in OF_LAYERS},
                **{name: list(getattr(layer, name)) for name in (*LISTS, *ATTRIBUTES)},
                "filter_unit": asdict(layer.filter_unit),
                "facts": dict(layer.facts),
            }
            for layer in result.layers
        ],
        "shown": [layer.name for layer in result.shown],
        "looks": [{name: getattr(layer, name) for name in LOOKS} for layer in result.shown],
        **more,
    }


def _note(message: str) -> dict[str, Any]:
    """Return what programs read of a message: its code, counts, and whether it is a warning."""
    if not isinstance(message, Message):
        message = Message(message)
    warning = message.level >= logging.WARNING
    return {"code": message.code, "warning": warning, "data": dict(message.data)}


@dataclass(frozen=True)
class Pictures:
    """Which pictures of a result are written.

    Attributes
    ----------
    main : bool
        Draw ``<operation>.png`` (the result's own images are written in any case).
    color_by : str or None
        Attribute to colour by; the layer's own choice when None.
    turntable : int
        Number of turntable views.
    thumbnail : bool
        Write the main picture also small, as ``thumbnail.png``.
    """

    main: bool = True
    color_by: str | None = None
    turntable: int = 0
    thumbnail: bool = False


@dataclass(frozen=True)
class Written:
    """What is written of a result.

    Attributes
    ----------
    source : str or None
        Name of the input.
    pictures : Pictures
    formats : sequence of str or None
        As in `write_result`.
    texts : dict
        More files: their text by name.
    record : dict
        More entries for the manifest.
    overwrite : bool
        Replace what is there.
    below : str or None
        As in `OutputFolder`.
    earlier : bytes or None
        The manifest that was there when the run began, which may be replaced.
    """

    source: str | None = None
    pictures: Pictures = Pictures()
    formats: Sequence[str] | None = None
    texts: Mapping[str, str] = field(default_factory=dict)
    record: Mapping[str, Any] = field(default_factory=dict)
    overwrite: bool = False
    below: str | None = None
    earlier: bytes | None = None


class Manifest(dict[str, Any]):
    """What was written of a result, as a mapping; its text is short."""

    def __repr__(self) -> str:
        files = self.get("files", [])
        folder = Path(files[-1]).parent if files else "nothing"
        return f"Manifest({self.get('operation')}: {len(files)} files in {folder})"


def write_result(
    result: Result,
    folder: str | os.PathLike[str],
    *,
    source: str | None = None,
    pictures: Pictures = Pictures(),
    formats: Sequence[str] | None = None,
    overwrite: bool = False,
    progress: Progress | ProgressCallback | None = None,
) -> dict[str, Any]:
    """Write a result into a folder; when anything fails nothing is left behind.

    Parameters
    ----------
    result : Result
        From `medialis.run`.
    folder : path
        Created when missing. It may hold a result of the same operation on the same shape, which is
        replaced if its files are as they were written; "replaced" in the manifest has the options
        that were others.
    source : str, optional
        Name of the input, for titles and the manifest.
    pictures : Pictures
        Which pictures to draw.
    formats : sequence of str, optional
        Formats of the operation's own (of a graph: json, swc, graphml, obj and more), those of
        `Operation.default_formats` when missing; and of its layers: vtp and vtu, each with its
        attributes for ParaView; msh (Gmsh), inp (Abaqus) and ccx (CalculiX), those with triangles
        as shell elements.
    overwrite : bool
        Replace another result, with all its files, and other files of the same names.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    dict
        The manifest; its text is one line. With "files": the paths written, "contents": bytes and
        sha256 of each file by its name, and "picture": the main one or None.

    Raises
    ------
    InvalidOptionError
        When the first layer has no attribute ``pictures.color_by``, or a format is unknown, or
        is one of shell elements and no layer has triangles.
    FileError
        When the folder cannot be written, or holds something else and `overwrite` is False.

    See Also
    --------
    run : makes results.
    draw_result : the picture alone.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     manifest = medialis.write_result(result, f"{folder}/out")
    >>> manifest["operation"], manifest["picture"].endswith("thickness.png")
    ('thickness', True)
    """
    wanted = Written(source, pictures, formats, overwrite=overwrite)
    return write_files(result, folder, wanted, Progress.of(progress))


def write_files(
    result: Result, folder: str | os.PathLike[str], wanted: Written, progress: Progress
) -> Manifest:
    """Write what is wanted of a result; see `write_result`."""
    pictures = wanted.pictures
    if pictures.color_by is not None:
        require_attribute(result.layers, pictures.color_by)
    formats = chosen_formats(result.operation, wanted.formats)
    for ending in formats:
        if ending in SHELLS and all(layer.faces is None for layer in result.layers):
            raise InvalidOptionError(
                f"The result of {result.operation} has no triangles that could be shell elements "
                f"({ending}); vtu holds all it has."
            )
    about = describe_result(result, input=wanted.source, **wanted.record)
    given = {**about, "parameters": parameters_given(about)}
    earlier, before = wanted.earlier, dict[str, Any]()
    if not wanted.overwrite:
        now = check_same(folder, given, earlier)
        earlier = now if earlier is None else earlier
        before = changed_parameters(json.loads(now), given) if now else {}
    drawn: list[str] = []
    names: list[str] = []

    def replaced(there: Folder) -> list[str]:
        """Look once more: another run may have written meanwhile; none does now."""
        if not wanted.overwrite:
            check_open(there, folder, given, names, earlier=earlier or b"")
        return files_of(manifest_of(there))

    with OutputFolder(folder, replaced=replaced, below=wanted.below) as out:

        def new(name: str) -> Path:
            names.append(name)
            return out.file(name)

        _write_data(new, result, formats, progress)

        with progress.stage("picture", 0.5, 0.95):
            title = result.operation.replace("_", " ")
            title += f" of {Path(wanted.source).name}" if wanted.source else ""
            for name, image in _main_pictures(result, pictures, title, progress.unnamed):
                drawn.append(name)
                write_png(new(name), image)
                if pictures.thumbnail and drawn == [name]:
                    write_png(new(THUMBNAIL), reduced(image, THUMBNAIL_WIDTH))
            count, color_by = pictures.turntable, pictures.color_by
            views = draw_turntable(result, count, color_by=color_by, progress=progress.unnamed)
            for number, image in enumerate(views if count else ()):
                write_png(new(f"turntable_{number:03d}.png"), image)
        for name, text in wanted.texts.items():
            write_text(new(name), text)
        with progress.stage("check", 0.95, 1.0):
            contents = {}
            for name in names:
                with open_file(out.file(name)) as stream:
                    contents[name] = content(stream, progress)
        names.append(MANIFEST)
        base = Path(folder)
        manifest = about | {
            "files": [str(base / name) for name in names],
            "contents": contents,
            "picture": str(base / drawn[0]) if drawn else None,
            "replaced": before,
        }
        write_json(out.file(MANIFEST), manifest)
    return Manifest(manifest)


def chosen_formats(name: str, wanted: Sequence[str] | None) -> Sequence[str]:
    """Return what is wanted of an operation; a format that only others have writes nothing.

    Raises
    ------
    InvalidOptionError
        For a format that none has.
    """
    chosen = registry.operation(name) if name else None
    if wanted is None:
        return chosen.default_formats if chosen else ()
    known = [*(chosen.offered if chosen else ()), *LAYER_FORMATS]
    for ending in wanted:
        if ending not in known and all(ending not in one.offered for one in registry.OPERATIONS):
            as_choice(ending, "formats", known)
    return wanted


def write_layer(path: Path, layer: Layer, unit: str | None) -> None:
    """Write a layer in the format that a file name ends in, of a feature or of triangles.

    Raises
    ------
    InvalidOptionError
        For another ending, and where the layer has not what the format is for.
    FileError
        When the file cannot be written.
    """
    every = (*TRIANGLE_FORMATS, *(one for other in registry.OPERATIONS for one in other.formats))
    formats = {one.name: one for one in every if not one.of}
    ending = path.suffix.lower().removeprefix(".")
    if ending not in formats:
        raise InvalidOptionError(f"Files end in {', '.join(formats)}, got {path.name!r}.")
    formats[ending].write(path, layer, unit)


def _write_data(
    new: Callable[[str], Path], result: Result, formats: Sequence[str], progress: Progress
) -> None:
    """Write layers, graph and arrays; `new` tells where."""
    with progress.stage("write", 0.0, 0.5):
        for number, layer in enumerate(result.layers):
            write_layer_ply(new(f"{layer.name}.ply"), layer)
            for name in filter(LAYER_FORMATS.__contains__, formats):
                if name not in SHELLS or layer.faces is not None:
                    ending, write = LAYER_FORMATS[name]
                    own = {"unit": result.shape.unit} if name in WITH_UNIT else {}
                    write(new(layer.name + ending), layer, **own)
            for ending in layer.formats:
                file = new(f"{layer.name}.{ending}")
                write_layer(file, layer, result.shape.unit)
            progress.update((number + 1) / (len(result.layers) + 1))
        # A result made by hand is of no operation.
        for one in registry.operation(result.operation).formats if result.operation else ():
            if one.of in result.extras and (one.unasked or one.name in formats):
                more = (new,) if one.beside else ()
                one.write(new(f"{result.operation}.{one.name}"), result, *more)
        write_npz(new(f"{result.operation}.npz"), result.arrays)


def content(stream: BinaryIO, progress: Progress) -> dict[str, Any]:
    """Return the size and the checksum of an open file, by which a manifest knows its own.

    Raises
    ------
    OSError
        When it cannot be read.
    """
    checksum, size = hashlib.sha256(), 0
    while part := stream.read(1 << 24):
        checksum.update(part)
        size += len(part)
        progress.update(0.0)
    return {"bytes": size, "sha256": checksum.hexdigest()}


def _main_pictures(
    result: Result, pictures: Pictures, title: str, progress: Progress
) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Give file names and images: the result's own ones, or one of its first layer if wanted."""
    for name, image in result.images.items():
        yield f"{name}.png", image
    if pictures.main and result.layers and not result.images:
        image = draw_result(
            result,
            color_by=pictures.color_by,
            width=WIDTH,
            height=HEIGHT,
            title=title,
            style=Style(background=None, crop=True),
            progress=progress,
        )
        yield f"{result.operation}.png", image
    for name in result.panels if pictures.main else ():
        yield f"{name}.png", draw_panels(result, name, progress=progress)
