"""A driver without a GPU: memory is that of the process, and kernels run their bodies here.

Items run in a random order, and what a thread has for itself comes with anything in it, so that
whatever depends on either is found. What a kernel gets is read from the words that the real driver
would get. Calls fail on demand.
"""

from __future__ import annotations

import ctypes
import importlib.util
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from medialis.base import gpu
from medialis.base.jit import code_of
from medialis.hosts.compile_ahead import named

BUILD = Path(__file__).parents[2] / "core" / "kernel_library" / "build_gpu.py"


def builder() -> Any:
    """Return the module that makes the kernels."""
    spec = importlib.util.spec_from_file_location("build_gpu", BUILD)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


OUT_OF_MEMORY = 2
LISTED = {one.name: one for one in builder().listed()}


class FakeDriver:
    """What `libcuda.so.1` is to `gpu.Driver`.

    Attributes
    ----------
    fails : tuple of (str, int, int), optional
        The function that fails, at which of its calls, and its error.
    room : int
        Bytes of the memory.
    """

    def __init__(self, room: int = 1 << 30, seed: int = 0) -> None:
        self.room, self.taken, self.calls = room, {}, Counter()
        self.fails: tuple[str, int, int] | None = None
        self.capability = {75: 9, 76: 0}
        self.depth, self.retained, self.count = 0, 0, 1
        self._random = np.random.default_rng(seed)
        self._functions: list[str] = []

    def __getattribute__(self, name: str) -> Any:
        found = super().__getattribute__(name)
        if not name.startswith("cu") or name == "cuGetErrorString":
            return found

        def call(*arguments: Any) -> int:
            self.calls[name] += 1
            if self.fails is not None and self.fails[:2] == (name, self.calls[name]):
                return self.fails[2]
            return found(*arguments) or 0

        return call

    def cuInit(self, flags: int) -> None:  # noqa: N802 - names of the driver, as below
        pass

    def cuGetErrorString(self, code: int, text: Any) -> None:  # noqa: N802
        text._obj.value = b"out of memory" if code == OUT_OF_MEMORY else b"made to fail"

    def cuDeviceGetCount(self, count: Any) -> None:  # noqa: N802
        count._obj.value = self.count

    def cuDeviceGet(self, device: Any, number: int) -> None:  # noqa: N802
        device._obj.value = number

    def cuDeviceGetName(self, name: Any, size: int, device: Any) -> None:  # noqa: N802
        name.value = b"Fake GPU"

    def cuDeviceGetAttribute(self, value: Any, number: int, device: Any) -> None:  # noqa: N802
        value._obj.value = self.capability[number]

    def cuDriverGetVersion(self, version: Any) -> None:  # noqa: N802
        version._obj.value = 12040

    def cuDevicePrimaryCtxRetain(self, context: Any, device: Any) -> None:  # noqa: N802
        context._obj.value, self.retained = 1, self.retained + 1

    def cuDevicePrimaryCtxRelease_v2(self, device: Any) -> None:  # noqa: N802
        self.retained -= 1

    def cuCtxPushCurrent_v2(self, context: Any) -> None:  # noqa: N802
        self.depth += 1

    def cuCtxPopCurrent_v2(self, context: Any) -> None:  # noqa: N802
        self.depth -= 1

    def cuCtxSynchronize(self) -> None:  # noqa: N802
        pass

    def cuMemGetInfo_v2(self, free: Any, total: Any) -> None:  # noqa: N802
        free._obj.value = self.room - sum(map(len, self.taken.values()))
        total._obj.value = self.room

    def cuMemAlloc_v2(self, address: Any, size: Any) -> int:  # noqa: N802
        if size.value + sum(map(len, self.taken.values())) > self.room:
            return OUT_OF_MEMORY
        memory = self._random.integers(0, 256, size.value, np.uint8)
        self.taken[memory.ctypes.data] = memory
        address._obj.value = memory.ctypes.data
        return 0

    def cuMemFree_v2(self, address: Any) -> None:  # noqa: N802
        del self.taken[address.value]

    def cuMemsetD8_v2(self, address: Any, value: Any, size: Any) -> None:  # noqa: N802
        ctypes.memset(self._inside(address.value, size.value), value.value, size.value)

    def cuMemcpyHtoD_v2(self, target: Any, source: Any, size: Any) -> None:  # noqa: N802
        ctypes.memmove(self._inside(target.value, size.value), source.value, size.value)

    def cuMemcpyDtoH_v2(self, target: Any, source: Any, size: Any) -> None:  # noqa: N802
        ctypes.memmove(target.value, self._inside(source.value, size.value), size.value)

    def cuModuleLoadData(self, module: Any, image: bytes) -> None:  # noqa: N802
        module._obj.value = 1

    def cuModuleGetFunction(self, function: Any, module: Any, entry: bytes) -> int:  # noqa: N802
        self._functions.append(entry.decode())
        function._obj.value = len(self._functions)
        return 0

    def cuLaunchKernel(self, function: Any, *rest: Any) -> None:  # noqa: N802
        (*grid, _, _), pointers = rest[:8], rest[8]
        assert grid[1:3] == [1, 1] and grid[4:6] == [1, 1], grid
        one = LISTED[self._functions[function.value - 1]]
        words = _Words(pointers, self)
        first, last = (words.take(ctypes.c_int64) for _ in range(2))
        assert 0 < last - first <= grid[0] * grid[3]
        arguments = words.values(one.words)
        assert words.at == len(pointers)
        self.run(one.name, first, last, arguments)

    def run(self, name: str, first: int, last: int, arguments: list[Any]) -> None:
        """Run some items of a kernel."""
        rooms = [
            self._random.integers(0, 256, (*shape, np.dtype(dtype).itemsize), np.uint8)
            .view(dtype)
            .reshape(shape)
            for shape, dtype in LISTED[name].rooms
        ]
        body = named(name)
        for item in self._random.permutation(np.arange(first, last)).tolist():
            body(item, *arguments, *rooms)

    def _inside(self, address: int, size: int) -> int:
        """Return an address, when so many bytes after it are within what was taken."""
        for begin, memory in self.taken.items():
            if begin <= address and address + size <= begin + len(memory):
                return address
        raise AssertionError(f"{size} bytes at {address} are not within what was taken")


