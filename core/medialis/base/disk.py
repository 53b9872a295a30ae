"""The one way to files and folders: along no link that somebody put there, and into no pipe.

A path that a user names is followed as the system follows it (`open_file`, `Folder.at`). What lies
in a folder is looked up in the open folder by a plain name: a link there is never followed, only
regular files are opened, and what happens to the name of the folder meanwhile changes nothing.
While a folder is `held`, paths into it are looked up in it too, so what takes paths is as safe.

Linux and macOS look names up in open folders. Windows cannot: there names are looked at, then
opened by their paths, and who may write to the folder could exchange them in between.

Errors are those of the system, OSError.
`tests/base/test_disk.py` forbids other ways; all calls go through `os` of this module, where tests
count them, let them fail and kill between them.
"""

from __future__ import annotations

import errno
import io
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

AT = {os.open, os.stat, os.unlink, os.mkdir, os.rmdir, os.rename} <= os.supports_dir_fd
"""Whether names are looked up in open folders."""

BUFFER = 1 << 18
"""Bytes that are written at once."""

LONGEST_WAY = 400
"""Folders and links on the way to a folder; systems follow 40 links."""

OTHERS_LINK = "{} is a link that another user has put there; name the folder that is meant"
NO_FILE, LINK = "it is not a regular file", "it is a link, which is not followed there"
NO_FOLDER = "it is not a folder"

_CLOSED = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOINHERIT", 0)
_BINARY, _NO_LINK = getattr(os, "O_BINARY", 0), getattr(os, "O_NOFOLLOW", 0)
_NO_WAIT = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | _CLOSED

_held: list[Folder] = []


def is_link(about: os.stat_result) -> bool:
    """Tell whether what was looked at leads elsewhere; on Windows junctions do as well."""
    tags = {getattr(stat, f"IO_REPARSE_TAG_{n}", -1) for n in ("SYMLINK", "MOUNT_POINT")}
    return stat.S_ISLNK(about.st_mode) or getattr(about, "st_reparse_tag", 0) in tags


class _Output(io.RawIOBase):
    """A file that is written, each call to the system made here."""

    def __init__(self, handle: int) -> None:
        self._handle = handle

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0, /) -> int:
        return os.lseek(self._handle, offset, whence)

    def write(self, data: object, /) -> int:
        return os.write(self._handle, data)  # type: ignore[arg-type]

    def close(self) -> None:
        if not self.closed:
            super().close()
            os.close(self._handle)


