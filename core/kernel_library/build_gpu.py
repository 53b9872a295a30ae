"""Compile the kernels for GPUs to PTX: one file, `medialis/base/gpu_kernels.xz`, for all systems.

    python core/kernel_library/build_gpu.py          # when a source has changed; `make kernels`

It needs numba and what `gpu_compiler.txt` names, in `build/gpu-compiler` or installed; no GPU and
no driver. The file holds JSON: for each kernel the hash of its sources, the types it takes, the
name of its entry and its PTX for sm_75, which every driver since 525 compiles for the GPU that it
drives. Products and sums are not contracted, so that results are those of the processor.

`gpu_kernels.txt` lists the kernels: name, arrays that each thread has for itself, and types. The
kernel is the body of one item; what calls it, once a thread, is written here.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import json
import lzma
import re
import site
import sys
import types as python_types
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from medialis.base.jit import code_of, stamp_of  # noqa: E402

LIST = HERE / "gpu_kernels.txt"
TARGET = HERE.parent / "medialis" / "base" / "gpu_kernels.xz"
COMPILER = HERE.parent.parent / "build" / "gpu-compiler"
CAPABILITY = 7, 5


class Listed(NamedTuple):
    """A line of the list: the kernel, arrays of a thread (shape and dtype), words of the types."""

    name: str
    rooms: tuple[tuple[tuple[int, ...], str], ...]
    words: list[Any]


def listed() -> list[Listed]:
    """Return the kernels of the list."""
    found = []
    for line in LIST.read_text(encoding="ascii").splitlines():
        name, rooms, words = line.split("|")
        sizes = [room.partition(":") for room in rooms.split()]
        shapes = tuple((tuple(map(int, s.split("x"))), dtype) for dtype, _, s in sizes)
        found.append(Listed(name, shapes, json.loads(words)))
    return found


def how() -> str:
    """Return a hash of what kernels are made by."""
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]


def stamps() -> dict[str, str]:
    """Return the hash of the sources of each kernel."""
    return {one.name: stamp_of(one.name.partition(".")[0]) for one in listed()}


def is_made() -> bool:
    """Tell whether the file is there and made from these sources."""
    try:
        known = json.loads(lzma.decompress(TARGET.read_bytes()))
    except (OSError, ValueError, lzma.LZMAError):
        return False
    made = {name: (about["stamp"], about["types"], about["how"]) for name, about in known.items()}
    stamp = stamps()
    return made == {one.name: (stamp[one.name], code_of(one.words), how()) for one in listed()}


def toolkit() -> Path | None:
    """Return the folder of NVVM; None where it or numba's target for GPUs is not there."""
    if COMPILER.is_dir():
        site.addsitedir(str(COMPILER))  # it sends `numba.cuda` to the target
    try:
        found = importlib.util.find_spec("nvidia.cuda_nvcc")
    except ModuleNotFoundError:
        found = None
    if importlib.util.find_spec("numba_cuda") is None or found is None:
        return None
    return Path(next(iter(found.submodule_search_locations or ())))


def prepare(folder: Path) -> None:
    """Let numba compile by the NVVM of a folder, for a GPU that is not there."""
    import numba.cuda.cudadrv.nvrtc as nvrtc
    import numba.cuda.cudadrv.nvvm as nvvm
    import numba.cuda.dispatcher as dispatcher

    library = next((folder / "nvvm").rglob("libnvvm.so*"), None)
    library = library or next((folder / "nvvm").rglob("nvvm64*.dll"))
    ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)  # what is loaded is used
    (code,) = (folder / "nvvm" / "libdevice").glob("libdevice*.bc")
    nvvm.get_libdevice, nvvm.open_libdevice = (lambda: str(code)), code.read_bytes
    compile_ir = nvvm.compile_ir
    nvvm.compile_ir = lambda ir, **options: compile_ir(ir, **{**options, "fma": 0})
    nvrtc.get_arch_option = lambda major, minor: f"compute_{major}{minor}"
    device = python_types.SimpleNamespace(compute_capability=CAPABILITY)
    dispatcher.get_current_device = lambda: device