class _Words:
    """The words of a launch, read in turn."""

    def __init__(self, pointers: Any, driver: FakeDriver) -> None:
        self._pointers, self._driver, self.at = pointers, driver, 0

    def take(self, kind: Any) -> Any:
        pointer = self._pointers[self.at]
        self.at += 1
        return ctypes.cast(pointer, ctypes.POINTER(kind)).contents.value

    def values(self, types: list[Any]) -> list[Any]:
        return [self._value(word) for word in types]

    def _value(self, word: Any) -> Any:
        if isinstance(word, list):
            values = self.values(word[1:])
            return named(word[0])(*values) if word[0] else tuple(values)
        kind, _, about = word.partition(":")
        if not about:
            return self.take(gpu._SCALARS[kind])
        owner, parent, items, size, address, *rest = (
            self.take(ctypes.c_uint64) for _ in range(5 + 2 * int(about[0]))
        )
        shape, strides = rest[: len(rest) // 2], rest[len(rest) // 2 :]
        assert (owner, parent, size) == (0, 0, np.dtype(kind).itemsize)
        assert items == np.prod(shape, dtype=int)
        if items == 0:
            return np.empty(shape, kind)
        self._driver._inside(address, items * size)
        memory = (ctypes.c_ubyte * (items * size)).from_address(address)
        array = np.frombuffer(memory, kind).reshape(shape)
        assert array.strides == tuple(strides)
        return array


def install(monkeypatch: Any, driver: Any) -> None:
    """Let a driver be that of this process, with kernels as if they were made."""
    made = {
        name: {"stamp": gpu._stamp(name.partition(".")[0]), "types": code_of(one.words),
               "entry": name, "ptx": ""}
        for name, one in LISTED.items()
    }  # fmt: skip
    monkeypatch.setattr(gpu, "load_library", lambda: driver)
    monkeypatch.setattr(gpu, "made_kernels", lambda: made)
    monkeypatch.setattr(gpu, "_opened", [])


def parameters(ptx: str) -> list[str]:
    """Return the types of the parameters of the entry of a PTX text."""
    head = re.search(r"\.entry \w+\((.*?)\)", ptx, re.DOTALL)
    assert head is not None
    return re.findall(r"\.param \.(\w+)", head.group(1))
