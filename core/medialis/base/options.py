"""Options of algorithms: each is said once, and all else follows from it.

An algorithm has a frozen class of options. A field says name, type, unit, range, default, label and
help of one option; the checks, the Python signature, the command line, the hosts and the pages of
parameters are derived from it:

    @dataclass(frozen=True, kw_only=True)
    class SmoothOptions(Options):
        strength: float = number(0.7, "Strength", "Bends shorter than this are smoothed.", high=10)

    @algorithm(SmoothOptions)
    def smooth(cloud: MedialCloud, options: SmoothOptions, progress: Progress) -> MedialCloud:
        ...

    smooth(cloud, strength=0.5)              # keywords, completed by editors and known to mypy
    smooth.of(cloud, options, progress)      # with options of an operation, by their names

Units are the same everywhere: lengths are fractions of the bounding-box diagonal, angles degrees.
At the door a length may be text or a `Length` as well: "0.5%", "1mm", "0.2in", "3 units". Options
hold it as it was given until they meet the data (`Options.measured`): what it is as a fraction
follows from the diagonal of what is computed from, and for real lengths from its unit.

The default of some options is "auto": the algorithm chooses a number that suits the data
(`Options.with_auto_resolved`) and reports it. Every other value is used exactly as it was given,
also one that equals the number "auto" starts from.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from typing import Any, Generic, ParamSpec, Protocol, Self, TypeVar, cast, overload

import numpy as np

from medialis.base.errors import InvalidOptionError, no_option
from medialis.base.kept import kept
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.validation import as_choice, as_number, as_whole_number

METERS = {
    **{"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "dm": 0.1, "m": 1.0, "km": 1e3},
    **{"in": 0.0254, "ft": 0.3048},
}
"""Metres in each real unit."""

AUTO = "auto"
"""Value of an option for which the algorithm chooses a number that suits the data."""

SHARE, PERCENT, UNITS = "", "%", "units"
"""What else a length may be in: fractions and per cent of the diagonal, the numbers of a file."""

LENGTHS = frozenset(
    {"thickness", "radius", "importance", "edge_radius", "length", "y_length", "mean_radius"}
    | {"least_radius"}
    | {"straight_distance", "diagonal", "spacing", "value", "noise", "moved", "feature_radius"}
    | {"minimum", "maximum", "typical", "wall", "least", "most"}
    | {"rib_thickness", "wall_thickness", "checked_thickness", "largest_ball", "weld_length"}
    | {"distance", "largest_error", "mean_error", "surface_to_envelope", "envelope_to_surface"}
    | {"pieces_to_surface", "surface_to_pieces", "thickness_mean", "median_radius", "boundary"}
    | {"height", "breast_diameter"}
)
AREAS = frozenset({"area"})
VOLUMES = frozenset({"volume"})
POWERS = {1: "", 2: "²", 3: "³"}
"""What follows the unit of a length, an area, a volume."""
RADIANS = frozenset({"spoke_angle", "edge_angle", "fork_angle", "branch_angle"})
"""Names of values and attributes that have a unit, without _min, _median and _max."""

_WORDS = {
    **{"micron": "um", "micrometer": "um", "µm": "um", "μm": "um", "millimeter": "mm"},
    **{"centimeter": "cm", "decimeter": "dm", "meter": "m", "kilometer": "km"},
    **{"inch": "in", "inche": "in", "foot": "ft", "feet": "ft", "u": UNITS, "unit": UNITS},
}
_LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\D*?)\s*")
_KNOWN = ", ".join(METERS)
_INSIDE = ("surface", "cloud", "sheets", "curve", "importance", "paths")


def unit_name(text: str) -> str | None:
    """Return the short name of a real unit, or None for what is none.

    Examples
    --------
    >>> unit_name("Millimetres"), unit_name("in"), unit_name("furlong")
    ('mm', 'in', None)
    """
    word = text.strip()
    if word in METERS:
        return word
    word = word.lower().replace("metre", "meter").removesuffix("s")
    name = _WORDS.get(word, word)
    return name if name in METERS else None


def nearest_unit(text: str | None) -> str | None:
    """Return the unit that a file says, in words or as a multiple of another; None for none.

    Examples
    --------
    >>> nearest_unit("millimeters"), nearest_unit("0.0254 * meters"), nearest_unit("3 * feet")
    ('mm', 'in', None)
    """
    factor, _, word = (text or "").rpartition("*")
    unit = unit_name(word)
    if unit is None or not factor:
        return unit
    try:
        meters = float(factor) * METERS[unit]
    except ValueError:
        return None
    return next((u for u, m in METERS.items() if math.isclose(m, meters, rel_tol=1e-6)), None)


def as_unit(text: str | None) -> str | None:
    """Return the short name of the unit of a shape; None stays.

    Raises
    ------
    InvalidOptionError
        When it is no unit.
    """
    name = None if text is None else unit_name(text) if isinstance(text, str) else ""
    if text is not None and not name:
        raise InvalidOptionError(f"unit must be one of {_KNOWN}, got {text!r}.")
    return name


@dataclass(frozen=True, repr=False)
class Length:
    """A length with its unit, for any length option.

    Attributes
    ----------
    amount : float
    unit : str
        "mm", "in", "m" and so on; "%" of the bounding-box diagonal; "units" of the numbers of the
        shape; "" for a fraction of the diagonal.

    Raises
    ------
    InvalidOptionError
        When the unit is unknown or the amount is no finite number.

    Examples
    --------
    >>> import medialis
    >>> medialis.Length(1, "mm"), medialis.Length(0.5, "%")
    (1 mm, 0.5 %)
    """

    amount: float
    unit: str

    def __post_init__(self) -> None:
        unit = self.unit if self.unit in (SHARE, PERCENT, UNITS) else unit_name(self.unit)
        unit = UNITS if unit is None and _WORDS.get(self.unit.lower()) == UNITS else unit
        if unit is None:
            raise InvalidOptionError(
                f"A length is in %, units (of the file), or one of {_KNOWN}, got {self.unit!r}."
            )
        if isinstance(self.amount, bool | str) or not math.isfinite(self.amount):
            raise InvalidOptionError(f"A length must be a finite number, got {self.amount!r}.")
        object.__setattr__(self, "amount", float(self.amount))
        object.__setattr__(self, "unit", unit)

    def __str__(self) -> str:
        return f"{self.amount!r}".removesuffix(".0") + (f" {self.unit}" if self.unit else "")

    __repr__ = __str__

    @property
    def share(self) -> float | None:
        """The fraction of the diagonal, where that needs no shape."""
        return {SHARE: self.amount, PERCENT: self.amount / 100.0}.get(self.unit)


def with_unit(value: float, unit: str | None, power: int = 1) -> str:
    """Return a number for people with its unit, where that is known.

    Examples
    --------
    >>> with_unit(0.5, "mm"), with_unit(1234567.8, "mm", 2), with_unit(2.0, None)
    ('0.5 mm', '1,234,568 mm²', '2')
    >>> with_unit(3.9, "m", 3)
    '3.9 m³'
    """
    text = f"{value:,.0f}" if 1e3 <= abs(value) < 1e12 else f"{value:.4g}"
    return text + (f" {unit}{POWERS[power]}" if unit else "")


def mm(amount: float) -> Any:
    """Return a length in millimetres, for any length option.

    See Also
    --------
    inch, percent : other units.
    Length : any unit.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.make_shape([[0, 0, 0], [30, 0, 0], [0, 40, 0]], [[0, 1, 2]], unit="mm")
    >>> medialis.refine(shape, longest_edge=medialis.mm(10)).point_count > 3
    True
    """
    return Length(amount, "mm")


def inch(amount: float) -> Any:
    """Return a length in inches, for any length option.

    See Also
    --------
    mm, percent : other units.

    Examples
    --------
    >>> import medialis
    >>> medialis.inch(0.2)
    0.2 in
    """
    return Length(amount, "in")


def percent(amount: float) -> Any:
    """Return a length in per cent of the bounding-box diagonal, for any length option.

    See Also
    --------
    mm, inch : real lengths.

    Examples
    --------
    >>> import medialis
    >>> medialis.percent(0.5)
    0.5 %
    """
    return Length(amount, PERCENT)


def as_length(value: Any, name: str, low: float, high: float) -> Length:
    """Return text or a `Length` as a length whose share, where it is known, is within low..high.

    Raises
    ------
    InvalidOptionError
        For other text, or out of the range; a bare number that can hardly be meant as a fraction
        gets a sentence that shows what else it could be.
    """
    given = value
    if isinstance(value, str):
        match = _LENGTH.fullmatch(value)
        if match is None:
            raise InvalidOptionError(
                f"{name} must be a length, such as 0.5% of the size, 1mm, 0.2in, or 3units of the "
                f"file, got {value!r}."
            )
        given = Length(float(match[1]), match[2])
    length: Length = given
    share = length.share
    bare = isinstance(value, str) and length.unit == SHARE
    if bare and share is not None and share > 0 and (share >= 1 or not low <= share <= high):
        word = value.strip()
        raise InvalidOptionError(
            f"{name} {word} would be {100 * share:g} % of the size, but {100 * low:g} % to "
            f"{100 * high:g} % are possible. Write {word}mm, {word}units (of the shape) or {word}%."
        )
    if length.amount < 0 or (share is not None and not low <= share <= high):
        raise InvalidOptionError(
            f"{name} must be {100 * low:g} % to {100 * high:g} % of the size, got {given}; write a "
            "share as 0.5%, a length as 1mm."
        )
    return length


@dataclass(frozen=True)
class Size:
    """What lengths are measured by: the bounding-box diagonal, and the unit of its number."""

    diagonal: float
    unit: str | None = None

    @classmethod
    def of(cls, data: Any) -> Size:
        """Return the size of a shape, of what was computed from one, or of points."""
        part, diagonal, unit = data, None, None
        while part is not None and unit is None:
            own = getattr(part, "diagonal", None)  # arrays have another thing of this name
            diagonal = own if diagonal is None and isinstance(own, float) else diagonal
            unit = getattr(part, "unit", None)
            inside = (getattr(part, name, None) for name in _INSIDE)
            part = next((inner for inner in inside if inner is not None), None)
        if diagonal is not None:
            return cls(diagonal, unit)
        points = np.asarray(data, np.float64)
        return cls(float(math.hypot(*np.ptp(points, axis=0))), unit)

    def text(self, length: float) -> str:
        """Return a length of the shape's own numbers with its unit."""
        return with_unit(length, self.unit)

    def fraction(self, length: Length, name: str) -> float:
        """Return a length as a fraction of the diagonal.

        Raises
        ------
        InvalidOptionError
            When it is a real one and the unit of the shape is unknown.
        """
        if length.share is not None:
            return length.share
        own = length.amount
        if length.unit != UNITS:
            if self.unit is None:
                raise InvalidOptionError(
                    f"{name} is {length}, but the unit of the shape is not known: say --unit mm "
                    "(in Python unit='mm'), or give a share such as 0.5%."
                )
            own *= METERS[length.unit] / METERS[self.unit]
        return own / self.diagonal if self.diagonal > 0.0 else 0.0

    def sentence(self, length: Length, name: str) -> str:
        """Return what a given length is, in all three spellings."""
        fraction = self.fraction(length, name)
        own = self.text(fraction * self.diagonal)
        share = f"{with_unit(100 * fraction, PERCENT)} of the diagonal {self.text(self.diagonal)}"
        if length.share is not None:
            return f"{name.replace('_', ' ')}: {share} = {own}."
        first = "" if length.unit == self.unit else f" = {own}"
        return f"{name.replace('_', ' ')}: {length}{first} = {share}."


