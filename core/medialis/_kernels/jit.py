"""The one decorator for kernels: nogil, cached per user, and never stale.

Numba's own cache knows only the source file of the kernel it stores: when a kernel that it *calls*
changes in another file, an upgraded installation would run the old machine code. So the cache lives
in one folder per numba version and per hash of all kernel sources (`cache_folder.py`), in the
user's cache folder. It survives re-installation, serves every environment of the user, and an
unwritable installation folder does not matter.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numba
from numba.core import caching

from medialis._kernels.cache_folder import kernel_cache


class _Locator:
    """Numba cache locator: our folder; the stamp is constant because the folder holds the hash."""

    def __init__(self, py_func: Callable[..., Any]) -> None:
        self._module = py_func.__module__

    def ensure_cache_path(self) -> None:
        kernel_cache().mkdir(parents=True, exist_ok=True)
        if not os.access(kernel_cache(), os.W_OK):
            raise OSError(f"{kernel_cache()} is not writable")

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
        except OSError:
            return None
        return locator


class _CacheImpl(caching.CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - numba reads a plain class attribute


class _Cache(caching.FunctionCache):
    """Numba's cache; a damaged file or a full disk costs a compilation, never the computation."""

    _impl_class = _CacheImpl

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - a damaged pickle raises anything
            with suppress(OSError):
                self.flush()  # an empty index: the next save repairs it
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel with `nogil` and our cache; without a writable cache it compiles anew."""
    dispatcher = numba.njit(nogil=True)(function)
    with suppress(RuntimeError):  # no writable cache folder: slower start, same results
        dispatcher._cache = _Cache(function)
    return dispatcher
