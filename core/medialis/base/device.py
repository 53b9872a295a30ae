"""Which device computes: the processor, or an NVIDIA GPU for the work that can run there.

Nothing here loads what a GPU needs (`gpu.py`) before somebody asks for one.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Literal, TypeVar, get_args

from medialis.base.errors import GpuError, InvalidOptionError
from medialis.base.progress import Progress

if TYPE_CHECKING:
    from medialis.base.gpu import Session

T = TypeVar("T")

Device = Literal["auto", "cpu", "gpu"]
DEVICES: tuple[Device, ...] = get_args(Device)
NEVER = math.inf
"""Size from which `auto` takes the GPU, where that has not been measured."""

_chosen: ContextVar[Device | None] = ContextVar("medialis_device", default=None)


def device_choice() -> Device:
    """Return which device computes now: "auto", "cpu" or "gpu".

    It is what `use_device` says, else `MEDIALIS_DEVICE`, else "auto".
    """
    return _chosen.get() or _checked(os.environ.get("MEDIALIS_DEVICE") or "auto", "MEDIALIS_DEVICE")


def _checked(name: str, what: str = "device") -> Device:
    for known in DEVICES:
        if name == known:
            return known
    raise InvalidOptionError(f"{what} must be one of {', '.join(DEVICES)}, got {name!r}.")


@contextmanager
def use_device(name: Device | None) -> Iterator[None]:
    """Compute on a device inside the block: "cpu", "gpu" or "auto"; None changes nothing.

    With "gpu", what cannot run there runs on the processor, and a message says why. "auto" takes
    the GPU where whole operations were measured to be faster; so far that is nowhere.

    Raises
    ------
    InvalidOptionError
        For another name.

    See Also
    --------
    thread_limit : how many threads of the processor are used.

    Examples
    --------
    >>> import medialis
    >>> with medialis.use_device("cpu"):
    ...     cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    """
    token = _chosen.set(_chosen.get() if name is None else _checked(name))
    try:
        yield
    finally:
        _chosen.reset(token)


def on_gpu(work: Callable[[Session], T], size: float, least: float, progress: Progress) -> T | None:
    """Return what a piece of work gives on the GPU; None where the processor is to do it.

    Parameters
    ----------
    work : callable
        Called with a `Session`. It must leave nothing half-written: when the GPU fails, the
        processor does all of it.
    size : float
        Items of the work.
    least : float
        Size from which "auto" takes the GPU.
    """
    choice = device_choice()
    if choice == "cpu" or (choice == "auto" and size < least):
        return None
    from medialis.base.gpu import opened_gpu

    try:
        with opened_gpu().session(progress.still) as session:
            return work(session)
    except GpuError as error:
        if choice == "gpu" and not any(one.code == "gpu_not_used" for one in progress.messages):
            progress.warn(f"The processor did what the GPU could not: {error}", "gpu_not_used")
        return None
