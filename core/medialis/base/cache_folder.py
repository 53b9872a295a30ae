"""Where compiled kernels are kept, and whether they all are; nothing here loads numba.

One folder for each numba version, hash of all kernel sources and settings of numba, in the user's
cache folder (`MEDIALIS_CACHE_DIR` or `NUMBA_CACHE_DIR` override it); `jit.py` says why. It holds
machine code that is run as it is, so a folder that others can write to is not used.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from medialis.base.disk import steps_to

PACKAGE = Path(__file__).resolve().parent.parent

SAME_CODE = ("NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS", "NUMBA_DEBUG_CACHE")
"""Settings of numba that change no compiled code."""


def kernel_sources() -> list[Path]:
    """Return every kernel source file of the package, in a fixed order."""
    return sorted([*PACKAGE.glob("base/compiling.py"), *PACKAGE.rglob("_*kernels.py")])


def user_cache() -> Path:
    """Return the folder of the user under which the kernels of all versions are."""
    for variable in ("MEDIALIS_CACHE_DIR", "NUMBA_CACHE_DIR"):
        if os.environ.get(variable):
            return Path(os.environ[variable])
    given = {"win32": "LOCALAPPDATA", "darwin": ""}.get(sys.platform, "XDG_CACHE_HOME")
    if given and os.environ.get(given):
        return Path(os.environ[given]) / "medialis"
    try:
        home = Path.home()
    except RuntimeError:  # no HOME and no entry of the user, as in a container
        import tempfile

        return Path(tempfile.gettempdir()) / f"medialis-{getattr(os, 'getuid', int)()}"
    usual = {"win32": "AppData/Local", "darwin": "Library/Caches"}.get(sys.platform, ".cache")
    return home / usual / "medialis"


@lru_cache(maxsize=1)
def kernel_cache() -> Path:
    """Return the folder of the compiled kernels for the sources and the numba in use."""
    from importlib.metadata import version

    digest = hashlib.sha256()
    for source in kernel_sources():
        digest.update(source.relative_to(PACKAGE).as_posix().encode())
        digest.update(source.read_bytes())
    # Code that checks bounds, or is made for another processor, must not be taken for the usual.
    for name in sorted(os.environ):
        if name.startswith("NUMBA_") and name not in SAME_CODE:
            digest.update(f"{name}={os.environ[name]}".encode())
    return user_cache() / f"kernels-{digest.hexdigest()[:12]}-numba{version('numba')}"


def make_kernel_cache() -> None:
    """Make the folder of the compiled kernels, for this user alone.

    Raises
    ------
    OSError
        When it cannot be made or written, or somebody else could write to it.
    """
    folder = kernel_cache()
    for place in (folder.parent, folder):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if reason := written_by_others(place):
            raise OSError(reason)
    if not os.access(folder, os.W_OK):
        raise OSError(f"{folder} is not writable")


def written_by_others(folder: Path) -> str | None:
    """Say why machine code in a folder cannot be trusted; None when it can.

    Nobody else may write to it, nor rename or exchange a folder or a link on the way to it, as ssh
    has it: those belong to this user or to root, and others write to them only where the system
    keeps each from the entries of others (`/tmp`). A group that has nobody else in it is no other
    on the way.
    """
    if not hasattr(os, "geteuid"):  # Windows: the user's own folders are closed to others
        return None
    if folder.stat().st_uid != os.geteuid():
        return f"{folder} belongs to another user"
    for place in (step for step, link in steps_to(folder) if not link):
        about = place.stat()
        if about.st_uid not in (0, os.geteuid()):
            return f"{place} belongs to another user"
        own = place != folder and about.st_gid == os.getegid() and _own_group()
        others = stat.S_IWOTH | (0 if own else stat.S_IWGRP)
        if about.st_mode & others and (place == folder or not about.st_mode & stat.S_ISVTX):
            return f"other users can write to {place}"
    return None


@lru_cache(maxsize=1)
def _own_group() -> bool:
    """Tell whether the user's group has nobody else in it, as usual where users get one each."""
    import grp
    import pwd

    with suppress(KeyError):
        group, user = grp.getgrgid(os.getegid()), pwd.getpwuid(os.geteuid())
        return group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}
    return False


def read_own(path: str) -> bytes | None:
    """Return what a file holds that is this user's alone; None when there is none of that kind.

    It is looked at when it is open: what lies under its name may be exchanged at any time.
    """
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    flags |= getattr(os, "O_BINARY", 0)
    with suppress(OSError), os.fdopen(os.open(path, flags), "rb") as stream:
        about = os.fstat(stream.fileno())
        if not stat.S_ISREG(about.st_mode):
            return None
        if hasattr(os, "geteuid") and about.st_uid != os.geteuid():
            return None
        if os.name != "nt" and about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return None
        return stream.read()
    return None


def _marker() -> Path:
    return kernel_cache() / f"complete-{sys.implementation.cache_tag}"


def kernels_are_compiled() -> bool:
    """Tell whether a warm-up with this Python, these sources and this numba came to its end."""
    return _marker().is_file()


def mark_compiled() -> None:
    """Remember that all kernels are compiled; without a writable folder nothing is remembered."""
    with suppress(OSError):
        _marker().touch()
