"""Compiling kernels by numba when they are called, kept for each user, and never stale.

Numba's own cache knows only the source file of the kernel it stores: when a kernel that it *calls*
changes in another file, an upgraded installation would run the old machine code. So the cache lives
in one folder per numba version and per hash of all kernel sources (`cache_folder.py`), in the
user's cache folder. It survives re-installation, serves every environment of the user, and an
unwritable installation folder does not matter.

What is read there is run as machine code, so each file begins with a checksum of its name and
content: a damaged, truncated or exchanged file is no entry, and is compiled anew. Files of other
users, and files that others could have changed, are none either.

Loaded by `jit.py` when a kernel has to be compiled; nothing else imports numba.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
from collections.abc import Callable
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.extending import typeof_impl

from medialis.base.cache_folder import kernel_cache, make_kernel_cache, read_own
from medialis.base.threads import interrupts_held

logger = logging.getLogger("medialis")


class _Locator:
    """Numba cache locator: our folder; the stamp is constant because the folder holds the hash."""

    def __init__(self, py_func: Callable[..., Any]) -> None:
        self._module = py_func.__module__

    def ensure_cache_path(self) -> None:
        make_kernel_cache()

    def get_cache_path(self) -> str:
        return str(kernel_cache())

    def get_source_stamp(self) -> str:
        return kernel_cache().name

    def get_disambiguator(self) -> str:
        return self._module

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Locator | None:
        locator = cls(py_func)
        try:
            locator.ensure_cache_path()
        except OSError as error:
            _say_once(str(error))
            return None
        return locator


@lru_cache
def _say_once(reason: str) -> None:
    logger.warning(
        "Compiled kernels are not kept: %s. Every start compiles them anew; set MEDIALIS_CACHE_DIR "
        "to a folder that you alone can write to.",
        reason,
    )


class _CacheImpl(caching.CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - numba reads a plain class attribute


SUM = 32
"""Bytes of a checksum."""


class _CheckedFiles(caching.IndexDataCacheFile):
    """Numba's index and data files of one kernel, each behind a checksum.

    Data have the name of their types, not the next number: of processes that compile a kernel for
    different types at the same time, numba gives two the same number, and one runs the code of the
    other.
    """

    def save(self, key: Any, data: Any) -> None:
        overloads, name = self._load_index(), self._name_of(key)
        if overloads.get(key) != name:
            self._save_index({**overloads, key: name})
        self._save_data(name, data)

    def load(self, key: Any) -> Any:
        named = self._load_index().get(key) == self._name_of(key)  # others are of before
        return super().load(key) if named else None

    def _name_of(self, key: Any) -> str:
        types = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return f"{self._index_name.removesuffix('.nbi')}.{types}.nbc"

    def _load_index(self) -> dict[Any, str]:
        content = self._read(self._index_path)
        return {} if content is None else pickle.loads(content)

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, self._dump(overloads))

    def _load_data(self, name: str) -> Any:
        content = self._read(self._data_path(name))
        if content is None:
            raise FileNotFoundError(name)  # numba compiles, and writes it anew
        return pickle.loads(content)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), self._dump(data))

    def _read(self, path: str) -> bytes | None:
        """Return what a file holds; None when there is none, or its checksum is wrong."""
        written = read_own(path)
        if written is not None and written[:SUM] == _checksum(path, written[SUM:]):
            return written[SUM:]
        return None

    def _write(self, path: str, content: bytes) -> None:
        with self._open_for_write(path) as stream:
            stream.write(_checksum(path, content) + content)


def _checksum(path: str, content: bytes) -> bytes:
    """Bind a content to its name and its folder: another file put in its place is no entry."""
    place = f"{Path(path).parent.name}/{Path(path).name}\0".encode()
    return hashlib.sha256(place + content).digest()


class _Cache(caching.FunctionCache):
    """Numba's cache; a damaged file or a full disk costs a compilation, never the computation."""

    _impl_class = _CacheImpl

    def __init__(self, py_func: Callable[..., Any]) -> None:
        super().__init__(py_func)
        self._cache_file = _CheckedFiles(
            self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            with interrupts_held():  # half a library, or its lock taken, would stay
                return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - written by another version of a library
            with suppress(OSError):
                self.flush()  # an empty index: the next save repairs it
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


def dispatcher_of(kernel: Any) -> Any:
    """Return numba's dispatcher of a kernel, made when it is first asked for."""
    know(type(kernel))
    if kernel.dispatcher is None:
        dispatcher = numba.njit(nogil=True)(kernel.py_func)
        with suppress(RuntimeError):  # no writable cache folder: slower start, same results
            dispatcher._cache = _Cache(kernel.py_func)
        kernel.dispatcher = dispatcher
    return kernel.dispatcher


def compile_for(kernel: Any, examples: list[Any]) -> None:
    """Compile a kernel for arguments of the types of these, or find it compiled."""
    dispatcher_of(kernel).compile(tuple(map(numba.typeof, examples)))


@cache
def know(kind: type) -> None:
    """Let numba see the dispatcher where one kernel calls another."""
    typeof_impl.register(kind)(lambda kernel, _: numba.types.Dispatcher(dispatcher_of(kernel)))