class Kind(StrEnum):
    """Type of an option; hosts choose the widget by it."""

    FLOAT = "float"
    INT = "int"
    BOOL = "bool"
    CHOICE = "choice"
    LENGTH = "length"
    """Fraction of the bounding-box diagonal; hosts show per cent."""
    ANGLE = "angle"
    """Degrees."""
    FILE = "file"
    """Path of a file to read; empty: none."""


NUMBERS = (Kind.FLOAT, Kind.INT, Kind.LENGTH, Kind.ANGLE)


@dataclass(frozen=True)
class Parameter:
    """What is known of one option.

    Attributes
    ----------
    name : str
        Python keyword; the command line writes it with dashes.
    kind : Kind
    default : float, int, bool or str
    label, help : str
        For people; the help is one or two sentences.
    low, high : float
        Range of numbers, both included.
    choices, choice_help : tuple of str
        Values of a CHOICE, and one sentence on each.
    advanced : bool
        Hosts fold it away.
    selection : str
        What hosts may write of selected vertices into a FILE: "pair" (two, in one line),
        "each" (one a line), or nothing.
    layer : str
        Layer of the result that hosts may write into a FILE as their user has edited it.
    bones : bool
        Hosts may write the bones of an armature of their user into a FILE.
    auto : float or None
        Of a number that may be "auto": the number from which the algorithm starts when it chooses
        one. Hosts without text in number fields show it beside a switch. None: not automatic.
    """

    name: str
    kind: Kind
    default: Any
    label: str
    help: str
    low: float = 0.0
    high: float = 1.0
    choices: tuple[str, ...] = ()
    choice_help: tuple[str, ...] = ()
    advanced: bool = False
    selection: str = ""
    layer: str = ""
    bones: bool = False
    auto: float | None = None

    @property
    def full_help(self) -> str:
        """The help, then each choice with its sentence."""
        told = zip(self.choices, self.choice_help, strict=False)
        return " ".join([self.help, *(f"{word}: {sentence}" for word, sentence in told)])

    def type_text(self) -> str:
        """Return type and default as docstrings tell them."""
        if self.kind is Kind.CHOICE:
            return "{" + ", ".join(f'"{word}"' for word in self.choices) + "}"
        names = {
            Kind.LENGTH: 'float (fraction of the diagonal) or text such as "1mm", "0.5%"',
            Kind.ANGLE: "float, degrees",
            Kind.FILE: "path",
        }
        automatic = "" if self.auto is None else f' or "{AUTO}"'
        return f"{names.get(self.kind, self.kind.value)}{automatic}, default {self.default!r}"

    def sentence(self) -> str:
        """Return help and range as docstrings tell them."""
        if self.kind in (Kind.CHOICE, Kind.BOOL, Kind.FILE):
            return self.full_help
        return f"{self.help} {self.low:g} to {self.high:g}."

    def check(self, value: Any) -> Any:
        """Return the value in its proper type.

        Raises
        ------
        InvalidOptionError
            When it is of another type or out of range.
        """
        if self.auto is not None and isinstance(value, str) and value.strip().lower() == AUTO:
            return AUTO
        if self.kind is Kind.CHOICE:
            return as_choice(value, self.name, self.choices)
        if self.kind is Kind.FILE:
            if not isinstance(value, str | os.PathLike):
                raise InvalidOptionError(f"{self.name} must be the path of a file, got {value!r}.")
            return os.fspath(value)
        if self.kind is Kind.BOOL:
            if not isinstance(value, bool):
                raise InvalidOptionError(f"{self.name} must be True or False, got {value!r}.")
            return value
        if self.kind is Kind.INT:
            return as_whole_number(value, self.name, low=int(self.low), high=int(self.high))
        if self.kind is Kind.LENGTH and isinstance(value, str | Length):
            return as_length(value, self.name, self.low, self.high)
        if self.kind is Kind.LENGTH and type(value) in (int, float) and value > self.high:
            return as_length(f"{value:g}", self.name, self.low, self.high)  # says what to write
        return as_number(value, self.name, low=self.low, high=self.high)


