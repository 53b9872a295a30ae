"""Compile the GPU kernels to PTX: `medialis/base/gpu_kernels.xz`, the same file for all systems.

    python core/kernel_library/build_gpu.py [FILE]   # compiles if a source has changed

Needs numba and the packages in `gpu_compiler.txt`, installed or in `build/gpu-compiler`. Needs no
GPU and no driver. The file is compressed JSON: for each kernel the hash of its sources, the
argument types, the entry name and the PTX for sm_75. Drivers since 525 compile this PTX for newer
GPUs. Multiplications and additions are not fused, so that results have the bits of the processor.

`gpu_kernels.txt` lists the kernels: name, local arrays of a thread, and argument types. A kernel
computes one item; this script generates the function that calls it once per thread.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib
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
    """A line of the list: kernel, local arrays (shape and dtype), words of the argument types."""

    name: str
    rooms: tuple[tuple[tuple[int, ...], str], ...]
    words: list[Any]


def listed() -> list[Listed]:
    """Return the kernels of the list."""
    found = []
    for line in LIST.read_text(encoding="ascii").splitlines():
        name, rooms, words = line.split("|")
        sizes = [room.partition(":") for room in rooms.split()]
        shapes = tuple((_lengths(name, text), dtype) for dtype, _, text in sizes)
        found.append(Listed(name, shapes, json.loads(words)))
    return found


def _lengths(kernel: str, text: str) -> tuple[int, ...]:
    """Return the shape of a local array: numbers, or constants in the module of the kernel."""
    module = importlib.import_module(f"medialis.{kernel.partition(':')[0]}")
    return tuple(int(part) if part.isdigit() else getattr(module, part) for part in text.split("x"))


def how() -> str:
    """Return the hash of this script."""
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]


def stamps() -> dict[str, str]:
    """Return the hash of the sources of each kernel."""
    return {one.name: stamp_of(one.name.partition(".")[0]) for one in listed()}


def is_made(target: Path) -> bool:
    """Return whether the file exists and was compiled from the current sources."""
    try:
        known = json.loads(lzma.decompress(target.read_bytes()))
    except (OSError, ValueError, lzma.LZMAError):
        return False
    made = {name: (about["stamp"], about["types"], about["how"]) for name, about in known.items()}
    stamp = stamps()
    return made == {one.name: (stamp[one.name], code_of(one.words), how()) for one in listed()}


def toolkit() -> Path | None:
    """Return the folder of NVVM; None if NVVM or the CUDA target of numba is missing."""
    if COMPILER.is_dir():
        site.addsitedir(str(COMPILER))  # redirects `numba.cuda` to numba-cuda
    try:
        found = importlib.util.find_spec("nvidia.cuda_nvcc")
    except ModuleNotFoundError:
        found = None
    if importlib.util.find_spec("numba_cuda") is None or found is None:
        return None
    return Path(next(iter(found.submodule_search_locations or ())))


def prepare(folder: Path) -> None:
    """Make numba compile with the NVVM in a folder, without a GPU."""
    import numba.cuda.cudadrv.nvrtc as nvrtc
    import numba.cuda.cudadrv.nvvm as nvvm
    import numba.cuda.dispatcher as dispatcher

    library = next((folder / "nvvm").rglob("libnvvm.so*"), None)
    library = library or next((folder / "nvvm").rglob("nvvm64*.dll"))
    ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)  # numba-cuda uses a loaded library
    (code,) = (folder / "nvvm" / "libdevice").glob("libdevice*.bc")
    nvvm.get_libdevice, nvvm.open_libdevice = (lambda: str(code)), code.read_bytes
    compile_ir = nvvm.compile_ir
    nvvm.compile_ir = lambda ir, **options: compile_ir(ir, **{**options, "fma": 0})
    nvrtc.get_arch_option = lambda major, minor: f"compute_{major}{minor}"
    device = python_types.SimpleNamespace(compute_capability=CAPABILITY)
    dispatcher.get_current_device = lambda: device


@cache
def on_device(kernel: Any) -> Any:
    """Return a device function with the code of a kernel; called kernels are converted too."""
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
    """Return the function that each thread of a launch runs: it calls `body` for one item."""
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
    """Return the name of a dtype in numpy.

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
    """Return PTX without comments, empty lines and variables for Python."""
    lines = [line.split("//")[0].strip() for line in ptx.splitlines()]
    return "\n".join(line for line in lines if line and "NumbaEnv" not in line) + "\n"


def build(target: Path = TARGET, say: Any = print) -> bool:
    """Compile the kernels unless the file is current; return False without a compiler."""
    if is_made(target):
        return True
    folder = toolkit()
    if folder is None:
        say("GPU kernels are not made: the packages in gpu_compiler.txt are not installed.")
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
    fresh = target.with_suffix(".new")
    fresh.write_bytes(packed)
    fresh.replace(target)
    say(f"{len(made)} GPU kernels, {len(packed) / 1e3:.0f} kB; {target}")
    return True


if __name__ == "__main__":
    build(*map(Path, sys.argv[1:2]))
