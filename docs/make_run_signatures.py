"""Write the signature of `medialis.run` for each operation, for editors and type checkers.

python docs/make_run_signatures.py    after an option or an operation has changed
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import medialis
from medialis.base.options import Kind, Parameter
from medialis.operations.declaration import Operation

STUB = Path(medialis.__file__).parent / "show" / "run.pyi"
TYPES = {Kind.INT: "int", Kind.BOOL: "bool", Kind.FILE: "str", Kind.LENGTH: "float | str | Length"}
HEAD = """\
# Made by docs/make_run_signatures.py from the registry.
from typing import Any, Literal, overload

from medialis.base.device import Device
from medialis.base.options import Length
from medialis.base.progress import Progress, ProgressCallback
from medialis.shape.reading import ShapeLike
from medialis.show.result import Result

"""
LONGEST = 101
"""Characters of a line with its end."""

OVERLOAD = """\
@overload
def run(
    name: {name},
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
{options}) -> Result: ...
"""


def stub() -> str:
    """Return the whole stub: one overload an operation, and one for names that are not literal."""
    known = (_overload(chosen) for chosen in medialis.OPERATIONS)
    other = OVERLOAD.format(name="str", options="    **parameters: Any,\n")
    return "".join([HEAD, *known, other])


def _overload(chosen: Operation) -> str:
    options = map(_option, chosen.parameters)
    return OVERLOAD.format(name=f'Literal["{chosen.name}"]', options="".join(options))


def _option(parameter: Parameter) -> str:
    """Return a line, or three where the choices are many."""
    kind, rest = _type(parameter), f" = {_literal(parameter.default)},\n"
    line = f"    {parameter.name}: {kind}{rest}"
    if len(line) <= LONGEST:
        return line
    inside = kind.removeprefix("Literal[").removesuffix("]")
    return f"    {parameter.name}: Literal[\n        {inside}\n    ]{rest}"


def _type(parameter: Parameter) -> str:
    if parameter.choices:
        return f"Literal[{', '.join(map(_literal, parameter.choices))}]"
    known = TYPES.get(parameter.kind, "float")
    return known if parameter.auto is None or "str" in known else f'{known} | Literal["auto"]'


def _literal(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")
