"""Folders of results: they appear whole or not at all, whatever happens and whoever else is there.

Strategy. Files are collected in a hidden folder beside the output, which its process locks as long
as it lives, and renamed into place at the end, under a lock of the output: what two runs write is
never mixed. A journal in the hidden folder tells what is moved where, so that what is cut off at
any step, by an error or a kill, is put back: at once, or by the next run. Everything is looked up
in open folders (`base/disk.py`): a link that somebody puts beside or into the output leads nowhere.
"""

from __future__ import annotations

import json
import os
import re
import stat
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

from medialis.base import disk
from medialis.base.disk import Folder
from medialis.base.errors import FileError, InvalidOptionError, MedialisError
from medialis.formats.files import absolute, reason

MANIFEST = "manifest.json"
"""Moved after all others, and an old one away before: where it is, all it lists belongs to it."""
LOCK = ".medialis-lock"
"""In each hidden folder, held as long as its process lives: what nobody holds was left behind. On
Windows, which locks no folders, in the output while files are moved."""
JOURNAL, ASIDE = ".medialis-moves", ".replaced"
"""In a hidden folder while files are moved: what goes where, and what was there."""

SECONDS_TO_MOVE, PAUSE = 60.0, 0.01
"""How long another run may take to move its files, and between two looks at it."""
TRIES = 50
"""Runs into the same folders that remove them again just then."""


class _Place:
    """Where an output is: the open folder around it and its name there, which is no link."""

    def __init__(
        self, path: Path, below: str | os.PathLike[str] | None, made: list[Path] | None = None
    ) -> None:
        target, top = absolute(path), None if below is None else absolute(below)
        if top is None:
            disk.refuse_links_of_others(target)
            if target.is_symlink() or target.name in ("", ".."):
                target = Path(os.path.realpath(target))
        self.path, self.name = target, target.name
        if made is not None:
            disk.make_folders(target.parent, made, top)
        self.around = Folder.at(target.parent, top)

    def __enter__(self) -> _Place:
        return self

    def __exit__(self, *error: object) -> None:
        self.around.close()

    def about(self) -> os.stat_result | None:
        """Return what is there; None: nothing."""
        return self.around.about(self.name or None)

    def open(self) -> Folder:
        """Open the output."""
        return self.around.folder(self.name) if self.name else Folder.at(self.path)

    def remove_left(self) -> None:
        """Remove what killed runs have left, and put back what they were moving."""
        ours = re.compile(re.escape(f".{self.name}-") + "[0-9a-f]{8}")
        with ExitStack() as stack:
            places = [self.around]
            with suppress(OSError):
                places.append(stack.enter_context(self.open()))
            for place in places:
                with suppress(OSError):  # not to be listed
                    for name in filter(ours.fullmatch, place.names()):
                        with suppress(OSError):
                            self._remove_unless_held(place, name)

    def _remove_unless_held(self, place: Folder, name: str) -> None:
        with place.folder(name) as hidden:
            if not hidden.is_own:
                return
            try:
                lock = hidden.open_regular(LOCK, os.O_RDWR)
            except OSError:  # its process was killed before it made the lock, or it is not ours
                place.remove_folder(name)
                return
            try:
                if disk.take_lock(lock) is not True:
                    return
                if hidden.is_file(JOURNAL) and self.about() is not None:
                    with _locked(self) as target:
                        _put_back(hidden, target)
                hidden.empty(keep=LOCK)
            finally:
                os.close(lock)
            hidden.empty()  # the mark that it is ours last: who is killed leaves no other one
        place.remove_folder(name)


def remove_left(path: str | os.PathLike[str], below: str | os.PathLike[str] | None = None) -> None:
    """Remove the hidden folders of killed runs that wrote to `path`; never one in use.

    What they were moving then is put back. Below `below`, no link is followed.
    """
    with suppress(OSError, ValueError), _Place(Path(path), below) as place:
        place.remove_left()


@contextmanager
def _locked(place: _Place, made: list[Path] | None = None) -> Iterator[Folder]:
    """Give the output, which no other run moves files into meanwhile; `made`: make it if missing.

    Raises
    ------
    FileError
        When another run does not end.
    """
    end = time.monotonic() + SECONDS_TO_MOVE
    while True:
        if place.about() is None and made is not None:
            with suppress(FileExistsError):
                place.around.make(place.name)
                made.append(place.path)
        with place.open() as target, ExitStack() as stack:
            if _take(target, stack) and (not place.name or target.is_same(place.about())):
                yield target
                return
        if time.monotonic() > end:
            raise FileError(
                f"Another run is writing to {place.path} and does not end; name another folder."
            )
        time.sleep(PAUSE)