@cache
def on_device(kernel: Any) -> Any:
    """Return a function of the GPU from a kernel: the same code, and so are all that it calls."""
    from numba import cuda

    function = kernel.py_func
    scope = dict(function.__globals__)
    for name in function.__code__.co_names:
        if hasattr(scope.get(name), "py_func") and hasattr(scope[name], "is_made"):
            scope[name] = on_device(scope[name])
    copy = python_types.FunctionType(
        function.__code__, scope, function.__name__, function.__defaults__, function.__closure__
    )
    copy.__module__ = function.__module__
    return cuda.jit(device=True)(copy)


def launched(one: Listed, body: Any) -> Any:
    """Return the function that a launch calls in every thread: one item each."""
    from numba import cuda

    given = [f"a{k}" for k in range(len(one.words))]
    rooms = [f"room{k}" for k in range(len(one.rooms))]
    lines = [
        f"def launched(first, last, {', '.join(given)}):",
        "    item = first + cuda.grid(1)",
        "    if item < last:",
        *(
            f"        {room} = cuda.local.array({shape}, numpy.{numpy_name(dtype)})"
            for room, (shape, dtype) in zip(rooms, one.rooms, strict=True)
        ),
        f"        body({', '.join(['item', *given, *rooms])})",
    ]
    import numpy

    scope: dict[str, Any] = {"cuda": cuda, "numpy": numpy, "body": body}
    exec("\n".join(lines), scope)  # numba's GPU target takes no `*arguments`
    return scope["launched"]


def numpy_name(dtype: str) -> str:
    """Return the name that numpy has for a dtype.

    Examples
    --------
    >>> numpy_name("i4")
    'int32'
    """
    import numpy

    return numpy.dtype(dtype).name


def signature(one: Listed) -> Any:
    """Return the types of a launched function."""
    from numba import typeof, types

    from medialis.hosts.compile_ahead import example

    return types.void(types.int64, types.int64, *(typeof(example(word)) for word in one.words))


def compiled(one: Listed) -> tuple[str, str]:
    """Return the entry of a kernel and its PTX."""
    from numba import cuda

    from medialis.hosts.compile_ahead import named

    body = launched(one, on_device(named(one.name)))
    ptx, _ = cuda.compile_ptx(body, signature(one), cc=CAPABILITY)
    (entry,) = re.findall(r"\.visible \.entry (\w+)\(", ptx)
    short = "".join(ch if ch.isalnum() else "_" for ch in one.name)
    return short, shorter(ptx).replace(entry, short)


def shorter(ptx: str) -> str:
    """Return PTX without comments, empty lines and what only Python asks for."""
    lines = [line.split("//")[0].strip() for line in ptx.splitlines()]
    return "\n".join(line for line in lines if line and "NumbaEnv" not in line) + "\n"


def build(say: Any = print) -> bool:
    """Make the file where it is not up to date; return whether it is there then."""
    if is_made():
        return True
    folder = toolkit()
    if folder is None:
        say("Kernels for GPUs are not made: what gpu_compiler.txt names is not here.")
        return False
    import warnings

    from numba.core.errors import NumbaWarning

    from medialis.base.compiling import know
    from medialis.base.jit import kernel_class

    warnings.simplefilter("ignore", NumbaWarning)
    know(kernel_class())
    prepare(folder)
    made, stamp = {}, stamps()
    for one in listed():
        entry, ptx = compiled(one)
        about = {"stamp": stamp[one.name], "types": code_of(one.words), "how": how()}
        made[one.name] = {**about, "entry": entry, "ptx": ptx}
    text = json.dumps(made, sort_keys=True).encode("ascii")
    packed = lzma.compress(text, preset=9 | lzma.PRESET_EXTREME)
    fresh = TARGET.with_suffix(".new")
    fresh.write_bytes(packed)
    fresh.replace(TARGET)
    say(f"{len(made)} kernels for GPUs, {len(packed) / 1e3:.0f} kB; {TARGET}")
    return True


if __name__ == "__main__":
    build()
