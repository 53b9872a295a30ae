"""List the kernels of each operation and their types, for `medialis.hosts.compile_ahead`.

    python benchmarks/record_kernels.py            # writes core/medialis/hosts/kernels.txt
    python benchmarks/record_kernels.py noted.txt  # adds what was noted in a run

A run with `MEDIALIS_KERNELS=note:noted.txt`, of the tests as well, notes kernels and types that
were not made ahead. Without a file it runs all operations on small shapes, `midsurface` on one with
walls: two minutes where kernels are compiled, as after the tests. What an operation calls is in
memory after it; the kernels that these call, and for which types, numba's type inference tells.
"""

import inspect
import json
import os
import sys
import warnings
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "core"))
os.environ["MEDIALIS_KERNELS"] = "numba"

import numpy as np  # noqa: E402
from numba import types  # noqa: E402
from numba.core import compiler, compiler_machinery, errors, typed_passes  # noqa: E402
from numba.np.numpy_support import as_dtype  # noqa: E402

import medialis  # noqa: E402
from medialis.base.jit import code_of, kernel_class  # noqa: E402
from medialis.base.kept import forget  # noqa: E402
from medialis.hosts.compile_ahead import named  # noqa: E402

LIST = ROOT / "core" / "medialis" / "hosts" / "kernels.txt"


@compiler_machinery.register_pass(mutates_CFG=False, analysis_only=True)
class _Stop(compiler_machinery.FunctionPass):
    """The end of a pipeline that infers types and compiles nothing."""

    _name = "stop_after_types"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        raise compiler._EarlyPipelineCompletion(compiler.compile_result(typing_error=None))


class _TypesOnly(compiler.CompilerBase):
    def define_pipelines(self):
        passes = compiler.DefaultPassBuilder.define_untyped_pipeline(self.state, "types only")
        passes.add_pass(typed_passes.NopythonTypeInference, "types")
        passes.add_pass(_Stop, "stop")
        passes.finalize()
        return [passes]


def word(numba_type):
    """Return a type as `compile_ahead.example` reads it.

    Raises
    ------
    NotImplementedError
        There is no word for it.
    """
    if isinstance(numba_type, types.BaseTuple):
        record = getattr(numba_type, "instance_class", None)
        return [name_of(record) if record else "", *map(word, numba_type.types)]
    layout = ""
    if isinstance(numba_type, types.Array):
        layout = f":{numba_type.ndim}{numba_type.layout}{'' if numba_type.mutable else 'r'}"
        numba_type = numba_type.dtype
    try:
        return np.dtype(as_dtype(numba_type)).str[1:] + layout
    except errors.NumbaError as error:
        raise NotImplementedError(numba_type) from error


def name_of(thing):
    """Return a kernel or the class of a record as the list writes it."""
    module = getattr(thing, "py_func", thing).__module__
    return f"{module.removeprefix('medialis.')}:{thing.__name__}"


def kernels():
    """Return all kernels of the modules that are loaded."""
    modules = [vars(m) for name, m in sys.modules.items() if name.startswith("medialis.")]
    every = [v for names in modules for v in names.values() if isinstance(v, kernel_class())]
    found = {id(v): v.dispatcher for v in every if v.dispatcher is not None}
    return sorted(found.values(), key=name_of)


def in_memory():
    """Return the kernels that are in memory, each with types of its arguments."""
    return [(kernel, arguments) for kernel in kernels() for arguments in kernel.signatures]


def clear_memory():
    """Let no kernel be in memory: it is found compiled when it is called."""
    for kernel in kernels():
        kernel._reset_overloads()


@cache
def callees(kernel, arguments):
    """Return the kernels that a kernel calls for some types, and their types."""
    clear_memory()
    usual = kernel._compiler.pipeline_class
    kernel._compiler.pipeline_class = _TypesOnly
    try:
        kernel._compiler._compile_core(arguments, None)
    finally:
        kernel._compiler.pipeline_class = usual
    return [called for called in in_memory() if called != (kernel, arguments)]


@cache
def height(kernel, arguments):
    """Return how many levels of kernels are below one."""
    return max((1 + height(*called) for called in callees(kernel, arguments)), default=0)


def shape_for(operation):
    """Return the shape that an operation runs on."""
    small = operation.sample == "creature"
    shape = medialis.organic_shape(56) if small else medialis.sample_shape(operation.sample)
    return medialis.make_shape(shape.points, shape.faces, repair=True)


def used_by(operation):
    """Return the kernels that an operation calls, and those that they call, with their types."""
    forget()
    clear_memory()
    result = medialis.run(operation.name, shape_for(operation))
    medialis.draw_result(result, width=320, height=240)  # as the command line does
    waiting, seen = in_memory(), set()
    while waiting:
        one = waiting.pop()
        if one not in seen:
            seen.add(one)
            waiting += callees(*one)
    return seen


def main():
    """Write the list: kernel, operations, and types as JSON; what others call comes first."""
    lines = {}
    for operation in medialis.OPERATIONS:
        for kernel, arguments in used_by(operation):
            try:
                words = json.dumps([word(one) for one in arguments], separators=(",", ":"))
            except NotImplementedError as error:
                print(f"{name_of(kernel)}: no word for {error}")
                continue
            place = height(kernel, arguments), name_of(kernel), words
            lines.setdefault(place, set()).add(operation.name)
    write(
        [
            f"{name}|{' '.join(sorted(operations))}|{words}"
            for (_, name, words), operations in sorted(lines.items())
        ]
    )


def write(lines):
    """Write the list; lines without an operation that are in it stay, behind the others."""
    known = {"||".join(line.split("|")[::2]) for line in lines}
    kept = [
        line for line in LIST.read_text("ascii").splitlines() if "||" in line and is_there(line)
    ]
    lines = [*lines, *sorted(line for line in kept if line not in known)]
    LIST.write_text("\n".join(lines) + "\n", encoding="ascii")
    print(f"{len(lines)} kernels in {LIST}")


def is_there(line):
    """Tell whether the kernel of a line is still there, with as many arguments."""
    name, _, words = line.split("|")
    try:
        wanted = inspect.signature(named(name).py_func).parameters
    except (ImportError, AttributeError):
        return False
    return len(wanted) == len(json.loads(words))


def add(path):
    """Add what a run noted to the list."""
    known = [line.split("|") for line in LIST.read_text("ascii").splitlines()]
    codes = {(name, code_of(json.loads(words))) for name, _, words in known}
    lines = ["|".join(parts) for parts in known if parts[1]]
    fresh = ["|".join(parts) for parts in known if not parts[1]]
    for line in filter(is_there, sorted(set(path.read_text("ascii").splitlines()))):
        name, _, words = line.split("|")
        if (name, code_of(json.loads(words))) not in codes:
            codes.add((name, code_of(json.loads(words))))
            fresh.append(line)
    LIST.write_text("\n".join([*lines, *sorted(fresh)]) + "\n", encoding="ascii")
    print(f"{len(fresh)} kernels without an operation in {LIST}")


if __name__ == "__main__":
    warnings.simplefilter("ignore", errors.NumbaWarning)
    add(Path(sys.argv[1])) if sys.argv[1:] else main()