class Folder:
    """An open folder; leaving its `with` block closes it.

    Attributes
    ----------
    path : Path
        Whole, for messages and for what takes paths.
    handle : int or None
        None where names cannot be looked up in it.
    shown : Path
        What to call it in messages.
    """

    def __init__(self, path: Path, handle: int | None, shown: Path | None = None) -> None:
        self.path, self.handle, self.shown = path, handle, shown or path

    @classmethod
    def at(
        cls, path: str | os.PathLike[str], below: str | os.PathLike[str] | None = None
    ) -> Folder:
        """Open a folder that a user names; below `below`, another one around it, along no link."""
        whole = Path(path).absolute()
        if "\0" in str(whole):
            raise OSError(errno.EINVAL, "embedded null character", repr(whole))
        top = whole if below is None else Path(below).absolute()
        handle = None
        if AT:
            handle = _open_folder(top)
        elif not top.is_dir():
            os.scandir(top).close()  # raises what is wrong
        found = cls(top, handle)
        for name in whole.relative_to(top).parts:
            with found as outer:
                found = outer.folder(name)
        return found

    def __enter__(self) -> Folder:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close it, and give back its lock."""
        if self.handle is not None:
            os.close(self.handle)
            self.handle = None

    @contextmanager
    def held(self) -> Iterator[Folder]:
        """Look paths into this folder up in it, as long as the block runs."""
        _held.append(self)
        try:
            yield self
        finally:
            _held.remove(self)

    def path_of(self, name: str) -> Path:
        """Return the path of a name that leads nowhere else.

        Raises
        ------
        OSError
            For any other name.
        """
        separators = {"/", "\0", os.sep, os.altsep or os.sep, *((":",) if os.name == "nt" else ())}
        if name in ("", ".", "..") or any(one in name for one in separators):
            raise OSError(errno.EINVAL, f"{name[:60]!r} is not the name of a file in a folder")
        return self.path / name

    def _call(self, name: str) -> tuple[Path | str, int | None]:
        """Return what to call the system with."""
        path = self.path_of(name)
        return (path, None) if self.handle is None else (name, self.handle)

    def about(self, name: str | None = None) -> os.stat_result | None:
        """Return what a name stands for, or the folder itself; None: nothing is there."""
        if name is None:
            return os.stat(self.path) if self.handle is None else os.fstat(self.handle)
        where, handle = self._call(name)
        try:
            return os.stat(where, dir_fd=handle, follow_symlinks=False)
        except FileNotFoundError:
            return None

    def is_file(self, name: str) -> bool:
        """Tell whether a name is that of a regular file."""
        about = self.about(name)
        return about is not None and stat.S_ISREG(about.st_mode)

    def is_folder(self, name: str) -> bool:
        """Tell whether a name is that of a folder, and no link to one."""
        about = self.about(name)
        return about is not None and stat.S_ISDIR(about.st_mode) and not is_link(about)

    def is_same(self, about: os.stat_result | None) -> bool:
        """Tell whether it is this folder that was looked at."""
        mine = self.about()
        return about is not None and mine is not None and os.path.samestat(about, mine)

    @property
    def is_own(self) -> bool:
        """Whether it is this user's, and nobody else may write to it."""
        about = self.about()
        if about is None or not hasattr(os, "geteuid"):  # Windows: as the folder around it
            return about is not None
        return about.st_uid == os.geteuid() and not about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)

    def names(self) -> list[str]:
        """Return what is in it, sorted."""
        return sorted(os.listdir(self.path if self.handle is None else self.handle))

    def folder(self, name: str) -> Folder:
        """Open a folder in it."""
        where, handle = self._call(name)
        if handle is not None:
            try:
                return Folder(self.path / name, _open_folder(where, _NO_LINK, handle))
            except OSError as error:
                if error.errno not in (errno.ELOOP, errno.ENOTDIR, errno.EMLINK):
                    raise
        about = self.about(name)
        if about is None:
            raise FileNotFoundError(errno.ENOENT, "there is no such folder", name)
        if handle is not None or is_link(about) or not stat.S_ISDIR(about.st_mode):
            why = LINK if is_link(about) else NO_FOLDER
            raise NotADirectoryError(errno.ENOTDIR, why, os.fspath(self.path / name))
        return Folder(self.path / name, None)

    def make(self, name: str, mode: int = 0o777) -> None:
        """Make a folder in it."""
        where, handle = self._call(name)
        os.mkdir(where, mode, dir_fd=handle)

    def create(self, name: str, mode: int = 0o666) -> int:
        """Make a file that was not there, open for reading and writing."""
        where, handle = self._call(name)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | _NO_LINK | _CLOSED | _BINARY
        return os.open(where, flags, mode, dir_fd=handle)

    def new(self, name: str) -> BinaryIO:
        """Make a file that was not there, for writing."""
        return io.BufferedWriter(_Output(self.create(name)), BUFFER)

    def open_regular(self, name: str, flags: int = os.O_RDONLY) -> int:
        """Open a regular file in it."""
        about = self.about(name)
        if about is not None or not flags & os.O_CREAT:
            _require_regular(about, self.path / name)
        where, handle = self._call(name)
        flags |= _NO_LINK | _NO_WAIT | _CLOSED | _BINARY
        opened = os.open(where, flags, 0o666, dir_fd=handle)
        return _regular(opened, self.path / name)

    def open(self, name: str) -> BinaryIO:
        """Open a regular file in it for reading."""
        return os.fdopen(self.open_regular(name), "rb")

    def read(self, name: str) -> bytes:
        """Return what a regular file in it holds."""
        with self.open(name) as stream:
            return stream.read()

    def move(self, name: str, folder: Folder, new_name: str) -> None:
        """Give a file another place; what is there is replaced, a link itself and not its end."""
        here, there = self._call(name), folder._call(new_name)
        os.replace(here[0], there[0], src_dir_fd=here[1], dst_dir_fd=there[1])

    def remove(self, name: str) -> None:
        """Remove a file, or a link itself."""
        where, handle = self._call(name)
        os.unlink(where, dir_fd=handle)

    def remove_folder(self, name: str) -> None:
        """Remove an empty folder."""
        where, handle = self._call(name)
        os.rmdir(where, dir_fd=handle)

    def empty(self, keep: str = "") -> None:
        """Remove what is in it as far as it goes, links themselves and not their ends."""
        for name in self.names():
            if name != keep:
                with suppress(OSError):
                    if not self.is_folder(name):
                        self.remove(name)
                        continue
                    with self.folder(name) as inner:
                        inner.empty()
                    self.remove_folder(name)

    def files(self) -> Iterator[str]:
        """Yield all that is in it and in its folders and is no folder, with / between names."""
        for name in self.names():
            if self.is_folder(name):
                with self.folder(name) as inner:
                    yield from (f"{name}/{other}" for other in inner.files())
            else:
                yield name


def _open_folder(where: Path | str, flags: int = 0, handle: int | None = None) -> int:
    """Open a folder; one that may be passed but not listed is open for passing."""
    try:
        return os.open(where, _FOLDER | flags, dir_fd=handle)
    except PermissionError:
        if not hasattr(os, "O_PATH"):
            raise
        return os.open(where, os.O_PATH | _FOLDER | flags, dir_fd=handle)


def _require_regular(about: os.stat_result | None, path: Path) -> None:
    if about is None:
        raise FileNotFoundError(errno.ENOENT, "there is no such file", os.fspath(path))
    if not stat.S_ISREG(about.st_mode) or is_link(about):
        raise OSError(errno.EINVAL, LINK if is_link(about) else NO_FILE, os.fspath(path))


