"""What a kind of cases is, and which there are."""

from __future__ import annotations

import importlib
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

KINDS = {
    "files": "fuzz.mutated_files",
    "shapes": "fuzz.shape_operations",
    "defaults": "fuzz.defaults",
    "kills": "fuzz.kills",
    "cache": "fuzz.damaged_cache",
    "disk": "fuzz.full_disk",
    "calls": "fuzz.faulty_disk",
    "attackers": "fuzz.attackers",
}
"""Modules with a `KIND`; `fuzz.faults` is one more, whose faults test the runner itself."""

GIGABYTE = 1 << 30


class Fault(Exception):  # noqa: N818 - a finding, not an error of the fuzzer
    """What a case found to be wrong: a title that all findings of its class share, and details.

    `again`: it depends on the time that the machine took, so the case is run once more first.
    """

    def __init__(self, title: str, details: str = "", *, again: bool = False) -> None:
        super().__init__(f"{title}\n{details}")
        self.title, self.details, self.again = title, details, again


@dataclass(frozen=True)
class Case:
    """One case: all that is random in it comes from `rng`.

    Attributes
    ----------
    rng : random.Random
        Seeded by seed, kind and number.
    number : int
    folder : Path
        Empty; what is in it when the case fails is kept with the finding.
    home : Path
        Shared by the cases of the kind, for what is dear to make.
    """

    rng: random.Random
    number: int
    folder: Path
    home: Path


@dataclass(frozen=True)
class Kind:
    """A kind of cases.

    Attributes
    ----------
    run : callable
        Runs a case; raises a Fault, or anything else, when something is wrong.
    processor_seconds, wall_seconds : float
        A case that takes longer hangs.
    memory : int or None
        Bytes of address space of the process; None: no limit.
    share : float
        Of the minutes, relative to the other kinds.
    """

    run: Callable[[Case], None]
    processor_seconds: float = 60.0
    wall_seconds: float = 240.0
    memory: int | None = None
    share: float = 1.0


def load_kind(name: str) -> Kind:
    """Import the module of a kind."""
    module = importlib.import_module(KINDS.get(name, f"fuzz.{name}"))
    kind: Kind = module.KIND
    return kind


def make_case(seed: int, name: str, number: int, folder: Path, home: Path) -> Case:
    """Return the case that seed, kind and number say; the same on every machine."""
    return Case(random.Random(f"{seed}:{name}:{number}"), number, folder, home)
