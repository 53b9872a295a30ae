"""Kernels on an NVIDIA GPU, through the CUDA driver library alone (ctypes).

`core/kernel_library/build_gpu.py` compiles kernels to PTX (`gpu_kernels.xz`, part of wheels), and
the driver compiles the PTX for its GPU. A kernel computes one item: the loops of the processor call
the same function. Kernels that were compiled from other sources are not used.

Algorithms call `device.on_gpu`, which gives them a `Session`. A session owns its GPU memory. Only
this module calls the driver.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import lzma
import math
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from medialis.base.cache_folder import PACKAGE
from medialis.base.errors import GpuError
from medialis.base.jit import stamp_of
from medialis.base.progress import Progress

KERNELS = PACKAGE / "base" / "gpu_kernels.xz"
"""PTX of all kernels; `build_gpu.py` documents the format."""
NOT_MADE = "this installation has no kernels for GPUs (in a clone `make kernels` makes them)."
BLOCK_SIZE = 128
"""Threads per block."""
ITEMS_A_LAUNCH = 1 << 20
"""Maximum number of items per launch; Windows stops launches that take two seconds."""
USABLE_MEMORY = 0.9
"""Fraction of the free memory that a session plans with."""

_SCALARS = {"f8": ctypes.c_double, "f4": ctypes.c_float, "i8": ctypes.c_int64, "b1": ctypes.c_bool}


class Driver:
    """The driver library, with errors as exceptions.

    Parameters
    ----------
    library
        Its attributes are the functions of the CUDA driver API.
    """

    def __init__(self, library: Any) -> None:
        self._library = library

    def __call__(self, name: str, *arguments: Any) -> None:
        """Call a function of the driver API.

        Raises
        ------
        GpuError
            With the error text of the driver.
        """
        try:
            function = getattr(self._library, name)
        except AttributeError:
            raise GpuError(f"the driver is too old: it has no {name}.") from None
        if code := function(*arguments):
            text = ctypes.c_char_p()
            self._library.cuGetErrorString(code, ctypes.byref(text))
            why = (text.value or b"an error that it does not know").decode("utf-8", "replace")
            raise GpuError(f"{name} failed: {why} ({code}).")


def load_library() -> Any:
    """Load the driver library.

    Raises
    ------
    GpuError
        When it is not installed.
    """
    name = {"win32": "nvcuda.dll", "linux": "libcuda.so.1"}.get(sys.platform)
    if name is None:
        raise GpuError("NVIDIA has no driver for this system.")
    try:
        return getattr(ctypes, "WinDLL", ctypes.CDLL)(name)
    except OSError:
        raise GpuError(f"there is no NVIDIA driver here ({name} is not found).") from None


class DeviceArray:
    """An array in GPU memory; its session frees it."""

    def __init__(self, address: int, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        self.address, self.shape, self.dtype = address, shape, dtype
        self.nbytes = math.prod(shape) * dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice) -> DeviceArray:
        """Return a view of consecutive rows."""
        begin, end, _ = rows.indices(self.shape[0])
        one = math.prod(self.shape[1:]) * self.dtype.itemsize
        rest = (max(end - begin, 0), *self.shape[1:])
        return DeviceArray(self.address + begin * one, rest, self.dtype)

    def words(self) -> list[ctypes.c_uint64]:
        """Return the kernel parameters: two nulls, size, item size, address, shape, strides."""
        strides: list[int] = []
        step = self.dtype.itemsize
        for length in reversed(self.shape):
            strides.insert(0, step)
            step *= length
        fields = 0, 0, math.prod(self.shape), self.dtype.itemsize, self.address
        return [ctypes.c_uint64(one) for one in (*fields, *self.shape, *strides)]


class Gpu:
    """The first GPU, its primary context and the loaded kernels."""

    def __init__(self) -> None:
        self.call = call = Driver(load_library())
        call("cuInit", 0)
        count = ctypes.c_int()
        call("cuDeviceGetCount", ctypes.byref(count))
        if count.value == 0:
            raise GpuError("the driver finds no GPU.")
        self._number = ctypes.c_int()
        call("cuDeviceGet", ctypes.byref(self._number), 0)
        name = ctypes.create_string_buffer(256)
        call("cuDeviceGetName", name, len(name), self._number)
        self.name = name.value.decode("utf-8", "replace")
        major, minor = (self._attribute(one) for one in (75, 76))
        if (major, minor) < (7, 5):
            raise GpuError(f"{self.name} is too old: compute capability {major}.{minor}, not 7.5.")
        version = ctypes.c_int()
        call("cuDriverGetVersion", ctypes.byref(version))
        self.driver = f"{version.value // 1000}.{version.value % 1000 // 10}"
        self._context = ctypes.c_void_p()
        call("cuDevicePrimaryCtxRetain", ctypes.byref(self._context), self._number)
        self._lock = threading.RLock()
        self._functions: dict[str, ctypes.c_void_p] = {}
        self.process = os.getpid()
        atexit.register(self.close)

    def _attribute(self, number: int) -> int:
        value = ctypes.c_int()
        self.call("cuDeviceGetAttribute", ctypes.byref(value), number, self._number)
        return value.value

    def close(self) -> None:
        """Release the primary context and all kernels."""
        if self.process == os.getpid():
            with suppress(GpuError):
                self.call("cuDevicePrimaryCtxRelease_v2", self._number)

    @contextmanager
    def _current(self) -> Iterator[None]:
        """Make the context current in this thread; only one thread at a time."""
        with self._lock:
            self.call("cuCtxPushCurrent_v2", self._context)
            try:
                yield
            finally:
                self.call("cuCtxPopCurrent_v2", ctypes.byref(ctypes.c_void_p()))

    @contextmanager
    def session(self, progress: Progress) -> Iterator[Session]:
        """Open a session. Only one is open at a time; the current context of the thread is kept."""
        with self._current():
            session = Session(self, progress)
            try:
                yield session
            finally:
                session.close()

    def function(self, name: str) -> ctypes.c_void_p:
        """Return a kernel; the driver compiles it on first use."""
        if name not in self._functions:
            about, module, function = kernel(name), ctypes.c_void_p(), ctypes.c_void_p()
            with self._current():
                self.call("cuModuleLoadData", ctypes.byref(module), about["ptx"].encode() + b"\0")
                entry = about["entry"].encode()
                self.call("cuModuleGetFunction", ctypes.byref(function), module, entry)
            self._functions[name] = function
        return self._functions[name]


class Session:
    """GPU memory and kernel launches of one computation.

    Parameters
    ----------
    device : Gpu
    progress : Progress
        Checked for cancellation between launches (`Progress.still`).
    """

    def __init__(self, device: Gpu, progress: Progress) -> None:
        self._device, self._call, self._progress = device, device.call, progress
        self._taken: list[int] = []

    def close(self) -> None:
        """Free all memory."""
        while self._taken:
            with suppress(GpuError):  # every call fails after a faulty kernel
                self._call("cuMemFree_v2", ctypes.c_uint64(self._taken.pop()))

    def free(self, *arrays: DeviceArray) -> None:
        """Free arrays that `empty`, `zeros` or `put` returned."""
        for array in arrays:
            if array.nbytes:
                self._taken.remove(array.address)
                self._call("cuMemFree_v2", ctypes.c_uint64(array.address))

    def room(self) -> int:
        """Return the number of bytes that a session can allocate."""
        free, total = ctypes.c_size_t(), ctypes.c_size_t()
        self._call("cuMemGetInfo_v2", ctypes.byref(free), ctypes.byref(total))
        return int(USABLE_MEMORY * free.value)

    def empty(self, shape: int | tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Allocate an uninitialised array."""
        shape, kind = (shape,) if isinstance(shape, int) else shape, np.dtype(dtype)
        address, size = ctypes.c_uint64(), math.prod(shape) * kind.itemsize
        if size:
            self._call("cuMemAlloc_v2", ctypes.byref(address), ctypes.c_size_t(size))
            self._taken.append(address.value)
        return DeviceArray(address.value, tuple(map(int, shape)), kind)

    def zeros(self, shape: int | tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Allocate an array of zeros."""
        array = self.empty(shape, dtype)
        if array.nbytes:
            size = ctypes.c_size_t(array.nbytes)
            self._call("cuMemsetD8_v2", ctypes.c_uint64(array.address), ctypes.c_ubyte(0), size)
        return array

    def put(self, value: Any) -> Any:
        """Upload an array, or all arrays of a (named) tuple; numbers are returned unchanged."""
        if isinstance(value, tuple):
            parts = [self.put(part) for part in value]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        if not isinstance(value, np.ndarray):
            return value
        array = np.ascontiguousarray(value)
        copy = self.empty(array.shape, array.dtype)
        if copy.nbytes:
            source, size = ctypes.c_void_p(array.ctypes.data), ctypes.c_size_t(copy.nbytes)
            self._call("cuMemcpyHtoD_v2", ctypes.c_uint64(copy.address), source, size)
        return copy

    def get(self, array: DeviceArray, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Download an array into a new array, or into the contiguous array `out`."""
        result = np.empty(array.shape, array.dtype) if out is None else out
        if result.nbytes != array.nbytes or not result.flags.c_contiguous:
            raise ValueError(f"cannot copy {array.shape} {array.dtype} to {result.shape}")
        if array.nbytes:
            target, size = ctypes.c_void_p(result.ctypes.data), ctypes.c_size_t(array.nbytes)
            self._call("cuMemcpyDtoH_v2", target, ctypes.c_uint64(array.address), size)
        return result

    def launch(self, name: str, count: int, *arguments: Any) -> None:
        """Run a kernel for the items 0..count - 1 and wait until it ends.

        Raises
        ------
        GpuError
            When the driver cannot load or run the kernel.
        TypeError
            When the argument types differ from those of the compiled kernel.
        """
        expected, types = kernel(name)["types"], code_of_values(arguments)
        if types != expected:
            raise TypeError(f"{name} takes {expected}, got {types}")
        function = self._device.function(name)
        words = [word for one in arguments for word in _words(one)]
        for first in range(0, count, ITEMS_A_LAUNCH):
            self._progress.update(0.0)
            last = min(first + ITEMS_A_LAUNCH, count)
            every = [ctypes.c_int64(first), ctypes.c_int64(last), *words]
            pointers = (ctypes.c_void_p * len(every))(*(ctypes.addressof(one) for one in every))
            grid = -(-(last - first) // BLOCK_SIZE), 1, 1, BLOCK_SIZE, 1, 1, 0
            self._call("cuLaunchKernel", function, *grid, None, pointers, None)
            self._call("cuCtxSynchronize")


def code_of_values(values: Any) -> str:
    """Return the type code of arguments; `jit.code_of` returns the same code for type words."""
    code = ""
    for value in values:
        if isinstance(value, tuple):
            code += f"({code_of_values(value)})"
        elif isinstance(value, DeviceArray):
            code += f"a{value.dtype.str[1:]}{len(value.shape)}C"
        else:
            code += f"s{_scalar(value)}"
    return code


def _scalar(value: Any) -> str:
    known = {bool: "b1", int: "i8", float: "f8"}.get(type(value))
    return known or np.dtype(type(value)).str[1:]


def _words(value: Any) -> list[Any]:
    """Return the kernel parameters of an argument; tuples are flattened."""
    if isinstance(value, tuple):
        return [word for part in value for word in _words(part)]
    if isinstance(value, DeviceArray):
        return value.words()
    return [_SCALARS[_scalar(value)](value)]


@cache
def made_kernels() -> dict[str, Any]:
    """Return stamp, types, entry and PTX of each kernel; {} if the file does not exist."""
    try:
        found: dict[str, Any] = json.loads(lzma.decompress(KERNELS.read_bytes()))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, lzma.LZMAError) as error:
        raise GpuError(f"{KERNELS} cannot be read ({error}).") from error
    return found


def kernel_names() -> list[str]:
    """Return the names of the compiled kernels.

    Raises
    ------
    GpuError
        When the installation has no compiled kernels.
    """
    if not made_kernels():
        raise GpuError(NOT_MADE)
    return list(made_kernels())


@cache
def _stamp(feature: str) -> str:
    return stamp_of(feature)


def kernel(name: str) -> dict[str, Any]:
    """Return the entry of a kernel in `made_kernels`.

    Raises
    ------
    GpuError
        When the kernel was not compiled, or was compiled from other sources.
    """
    about: dict[str, Any] | None = made_kernels().get(name)
    if about is None:
        raise GpuError(NOT_MADE)
    if about["stamp"] != _stamp(name.partition(".")[0]):
        raise GpuError("the sources have changed since the kernels for GPUs were made.")
    return about


_opened: list[Gpu] = []
_opening = threading.Lock()


def opened_gpu() -> Gpu:
    """Return the GPU of this process; it is opened on first use.

    After a failure, the next call tries again.

    Raises
    ------
    GpuError
        When there is no usable GPU, or this process was forked after the GPU was opened.
    """
    with _opening:
        if not _opened:
            _opened.append(Gpu())
    if _opened[0].process != os.getpid():
        raise GpuError("this process was forked from one that uses the GPU: start it anew instead.")
    return _opened[0]
