"""The error tree: every error that a user can cause is a `MedialisError` with one clear sentence.

The sentence says what was expected, what came, and what to do. A ball or a path that fails is data
(a status, a NaN), never an exception.
"""


class MedialisError(Exception):
    """Base of all errors that medialis raises on purpose."""


class InvalidShapeError(MedialisError, ValueError):
    """A shape, mesh, point cloud or file content cannot be used."""


class InvalidOptionError(MedialisError, ValueError):
    """An option has a value outside its range, or options contradict each other."""


class FileError(MedialisError, OSError):
    """A file cannot be read or written (missing, a directory, no permission, disk full)."""


class NotPassedError(MedialisError):
    """What was checked is not as it has to be: `Result.require` raises it."""


class Cancelled(MedialisError):  # noqa: N818 - an outcome that the user asked for, not a fault
    """The caller asked to stop; nothing half-made escapes."""
