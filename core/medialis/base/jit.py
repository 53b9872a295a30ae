"""The one decorator for kernels: made ahead of time, else compiled by numba, else a sentence.

`core/kernel_library/build.py` makes one extension module for each feature, `_made`, beside its
kernels, and writes in `base/made-*.json` which kernels it holds, for which types, and a hash of
the sources that it was made from. A module whose sources have changed since, or whose file is not
whole, is never used: numba compiles those kernels when they are called (`compiling.py`), as it
does for types that were not made. `MEDIALIS_KERNELS` says `numba` to do so always, or `made` to
have an error where a kernel was made for other types, or `note:FILE` to have a line written for
each kernel and types that were not made. Nothing here loads numba.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import logging
import os
import re
import threading
from collections.abc import Callable, Sized
from functools import cache, update_wrapper
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

from medialis.base.cache_folder import PACKAGE, SAME_CODE
from medialis.base.errors import MedialisError

logger = logging.getLogger("medialis")

MADE = "_made"
"""Name of the extension module of a feature."""
MADE_V3 = "_made_v3"
"""Name of a second one, where it pays, for processors that know x86-64-v3 (since 2013)."""
DISPATCH = "_dispatch"
TAG = EXTENSION_SUFFIXES[0].split(".")[1]
"""Python, system and processor that a module is made for, as in its name."""
RECORD = PACKAGE / "base" / f"made-{TAG}.json"
OTHERS = "`pip install --force-reinstall medialis` mends an installation, `make kernels` a clone"
_CALLED = re.compile(r"^from medialis\.([\w.]+kernels) import", re.MULTILINE)
_lock = threading.RLock()
_said: list[str] = []


class Kernel:
    """A kernel where no machine code is made ahead: numba compiles it when it is called."""

    def __init__(self, resolve: Callable[..., Any]) -> None:
        self.resolve = resolve
        self.dispatcher: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Call what numba compiled."""
        if self.dispatcher is None:
            return self.resolve(self, *arguments)
        return self.dispatcher(*arguments)


def kernel(function: Callable[..., Any]) -> Any:
    """Return a kernel: it runs without the interpreter's lock, and takes arguments by place."""
    made = kernel_class()(_resolve)
    update_wrapper(made, function)
    made.py_func, made.dispatcher, made.is_loaded, made.is_made = function, None, False, False
    return made


def code_of(words: list[Any]) -> str:
    """Return the code of types that `dispatch.c` compares arguments with, from words of a list.

    Examples
    --------
    >>> code_of(["f8", "i4:2Cr", ["walls._kernels:Links", "i4:1C"]])
    'sf8ai42C(ai41C)'
    """
    return "".join(
        f"({code_of(word[1:])})"
        if isinstance(word, list)
        else "a{0}{2}".format(*word.removesuffix("r").partition(":"))
        if ":" in word
        else f"s{word}"
        for word in words
    )


def sources_of(feature: str) -> dict[str, bytes]:
    """Return the sources of a feature's kernels, and of all kernels that these call, by path."""
    waiting = list((PACKAGE / feature).rglob("_*kernels.py"))
    found: dict[str, bytes] = {}
    while waiting:
        path = waiting.pop()
        name = path.relative_to(PACKAGE).as_posix()
        if name not in found:
            found[name] = path.read_bytes()
            called = _CALLED.findall(found[name].decode())
            waiting += [PACKAGE / f"{one.replace('.', '/')}.py" for one in called]
    return dict(sorted(found.items()))


def stamp_of(feature: str) -> str:
    """Return a hash of the sources that the machine code of a feature is made from."""
    digest = hashlib.sha256()
    for name, text in sources_of(feature).items():
        digest.update(f"{name}\0{len(text)}\0".encode() + text)
    return digest.hexdigest()[:16]


@cache
def record() -> dict[str, Any]:
    """Return what was made for this Python: size, stamp and kernels of each module; {} if none."""
    changed = [n for n in os.environ if n.startswith("NUMBA_") and n not in SAME_CODE]
    if changed or os.environ.get("MEDIALIS_KERNELS") == "numba":
        return {}
    try:
        found: dict[str, Any] = json.loads(RECORD.read_text(encoding="ascii"))
    except FileNotFoundError:
        if others := sorted(RECORD.parent.glob("made-*.json")):
            tags = " and ".join(path.stem.removeprefix("made-") for path in others)
            _warn(f"were made for {tags}, and this is {TAG}")
        return {}
    except (OSError, ValueError) as error:
        _warn(f"cannot be looked up: {error}")
        return {}
    return found