def _option(kind: Kind, default: Any, label: str, help: str, **about: Any) -> Any:
    known = Parameter("", kind, default, label, help, **about)
    return field(default=default, metadata={"parameter": known})


# Each declares an option by default, label, help and what else a `Parameter` has: a number without
# a unit, a whole one, a fraction of the bounding-box diagonal, degrees, and yes or no.
number = functools.partial(_option, Kind.FLOAT)
whole = functools.partial(_option, Kind.INT)
length = functools.partial(_option, Kind.LENGTH)
angle = functools.partial(_option, Kind.ANGLE, high=180.0)
flag = functools.partial(_option, Kind.BOOL)


def choice(default: str, label: str, help: str, choices: Mapping[str, str], **about: Any) -> Any:
    """Declare a choice between words, each with a sentence that says what it does."""
    words, sentences = tuple(choices), tuple(choices.values())
    about = {"choices": words, "choice_help": sentences, **about}
    return _option(Kind.CHOICE, default, label, help, **about)


def file(label: str, help: str, **about: Any) -> Any:
    """Declare the path of a file to read; empty: none."""
    return _option(Kind.FILE, "", label, help, **about)


def changed(options: type[Options], name: str, **changes: Any) -> Any:
    """Declare an option as another class does, with another default or help."""
    known = {p.name: p for p in options.parameters()}[name]
    new = replace(known, **changes)
    return field(default=new.default, metadata={"parameter": new})


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of an algorithm, checked; a subclass has a field for each.

    Hosts show the options that a class adds itself first, then those of its bases in their order.

    Attributes
    ----------
    progress : callable, optional
        Called with (fraction, text); returning False cancels. It changes no result and takes no
        part in comparing options.
    by_body : tuple of (str, tuple of float)
        Names of automatic lengths with a number for each group of bodies, as a fraction of the
        diagonal of that group, not of the whole: chosen by `settled`, never by a user.

    Raises
    ------
    InvalidOptionError
        When a value is of another type or out of range.
    """

    progress: Progress | ProgressCallback | None = field(default=None, repr=False, compare=False)
    by_body: tuple[tuple[str, tuple[float, ...]], ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        for parameter in self.parameters():
            checked = parameter.check(getattr(self, parameter.name))
            object.__setattr__(self, parameter.name, checked)

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """Return what is known of each option, in the order in which hosts show them."""
        return _parameters(cls)  # type: ignore[arg-type]

    @classmethod
    def taken_from(cls, other: Options, **more: Any) -> Self:
        """Return options with the values that `other` has of the same names, and `more`."""
        names = {p.name for p in cls.parameters()} & {p.name for p in other.parameters()}
        given = {"by_body": other.by_body, **{name: getattr(other, name) for name in names}}
        return cls(**{**given, **more})

    def measured(self, data: Any, progress: Progress) -> Self:
        """Return options whose lengths are fractions of the diagonal of `data`; tell those given.

        Raises
        ------
        InvalidOptionError
            When one is out of its range there, or real and the unit of the data is unknown.
        """
        given = [p for p in self.parameters() if isinstance(getattr(self, p.name), Length)]
        if not given:
            return self
        size = Size.of(data)
        fractions: dict[str, Any] = {}
        for parameter in given:
            length, name = getattr(self, parameter.name), parameter.name
            fraction = fractions[name] = size.fraction(length, name)
            sentence = size.sentence(length, name)
            if not parameter.low <= fraction <= parameter.high:
                limits = f"{100 * parameter.low:g} % to {100 * parameter.high:g} %"
                raise InvalidOptionError(f"{sentence} It must be {limits}.")
            told: dict[str, Any] = {"given": str(length), "fraction": fraction, "unit": size.unit}
            progress.note(sentence, "length", option=name, **told)
        return replace(self, **fractions)

    def auto_starts(self) -> dict[str, float]:
        """Return the options whose value is "auto", with the numbers from which they start."""
        every = ((p.name, p.auto) for p in self.parameters())
        return {n: start for n, start in every if start is not None and getattr(self, n) == AUTO}

    def with_auto_resolved(self, data: Any, progress: Progress) -> Self:
        """Replace "auto" by the numbers of `auto_values`, and report them.

        Other values never change.
        """
        starts = self.auto_starts()
        if not starts:
            return self
        numbers = self.auto_values(data, starts, progress)
        return self.with_auto_values(numbers, progress) if numbers else self

    def auto_values(
        self, data: Any, starts: Mapping[str, float], progress: Progress
    ) -> dict[str, float]:
        """Return numbers for automatic options that suit the data, by name.

        "auto" stays where none is returned: options without use for these data, and those that the
        algorithm chooses later (`with_auto_values`).
        """
        return {}

    def with_auto_values(self, numbers: Mapping[str, Any], progress: Progress) -> Self:
        """Replace "auto" by numbers, and report them in one sentence."""
        kinds = {p.name: p.kind for p in self.parameters()}
        words: dict[bool, list[str]] = {True: [], False: []}
        for name, value in numbers.items():
            length = kinds[name] is Kind.LENGTH
            number = f"{value:,}" if kinds[name] is Kind.INT else f"{value:.4g}"
            text = f"{100 * value:.4g} %" if length else number
            words[length].append(f"{name.replace('_', ' ')} {text}")
        told = ", ".join(words[True]) + (" of the diagonal" if words[True] else "")
        told = "; ".join(filter(None, [told, ", ".join(words[False])]))
        progress.note(f"Automatic: {told}.", "automatic", values=dict(numbers))
        return replace(self, **numbers)

    def unused_options(self, data: Any) -> frozenset[str]:
        """Return the names of options that do not matter for such data."""
        return frozenset()

    def values(self) -> dict[str, Any]:
        """Return all options by name."""
        return {p.name: getattr(self, p.name) for p in self.parameters()}


@functools.cache
def _parameters(options: type[Options]) -> tuple[Parameter, ...]:
    known = {f.name: f.metadata["parameter"] for f in fields(options) if f.metadata}
    own_first = (name for base in options.__mro__ for name in inspect.get_annotations(base))
    return tuple(
        replace(known[name], name=name) for name in dict.fromkeys(own_first) if name in known
    )


P = ParamSpec("P")
Input = TypeVar("Input")
Given = TypeVar("Given")
InputIn = TypeVar("InputIn", contravariant=True)
Chosen = TypeVar("Chosen", bound=Options)
Found = TypeVar("Found")
FoundOut = TypeVar("FoundOut", covariant=True)


class Algorithm(Protocol, Generic[InputIn, P, FoundOut]):
    """A function of one thing and of options, as `algorithm` makes it."""

    def __call__(self, data: InputIn, /, *args: P.args, **kwargs: P.kwargs) -> FoundOut:
        """Compute with options as keywords."""

    def of(self, data: InputIn, options: Options, progress: Progress) -> FoundOut:
        """Compute with those options of another class that have the same names."""


@overload
def algorithm(
    options: Callable[P, Chosen], *, keep: bool = True
) -> Callable[[Callable[[Input, Chosen, Progress], Found]], Algorithm[Input, P, Found]]: ...
@overload
def algorithm(
    options: Callable[P, Chosen],
    *,
    keep: bool = True,
    door: Callable[[Given, Progress], Any],
    prepare: Callable[[Any, Any, Progress], Input] | None = None,
) -> Callable[[Callable[[Input, Chosen, Progress], Found]], Algorithm[Given, P, Found]]: ...
def algorithm(
    options: Callable[P, Chosen], *, keep: bool = True, door: Any = None, prepare: Any = None
) -> Callable[[Callable[[Input, Chosen, Progress], Found]], Algorithm[Any, P, Found]]:
    """Make a public function of one that takes (data, options, progress).

    The signature has the fields of the options class as keywords, and the docstring says what they
    are: its own Parameters tell of the data alone. Results are kept with what they were computed
    from (see `medialis.base.kept`) unless `keep` is False, as for results that take no longer to
    compute than to look up. A `door` makes the data of anything else that stands for it, as a path
    does. Then lengths are measured and automatic options chosen; then `prepare` may compute what
    the algorithm works on, such as the balls of a shape.
    """
    chosen = cast(type[Chosen], options)

    def decorate(
        compute: Callable[[Input, Chosen, Progress], Found],
    ) -> Algorithm[Any, P, Found]:
        def of(data: Input, given: Options, progress: Progress) -> Found:
            own = given if type(given) is chosen else chosen.taken_from(given)
            if own.progress is not None:
                own = replace(own, progress=None)  # nothing that is kept holds a host's callback
            own = own.with_auto_resolved(data, progress)
            if prepare is not None:
                data = prepare(data, own, progress)

            def work() -> Found:
                return compute(data, own, progress)

            return kept(compute, data, own, work, progress) if keep else work()

        @functools.wraps(compute)
        def public(data: Input, /, *args: P.args, **kwargs: P.kwargs) -> Found:
            unknown = sorted(set(kwargs) - {f.name for f in fields(chosen)})
            if unknown:
                known = (p.name for p in chosen.parameters())
                raise TypeError(no_option(compute.__name__, unknown, known))
            given = options(*args, **kwargs)
            progress = Progress.of(given.progress)
            data = data if door is None else door(data, progress)
            if useless := sorted(set(kwargs) & given.unused_options(data)):
                raise InvalidOptionError(
                    f"{', '.join(useless)} cannot be given to {compute.__name__} with a "
                    f"{type(data).__name__}, which is computed already: give the shape instead."
                )
            return of(data, given.measured(data, progress), progress)

        public.__doc__ = _documented(inspect.getdoc(compute) or "", chosen)
        first = next(iter(inspect.signature(compute).parameters.values()))
        first = first.replace(kind=inspect.Parameter.POSITIONAL_ONLY)
        signature = inspect.signature(chosen)
        public.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=[first, *_in_order(signature, chosen)],
            return_annotation=inspect.signature(compute).return_annotation,
        )
        public.of = of  # type: ignore[attr-defined]
        return cast(Algorithm[Any, P, Found], public)

    return decorate


def _in_order(signature: inspect.Signature, options: type[Options]) -> list[inspect.Parameter]:
    """Parameters of a signature: more data, options as hosts show them, `progress` last."""
    names = [p.name for p in options.parameters()]
    data = [name for name in signature.parameters if name not in (*names, "progress")]
    return [signature.parameters[name] for name in (*data, *names, "progress")]


_INDENTED: Any = {"initial_indent": "    ", "subsequent_indent": "    "}


def _documented(text: str, options: type[Options]) -> str:
    """Return a docstring with the options behind its parameters and what they raise."""
    told = "\n".join(
        f"{p.name} : {p.type_text()}\n{textwrap.fill(p.sentence(), 96, **_INDENTED)}"
        for p in options.parameters()
    )
    about = (
        "progress : callable, optional\n    Called with (fraction, text); returning False cancels."
    )
    raised = "Cancelled\n    When `progress` asks for it."
    if told:
        raised = f"InvalidOptionError\n    When an option is out of its range.\n{raised}"
        about = f"{told}\n{about}"
    for section, more in (("Parameters", about), ("Raises", raised)):
        text = _extended(text, section, more)
    return text


def _extended(text: str, section: str, more: str) -> str:
    """Put more into a section of a numpydoc text; a new one comes where numpydoc wants it."""
    lines = text.split("\n")
    titles = [i for i in range(len(lines) - 1) if re.fullmatch("-{3,}", lines[i + 1])]
    names = {lines[i]: i for i in titles}
    after = [i for i in titles if i > names.get(section, -1)]
    if section not in names:  # only Raises may be missing
        later = ("Warns", "See Also", "Notes", "References", "Examples")
        after = [i for i in titles if lines[i] in later]
        more = f"{section}\n{'-' * len(section)}\n{more}"
    end = after[0] if after else len(lines) + 1
    head = "\n".join(lines[:end]).rstrip()
    gap = "\n" if section in names else "\n\n"
    rest = "\n".join(lines[end:])
    return f"{head}{gap}{more}\n" + (f"\n{rest}" if rest else "")