def _take(target: Folder, stack: ExitStack) -> bool:
    """Lock an open folder until it is closed; True as well where there are no locks."""
    if target.handle is not None:
        return disk.take_lock(target.handle) is not False
    lock = target.open_regular(LOCK, os.O_RDWR | os.O_CREAT)

    def give_back() -> None:
        os.close(lock)
        with suppress(OSError):  # another one waits
            target.remove(LOCK)

    stack.callback(give_back)
    return disk.take_lock(lock) is not False


@contextmanager
def _parent(folder: Folder, name: str, *, make: bool = False) -> Iterator[tuple[Folder, str]]:
    """Give the open folder of a name with / in it, and the last name; `make` what is missing."""
    *outer, last = PurePosixPath(name).parts
    with ExitStack() as stack:
        for part in outer:
            if make and folder.about(part) is None:
                folder.make(part)
            folder = stack.enter_context(folder.folder(part))
        yield folder, last


def _move(here: Folder, name: str, there: Folder, new: str) -> None:
    with _parent(here, name) as (source, old), _parent(there, new, make=True) as (place, last):
        source.move(old, place, last)


def _about(folder: Folder, name: str) -> os.stat_result | None:
    """Return what a name with / in it stands for; None: nothing."""
    try:
        with _parent(folder, name) as (place, last):
            return place.about(last)
    except FileNotFoundError:
        return None


def _put_back(hidden: Folder, target: Folder) -> None:
    """Undo the moves of a journal, as far as they were made; the old manifest comes last."""
    try:
        journal = json.loads(hidden.read(JOURNAL))
    except ValueError:  # killed while it was written, before the first move
        journal = {"files": [], "aside": [], "folders": []}
    for name, number in reversed(journal["files"]):
        there = _about(target, name)
        if there is not None and there.st_ino == number and _about(hidden, name) is None:
            _move(target, name, hidden, name)
    for number, name in reversed(list(enumerate(journal["aside"]))):
        if _about(hidden, f"{ASIDE}/{number}") is not None:
            _move(hidden, f"{ASIDE}/{number}", target, name)
    for name in reversed(journal["folders"]):
        with suppress(OSError), _parent(target, name) as (place, last):
            place.remove_folder(last)
    hidden.remove(JOURNAL)


