"""Where compiled kernels are kept, and whether they all are; nothing here loads numba.

One folder for each numba version and hash of all kernel sources, in the user's cache folder
(`MEDIALIS_CACHE_DIR` or `NUMBA_CACHE_DIR` override it); `jit.py` says why.
"""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent


def kernel_sources() -> list[Path]:
    """Return every kernel source file of the package, in a fixed order."""
    return sorted([*PACKAGE.glob("_kernels/*.py"), *PACKAGE.rglob("_*_kernels.py")])


def user_cache() -> Path:
    """Return the folder of the user under which the kernels of all versions are."""
    for variable in ("MEDIALIS_CACHE_DIR", "NUMBA_CACHE_DIR"):
        if os.environ.get(variable):
            return Path(os.environ[variable])
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "medialis"


@lru_cache(maxsize=1)
def kernel_cache() -> Path:
    """Return the folder of the compiled kernels for the sources and the numba in use."""
    digest = hashlib.sha256()
    for source in kernel_sources():
        digest.update(source.relative_to(PACKAGE).as_posix().encode())
        digest.update(source.read_bytes())
    return user_cache() / f"kernels-{digest.hexdigest()[:12]}-numba{version('numba')}"


def _marker() -> Path:
    return kernel_cache() / f"complete-{sys.implementation.cache_tag}"


def kernels_are_compiled() -> bool:
    """Tell whether a warm-up with this Python, these sources and this numba came to its end."""
    return _marker().is_file()


def mark_compiled() -> None:
    """Remember that all kernels are compiled; without a writable folder nothing is remembered."""
    with suppress(OSError):
        _marker().touch()