def _regular(handle: int, path: Path) -> int:
    """Return an open file that is regular; what was under its name before is no matter."""
    try:
        _require_regular(os.fstat(handle), path)
    except OSError:
        os.close(handle)
        raise
    return handle


def _holder(path: Path) -> Folder | None:
    """Return the innermost folder that is held and has a path in it."""
    inside = [folder for folder in _held if folder.path in path.parents]
    return max(inside, key=lambda folder: len(folder.path.parts), default=None)


@contextmanager
def folder_of(path: str | os.PathLike[str]) -> Iterator[tuple[Folder, str]]:
    """Give the open folder that a path lies in, and its name there."""
    whole = Path(path).absolute()
    holder = _holder(whole)
    with Folder.at(whole.parent) if holder is None else _inside(holder, whole.parent) as folder:
        yield folder, whole.name


def shown(path: str | os.PathLike[str]) -> str:
    """Return what to call a file in messages: where it will be, while its folder is hidden."""
    whole = Path(path).absolute()
    holder = _holder(whole)
    if holder is None or holder.shown == holder.path:
        return os.fspath(path)
    return str(holder.shown / whole.relative_to(holder.path))


def _inside(holder: Folder, path: Path) -> Folder:
    """Open a folder in one that is held, or that one once more."""
    copy = None if holder.handle is None else os.dup(holder.handle)
    found = Folder(holder.path, copy)
    for name in path.relative_to(holder.path).parts:
        with found as outer:
            found = outer.folder(name)
    return found


def open_file(path: str | os.PathLike[str], flags: int = os.O_RDONLY) -> BinaryIO:
    """Open a regular file that a user names, or one in a folder that is held."""
    whole = Path(path).absolute()
    if _holder(whole) is not None:
        with folder_of(whole) as (folder, name):
            return _stream(folder.open_regular(name, flags), flags)
    _require_regular(os.stat(path), whole)
    handle = os.open(path, flags | _NO_WAIT | _CLOSED | _BINARY)
    return _stream(_regular(handle, whole), flags)


def _stream(handle: int, flags: int) -> BinaryIO:
    return os.fdopen(handle, "r+b") if flags & os.O_RDWR else os.fdopen(handle, "rb")


def read_file(path: str | os.PathLike[str]) -> bytes:
    """Return what a regular file holds; see `open_file`."""
    with open_file(path) as stream:
        return stream.read()


def make_folders(path: Path, made: list[Path], below: Path | None = None) -> None:
    """Make a folder and those around it; which are new goes to `made`, the outermost first.

    From `below` on no link is followed.
    """
    if below is not None and path != below:
        make_folders(path.parent, made, below)
        with Folder.at(path.parent, below) as around:
            if around.about(path.name) is None:
                around.make(path.name)
                made.append(path)
        return
    missing = []
    while not path.exists():
        missing.append(path)
        path = path.parent
    for new in reversed(missing):
        with suppress(FileExistsError):  # another run makes it as well
            os.mkdir(new)
            made.append(new)


def remove_if_empty(path: Path) -> None:
    """Remove a folder that nobody has put anything into."""
    with suppress(OSError):
        os.rmdir(path)


def set_aside(handle: int, size: int) -> None:
    """Give an open file a size, and its place on the disk where the file system can."""
    os.ftruncate(handle, size)
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(handle, 0, size)
        except OSError as error:
            if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL):
                raise


def take_lock(handle: int) -> bool | None:
    """Lock an open file without waiting; False when another has it, None where there are no locks.

    The system gives it back when the process ends in whatever way. Folders can be locked as well,
    but on Windows.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (PermissionError, BlockingIOError):  # the first is Windows
        return False
    except OSError:
        return None
    return True


def steps_to(path: Path) -> Iterator[tuple[Path, bool]]:
    """Yield every folder that is looked into to find one, and itself, and every link (True)."""
    place, waiting = Path(path.anchor), list(path.parts[1:])
    for _ in range(LONGEST_WAY):
        if not waiting:
            break
        yield place, False
        after = place / waiting.pop(0)
        if after.is_symlink():
            yield after, True
            target = after.readlink()
            place = Path(target.anchor) if target.is_absolute() else place
            waiting = [*target.parts[bool(target.anchor) :], *waiting]
        else:
            place = place.parent if after.name == ".." else after
    yield place, False


def refuse_links_of_others(path: Path) -> None:
    """Refuse a way that leads along a link of somebody else, in a folder where others may write.

    That is what Linux has for `/tmp` (protected_symlinks), here on all systems and for all folders.

    Raises
    ------
    PermissionError
    """
    if not hasattr(os, "geteuid"):
        return
    for place, link in steps_to(path.absolute()):
        if link:
            around, about = place.parent.stat(), place.lstat()
            known = about.st_uid in (0, os.geteuid(), around.st_uid)
            if around.st_mode & stat.S_IWOTH and not known:
                raise PermissionError(errno.EACCES, OTHERS_LINK.format(place))
