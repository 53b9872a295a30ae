"""Choice of the device: the processor, or an NVIDIA GPU for the algorithms that support it.

`gpu.py` is imported only when a GPU is requested.
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
UNMEASURED = math.inf
"""Minimum size for the GPU with `auto`, for work that has not been measured on one."""

_chosen: ContextVar[Device | None] = ContextVar("medialis_device", default=None)


def device_choice() -> Device:
    """Return the chosen device: "auto", "cpu" or "gpu".

    The choice of `use_device` overrides `MEDIALIS_DEVICE`; the default is "auto".
    """
    return _chosen.get() or _checked(os.environ.get("MEDIALIS_DEVICE") or "auto", "MEDIALIS_DEVICE")


def _checked(name: str, what: str = "device") -> Device:
    for known in DEVICES:
        if name == known:
            return known
    raise InvalidOptionError(f"{what} must be one of {', '.join(DEVICES)}, got {name!r}.")


@contextmanager
def use_device(name: Device | None) -> Iterator[None]:
    """Compute on a device inside the block: "cpu", "gpu" or "auto"; None keeps the choice.

    "gpu" uses the processor for everything that cannot run on the GPU; a message gives the reason.
    "auto" uses the GPU only for operations that were measured to be faster there: none so far.

    Raises
    ------
    InvalidOptionError
        When `name` is not a device.

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


def on_gpu(
    work: Callable[[Session], T], size: float, min_size: float, progress: Progress
) -> T | None:
    """Return the result of a function on the GPU, or None if the processor must compute it.

    Parameters
    ----------
    work : callable
        Called with a `Session`. The processor repeats all of the work when the GPU fails, so the
        function must not depend on partly written results.
    size : float
        Number of items.
    min_size : float
        Minimum number of items for the GPU with "auto".
    """
    choice = device_choice()
    if choice == "cpu" or (choice == "auto" and size < min_size):
        return None
    from medialis.base.gpu import opened_gpu

    try:
        with opened_gpu().session(progress.still) as session:
            return work(session)
    except GpuError as error:
        if choice == "gpu" and not any(one.code == "gpu_not_used" for one in progress.messages):
            progress.warn(f"The processor did what the GPU could not: {error}", "gpu_not_used")
        return None