class OutputFolder:
    """Collect files in a hidden folder and move them to `path` when the block ends well.

    The hidden folder lies beside `path` (inside it where only that is possible: another disk is
    mounted there, or the folder around it may not be written), so moving is renaming. When the
    block ends with any exception, or moving fails, everything is as it was before. What a killed
    run has left is removed by the next one, and what it was moving is put back.

    Parameters
    ----------
    path : path
        The folder; made with its parents when missing. Files in it that are not written again stay.
    replaced : callable, optional
        Called with the open `Folder` just before files are moved, while no other run moves any:
        returns names of files that go in any case, those of an older result, or raises.
    below : path, optional
        A folder around it that the user named: from there on no link is followed. Without it `path`
        is followed, but along no link that somebody else has put where others may write.

    Raises
    ------
    FileError
        On entering: `path` is a file or cannot be made or written. On leaving: moving failed.

    Examples
    --------
    >>> import tempfile
    >>> out = Path(tempfile.mkdtemp()) / "results"
    >>> with OutputFolder(out) as folder:
    ...     _ = folder.file("note.txt").write_text("done")
    >>> (out / "note.txt").read_text()
    'done'
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        replaced: Callable[[Folder], Iterable[str]] | None = None,
        below: str | os.PathLike[str] | None = None,
    ) -> None:
        self.path, self._replaced, self._below = Path(path), replaced, below
        self._place: _Place | None = None
        self._hidden: Folder | None = None
        self._beside: Folder | None = None
        self._stack, self._lock = ExitStack(), ExitStack()
        self._made: list[Path] = []

    def __enter__(self) -> OutputFolder:
        with self._told():
            for _ in range(TRIES):
                try:
                    self._open()
                    return self
                except FileNotFoundError:  # another run removed a folder that it had made
                    self._clean()
                except BaseException:
                    self._clean()
                    raise
            raise FileError(f"Cannot write results to {self.path}: it is removed again and again.")

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Say in one sentence what goes wrong."""
        try:
            yield
        except MedialisError:
            raise
        except (OSError, ValueError) as error:
            name = getattr(error, "filename", None)
            plain = isinstance(name, str) and not name.startswith(".") and os.sep not in name
            file = f" ({name})" if plain and name != self.path.name else ""
            what = f"Cannot write results to {self.path}{file}: {reason(error)}."
            raise FileError(what) from None

    def _open(self) -> None:
        target = absolute(self.path)
        if target.exists() and not target.is_dir():
            raise FileError(f"Cannot write results to {self.path}: it is a file; name a folder.")
        self._stack = ExitStack()
        place = self._place = self._stack.enter_context(_Place(target, self._below, self._made))
        about = place.about()
        beside = place.around
        if about is not None:
            inside = self._stack.enter_context(place.open())
            if not os.access(inside.path, os.W_OK | os.X_OK):
                raise PermissionError(13, "permission denied")
            around = beside.about()
            apart = around is None or about.st_dev != around.st_dev or not place.name
            if apart or not os.access(beside.path, os.W_OK | os.X_OK):
                beside = inside
        place.remove_left()
        while not self._hide(beside, f".{place.name}-{os.urandom(4).hex()}"):
            pass

    def _hide(self, beside: Folder, name: str) -> bool:
        """Make the hidden folder and hold its lock; False when another run removed it meanwhile."""
        try:
            beside.make(name, 0o700)
        except FileExistsError:
            return False
        with ExitStack() as stack:
            try:
                hidden = stack.enter_context(beside.folder(name))
                lock = hidden.create(LOCK, 0o600)
            except FileNotFoundError:
                return False
            stack.callback(os.close, lock)
            there = hidden.is_same(beside.about(name)) and hidden.is_file(LOCK)
            if disk.take_lock(lock) is False or not there:
                return False
            hidden.shown = self.path
            self._hidden, self._beside = stack.enter_context(hidden.held()), beside
            self._lock = stack.pop_all()
        return True

    def file(self, name: str) -> Path:
        """Return where to write the file `name` (such as "skeleton.ply" or "sheets/3.ply").

        Raises
        ------
        InvalidOptionError
            When the name leaves the folder, or outside of the `with` block.
        """
        if self._hidden is None:
            raise InvalidOptionError("OutputFolder.file works only inside its `with` block.")
        relative = Path(name)
        if relative.is_absolute() or ".." in relative.parts or not relative.name:
            raise InvalidOptionError(f"a result file must lie inside its folder, got {name!r}.")
        with self._told(), _parent(self._hidden, relative.as_posix(), make=True):
            return self._hidden.path / relative

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        with self._told():
            try:
                if kind is None:
                    self._move()
                    self._made = []
            finally:
                self._clean()

    def _move(self) -> None:
        """Rename all files into place; put everything back when one cannot be moved."""
        hidden, place = self._hidden, self._place
        if hidden is None or place is None:
            return
        with _locked(place, self._made) as target:
            replaced = [MANIFEST, *(self._replaced(target) if self._replaced else ())]
            journal = self._planned(hidden, target, list(dict.fromkeys(replaced)))
            try:
                with hidden.new(JOURNAL) as stream:
                    stream.write(json.dumps(journal).encode("ascii"))
                for number, name in enumerate(journal["aside"]):
                    _move(target, name, hidden, f"{ASIDE}/{number}")
                for name, _ in journal["files"]:
                    _move(hidden, name, target, name)
                hidden.remove(JOURNAL)  # from here on it is done
            except BaseException:
                self._undo(hidden, target)
                raise

    def _planned(self, hidden: Folder, target: Folder, replaced: list[str]) -> dict[str, Any]:
        """Return what is moved: files in, with their numbers on the disk; names aside; folders.

        An old manifest goes first and a new one comes last: a kill between moves leaves none.
        """
        names = sorted(set(hidden.files()) - {LOCK}, key=lambda name: (name == MANIFEST, name))
        files, aside, folders = [], [], []
        for name in replaced:
            gone = name == MANIFEST and target.about(name) is not None
            if gone or (name not in names and target.is_file(name)):
                aside.append(name)
        for name in names:
            there, about = _about(target, name), _about(hidden, name)
            if there is not None and stat.S_ISDIR(there.st_mode) and not disk.is_link(there):
                raise FileError(f"Cannot write results to {self.path}: {name} is a folder there.")
            if there is not None and name != MANIFEST:
                aside.append(name)
            files.append((name, about.st_ino if about else 0))
            outer = map(PurePosixPath.as_posix, reversed(PurePosixPath(name).parents[:-1]))
            folders += [one for one in outer if one not in folders and _about(target, one) is None]
        return {"files": files, "aside": aside, "folders": folders}

    def _undo(self, hidden: Folder, target: Folder) -> None:
        """Put everything back; where the disk does not let that be done, the next run tries it."""
        try:
            if hidden.is_file(JOURNAL):
                _put_back(hidden, target)
        except OSError as error:
            self._lock.close()
            self._hidden = None
            raise FileError(
                f"Cannot write results to {self.path}, nor put back what was there: "
                f"{reason(error)}. It is in {hidden.path}; the next run into the same folder puts "
                "it back."
            ) from None

    def _clean(self) -> None:
        hidden, self._hidden = self._hidden, None
        if hidden is not None and self._beside is not None:
            name = hidden.path.name
            with suppress(OSError):
                hidden.empty(keep=LOCK)
            self._lock.close()  # Windows removes no open file
            with suppress(OSError):
                with self._beside.folder(name) as left:
                    left.empty()
                self._beside.remove_folder(name)
        self._stack.close()
        for folder in reversed(self._made):
            disk.remove_if_empty(folder)
        self._made = []