def _warn(reason: str) -> None:
    """Say once in a process why numba is used where code was made ahead."""
    if not _said:
        _said.append(reason)
        logger.warning("Kernels made ahead %s. numba compiles them now; %s.", reason, OTHERS)


@cache
def kernel_class() -> Any:
    """Return the class of kernels: that of `dispatch.c`, where machine code was made that runs."""
    dispatch = _module("base", DISPATCH) if record() else None
    return dispatch.Kernel if dispatch is not None and dispatch.RUNS_HERE else Kernel


@cache
def _module(feature: str, name: str = MADE) -> Any:
    """Return the extension module of a feature; None when there is none, or it cannot be used.

    A file that is cut off would end the process when it is loaded, so its size is looked at first.
    What packagers do to a module (a signature, names of libraries) makes it no smaller.
    """
    about = record().get(f"{feature}/{name}")
    if about is None or (name != DISPATCH and about["stamp"] != stamp_of(feature)):
        return None
    path = PACKAGE / feature / about["file"]
    try:
        if path.stat().st_size < about["size"]:
            raise OSError(f"{path} is cut off")
        return importlib.import_module(f"medialis.{feature}.{name}")
    except (OSError, ImportError) as error:
        _warn(f"cannot be loaded: {error}")
    return None


def _resolve(one: Any, *arguments: Any) -> Any:
    """Load what was made of a kernel, and call it; what was not made numba compiles.

    Raises
    ------
    MedialisError
        When there is no numba to do so.
    """
    if not one.is_loaded and type(one) is not Kernel:
        with _lock:
            if not one.is_loaded:
                _load(one)
        return one(*arguments)
    if one.dispatcher is None:
        with _lock:
            _compile(one, arguments)
    return one.dispatcher(*arguments)


def _load(one: Any) -> None:
    for code, function in _variants(one.__module__.removeprefix("medialis."), one.__name__):
        one.add(code.encode(), function)
        one.is_made = True
    one.is_loaded = True


def _variants(where: str, name: str) -> list[tuple[str, Callable[..., Any]]]:
    """Return what was made of a kernel: codes of types, and functions."""
    feature = where.partition(".")[0]
    dispatch = _module("base", DISPATCH)
    for made in (MADE_V3, MADE) if dispatch.RUNS_V3 else (MADE,):
        if (module := _module(feature, made)) is not None:
            kernels = record()[f"{feature}/{made}"]["kernels"].get(f"{where}:{name}", ())
            return [(code, getattr(module, symbol)) for code, symbol in kernels]
    return []


def _compile(one: Any, arguments: tuple[Any, ...]) -> None:
    line = f"{one.__module__.removeprefix('medialis.')}:{one.__name__}||" + json.dumps(
        words_of(arguments), separators=(",", ":")
    )
    how, _, note = os.environ.get("MEDIALIS_KERNELS", "").partition(":")
    if how == "made" and one.is_made:
        raise MedialisError(
            f"Not made ahead: {line}; `python benchmarks/record_kernels.py` lists it."
        )
    if how == "note":
        with Path(note).open("a", encoding="ascii") as stream:
            stream.write(f"{line}\n")
    try:
        from medialis.base.compiling import dispatcher_of
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("numba", "llvmlite"):
            raise
        raise MedialisError(
            f"Kernel {one.__name__} was not made ahead of time for this computer, and numba is "
            f"missing: `pip install numba`, or {OTHERS}."
        ) from error
    dispatcher_of(one)


def words_of(values: tuple[Any, ...]) -> list[Any]:
    """Return the words for the types of arguments, as the list of kernels has them."""
    return [_word(value) for value in values]


def _word(value: Any) -> Any:
    if isinstance(value, tuple):
        kind = type(value)
        where = kind.__module__.removeprefix("medialis.")
        return ["" if kind is tuple else f"{where}:{kind.__name__}", *map(_word, value)]
    dtype = getattr(value, "dtype", None)
    if dtype is None:
        return {float: "f8", int: "i8", bool: "b1"}.get(type(value), type(value).__name__)
    if not isinstance(value, Sized):
        return dtype.str[1:]
    flags: Any = value.flags  # type: ignore[attr-defined]
    layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
    return f"{dtype.str[1:]}:{value.ndim}{layout}{'' if flags.writeable else 'r'}"  # type: ignore[attr-defined]
