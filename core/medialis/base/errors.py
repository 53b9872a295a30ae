"""The error tree: every error that a user can cause is a `MedialisError` with one clear sentence.

The sentence says what was expected, what came, and what to do. A ball or a path that fails is data
(a status, a NaN), never an exception.
"""

from __future__ import annotations

from collections.abc import Iterable


class MedialisError(Exception):
    """Base of all errors that medialis raises on purpose."""


class InvalidShapeError(MedialisError, ValueError):
    """A shape, mesh, point cloud or file content cannot be used."""


class InvalidOptionError(MedialisError, ValueError):
    """An option has a value outside its range, or options contradict each other."""


class FileError(MedialisError, OSError):
    """A file cannot be read or written (missing, a directory, no permission, disk full)."""


class GpuError(MedialisError):
    """The GPU cannot be used; the processor computes instead."""


class NotPassedError(MedialisError):
    """What was checked is not as it has to be: `Result.require` raises it."""


class Cancelled(MedialisError):  # noqa: N818 - an outcome that the user asked for, not a fault
    """The caller asked to stop; nothing half-made escapes."""


def nearest(word: str, known: Iterable[str]) -> str:
    """Return a question that names the most similar known word, or nothing.

    Examples
    --------
    >>> nearest("thicknes", ["thickness", "parts"])
    '; did you mean thickness?'
    """
    import difflib  # nobody needs it whose words are right

    close = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else ""


def no_option(name: str, unknown: Iterable[str], known: Iterable[str]) -> str:
    """Return the sentence for options that something does not have.

    Examples
    --------
    >>> no_option("thickness", ["spot"], ["refine", "spots"])
    'thickness has no option spot; did you mean spots? It has refine, spots.'
    >>> no_option("thickness", ["unit"], ["refine", "spots"])
    'thickness has no option unit; it has refine, spots.'
    """
    wrong, there = list(unknown), list(known)
    near = "".join(nearest(word, there) for word in wrong)
    rest = f"{near} It" if near else "; it"
    return f"{name} has no option {', '.join(wrong)}{rest} has {', '.join(there)}."
