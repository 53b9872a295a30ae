"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path
from types import TracebackType

from medialis.errors import FileError, InvalidOptionError
from medialis.files._files import reason

LAST = "manifest.json"
"""Moved after all others, and an old one away before: where it is, all it lists belongs to it."""


class OutputFolder:
    """Collect files in a hidden folder and move them to `path` when the block ends well.

    The hidden folder lies beside `path` (inside it where only that is possible: another disk is
    mounted there, or the folder around it may not be written), so moving is renaming. When the
    block ends with any exception, or moving fails, everything is as it was before.

    Parameters
    ----------
    path : path
        The folder; made with its parents when missing. Files in it that are not written again stay.

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

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._hidden: Path | None = None
        self._made: list[Path] = []

    def __enter__(self) -> OutputFolder:
        self._hidden, self._made = None, []
        target = self.path.absolute()
        try:
            if target.exists() and not target.is_dir():
                raise FileError(
                    f"Cannot write results to {self.path}: it is a file; name a folder."
                )
            self._make(target.parent)
            place = target.parent
            if target.exists():
                if not os.access(target, os.W_OK | os.X_OK):
                    raise PermissionError(13, "permission denied")
                apart = target.stat().st_dev != place.stat().st_dev or not target.name
                place = target if apart or not os.access(place, os.W_OK | os.X_OK) else place
            self._hidden = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=place))
        except BaseException as error:
            self._clean()
            if isinstance(error, FileError) or not isinstance(error, OSError | ValueError):
                raise
            raise FileError(f"Cannot write results to {self.path}: {reason(error)}.") from None
        return self

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
        result = self._hidden / relative
        result.parent.mkdir(parents=True, exist_ok=True)
        return result

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self._move()
                self._made = []
        except OSError as failure:
            if isinstance(failure, FileError):
                raise
            raise FileError(f"Cannot write results to {self.path}: {reason(failure)}.") from None
        finally:
            self._clean()

    def _make(self, folder: Path) -> None:
        """Make a folder and its parents, remembering which ones are new."""
        missing = []
        while not folder.exists():
            missing.append(folder)
            folder = folder.parent
        for new in reversed(missing):
            new.mkdir(exist_ok=True)
            self._made.append(new)

    def _move(self) -> None:
        """Rename all files into place; put everything back when one cannot be moved."""
        if self._hidden is None:
            return
        hidden, target = self._hidden, self.path.absolute()
        files = sorted(p for p in hidden.rglob("*") if not p.is_dir())
        files.sort(key=lambda p: p.name == LAST)
        blocked = [p for p in files if (target / p.relative_to(hidden)).is_dir()]
        if blocked:
            raise FileError(
                f"Cannot write results to {self.path}: {blocked[0].name} is a folder there."
            )
        backup = hidden / ".replaced"
        done: list[tuple[Path, Path | None]] = []
        try:
            if (target / LAST).exists():  # a kill between two moves must leave none that is whole
                backup.mkdir(exist_ok=True)
                (target / LAST).replace(backup / LAST)
            for number, source in enumerate(files):
                place = target / source.relative_to(hidden)
                self._make(place.parent)
                old = None
                if place.exists():
                    backup.mkdir(exist_ok=True)
                    old = backup / str(number)
                    place.replace(old)
                done.append((place, old))
                source.replace(place)
            self._make(target)
        except BaseException:
            for place, old in reversed(done):
                place.unlink(missing_ok=True)
                if old is not None:
                    old.replace(place)
            if (backup / LAST).exists():
                (backup / LAST).replace(target / LAST)
            raise

    def _clean(self) -> None:
        if self._hidden is not None:
            shutil.rmtree(self._hidden, ignore_errors=True)
            self._hidden = None
        for folder in reversed(self._made):
            try:
                folder.rmdir()
            except OSError:  # someone else has put something there meanwhile
                break
        self._made = []
