"""Make the machine code of all kernels ahead of time: one extension module for each feature.

    python core/kernel_library/build.py             # what has changed; `make kernels` does it
    python core/kernel_library/build.py --all       # anew
    python core/kernel_library/build.py skeleton    # these features only

It needs a C compiler, numba and numpy 2. Modules lie beside the kernels, `_made.*` in the folder of
each feature and `_dispatch.*` in `base/`, with a record, `base/made-*.json`: git ignores them, and
wheels have those of their Python. `medialis/base/jit.py` says when they are used.

What is compiled is derived: the kernels that other modules import, for the types in
`hosts/kernels.txt` (`benchmarks/record_kernels.py` writes it; a test fails when one is missing).
Each feature is compiled by a process of its own, by the module compiler that numba calls pycc: it
writes one object file with the code and a wrapper for each kernel, which is linked with numba's
runtime. Kernels that kernels call are inside. The code runs on every processor since 2009
(x86-64-v2); where it pays there is a second module, `_made_v3`, for those of 2013 (x86-64-v3).
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
CORE = HERE.parent
PACKAGE = CORE / "medialis"
WORK = CORE.parent / "build" / f"kernels-{sys.implementation.cache_tag}"
PROCESSORS = {"x86_64": "x86-64-v2", "amd64": "x86-64-v2"}
"""The baseline by machine; others get LLVM's `generic`."""
OLDEST_NUMPY = "NPY_1_23_API_VERSION"
"""The interface of numpy that modules are made for: Blender 4.2 has 1.24."""
FASTER = ("skeleton",)
"""Features with a module for x86-64-v3 besides: balls take a quarter less time, others the same."""

sys.path.insert(0, str(CORE))

# jit.py imports nothing but the standard library: this runs before anything is installed.
from medialis.base.jit import DISPATCH, MADE, MADE_V3, RECORD, code_of, stamp_of  # noqa: E402


def exported() -> dict[str, list[list[Any]]]:
    """Return the kernels that Python calls, each with the types that are listed for it."""
    called = set()
    for path in PACKAGE.rglob("*.py"):
        if path.name.endswith("kernels.py"):
            continue
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        modules: dict[str, set[str]] = {}
        for node in nodes:
            for alias in node.names if isinstance(node, ast.ImportFrom) and node.module else ():
                where = node.module.removeprefix("medialis.")
                called.add(f"{where}:{alias.name}")
                modules.setdefault(alias.asname or alias.name, set()).add(f"{where}.{alias.name}")
        for node in nodes:  # `kernels.fill(...)`
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                called |= {f"{one}:{node.attr}" for one in modules.get(node.value.id, ())}
    found: dict[str, list[list[Any]]] = {}
    text = (PACKAGE / "hosts" / "kernels.txt").read_text(encoding="ascii")
    for line in text.splitlines():
        name, _, words = line.split("|")
        if name in called and json.loads(words) not in found.setdefault(name, []):
            found[name].append(json.loads(words))
    return found


def one_of_each(variants: list[list[Any]]) -> list[list[Any]]:
    """Leave out what another one serves: code for a read-only array is that for a writable one."""
    by_code: dict[str, list[Any]] = {}
    for words in sorted(variants, key=lambda words: json.dumps(words).count('r"')):
        by_code[code_of(words)] = words  # the read-only one comes last: it takes both
    return list(by_code.values())


def compile_module(module: str, work: Path) -> None:
    """Write the object file of a module and the list of what it holds; in a process of its own."""
    feature, _, name = module.partition("/")
    import warnings

    from numba.core.errors import NumbaWarning

    warnings.simplefilter("ignore", NumbaWarning)
    from numba import typeof
    from numba.pycc import compiler

    from medialis.base.compiling import know
    from medialis.base.jit import kernel_class
    from medialis.hosts.compile_ahead import example, named

    know(kernel_class())
    count_without_locks()
    usual = compiler.Flags

    def without_the_lock() -> Any:
        flags = usual()
        flags.release_gil = True
        return flags

    compiler.Flags = without_the_lock
    entries, table = [], {}
    for kernel, variants in exported().items():
        if kernel.partition(".")[0] != feature:
            continue
        for words in one_of_each(variants):
            symbol = f"kernel{len(entries)}"
            types = tuple(typeof(example(word)) for word in words)
            signature = argparse.Namespace(args=types, return_type=None)  # all that is asked of one
            entries.append(compiler.ExportEntry(symbol, signature, named(kernel).py_func))
            table.setdefault(kernel, []).append([code_of(words), symbol])
    made = compiler.ModuleCompiler(entries, name, use_nrt=True, cpu_name=processor(name))
    made.external_init_function = "pycc_init_medialis"
    join = made._cull_exports
    made._cull_exports = lambda: with_counts_inlined(join())
    made.write_native_object(str(work / f"{feature}{name}.o"), wrap=True)
    (work / f"{feature}{name}.json").write_text(json.dumps(table), encoding="ascii")


def count_without_locks() -> None:
    """Let modules count the references to arrays as plain numbers.

    Numba's counts are safe between threads: a third of the time of geodesics. Here two threads see
    no count: each call wraps the arrays that it is given anew, and kernels run no threads.
    """
    from llvmlite import ir
    from numba.core.runtime import nrtdynmod

    make = nrtdynmod.create_nrt_module

    def counting(module: Any, op: str, ordering: str) -> Any:
        word = ir.IntType(nrtdynmod.config.MACHINE_BITS)
        function = ir.Function(module, ir.FunctionType(word, [word.as_pointer()]), f"nrt_{op}")
        builder = ir.IRBuilder(function.append_basic_block())
        (place,) = function.args
        value = getattr(builder, op)(builder.load(place), ir.Constant(word, 1))
        builder.store(value, place)
        builder.ret(value)
        return function

    def made(context: Any) -> Any:
        module, library = make(context)
        for function in module.functions:
            for block in function.blocks:
                kept = [x for x in block.instructions if not isinstance(x, ir.instructions.Fence)]
                block.instructions[:] = kept
        return module, library

    nrtdynmod._define_atomic_inc_dec, nrtdynmod.create_nrt_module = counting, made


def with_counts_inlined(library: Any) -> Any:
    """Put what counts references into the kernels, where numba has left any: a call costs as much.

    Only now: numba takes out counts that even out by the names of the calls, and finds none that
    are inlined before. Then each kernel that hands arrays to another one in its innermost loop
    counts there, and takes up to five times as long.
    """
    from llvmlite import binding

    text = str(library._final_module).replace("noinline", "inlinehint")
    library._final_module = binding.parse_assembly(text)
    library._optimize_final_module()
    return library


def processor(name: str) -> str:
    """Return the name that LLVM has for the least processor that a module has to run on."""
    least = PROCESSORS.get(platform.machine().lower(), "generic")
    return "x86-64-v3" if name == MADE_V3 else least


def modules_of(places: list[str]) -> list[str]:
    """Return the modules of features, as in ``skeleton/_made``."""
    faster = FASTER if processor(MADE) == "x86-64-v2" else ()
    return [
        f"{place}/{name}"
        for place in places
        for name in (MADE, *([MADE_V3] if place in faster else []))
    ]


def processors() -> int:
    """Return how many processes are run at a time."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Linker:
    """The C compiler of this Python, as setuptools finds it."""

    def __init__(self, work: Path) -> None:
        from distutils.ccompiler import new_compiler
        from distutils.sysconfig import customize_compiler

        import numba
        import numpy
        import setuptools  # noqa: F401 - brings distutils

        self._work = work
        self._compiler = new_compiler()
        customize_compiler(self._compiler)
        self._numba = Path(numba.__file__).parent
        include = sysconfig.get_path("include")
        self._include = [include, str(Path(include) / "internal"), numpy.get_include()]
        self._parts: list[str] = []

    def compile(self, *sources: Path) -> list[str]:
        """Compile C sources to object files."""
        unix = self._compiler.compiler_type == "unix"
        return self._compiler.compile(
            [os.path.relpath(source, self._work) for source in sources],
            output_dir="objects",
            macros=[
                ("PYCC_MODULE_NAME", "medialis"),
                ("PYCC_USE_NRT", "1"),
                ("NPY_TARGET_VERSION", OLDEST_NUMPY),
            ],
            include_dirs=self._include,
            extra_preargs=[
                "-O2",
                "-g0",
                "-fvisibility=hidden",
                "-ffunction-sections",
                "-fdata-sections",
                "-w",
            ]
            if unix
            else ["/O2"],
        )

    def link(self, feature: str, name: str, objects: list[str]) -> Path:
        """Link an extension module into its place, in one step."""
        file = f"{name}{sysconfig.get_config_var('EXT_SUFFIX')}"
        unix = self._compiler.compiler_type == "unix"
        strip = (
            ["-Wl,-S,-x,-dead_strip"]
            if sys.platform == "darwin"
            else ["-s", "-Wl,--gc-sections"]
            if unix
            else []
        )
        if name != DISPATCH:
            self._parts = self._parts or self.compile(
                self._numba / "pycc" / "modulemixin.c", self._numba / "core" / "runtime" / "nrt.cpp"
            )
            objects = [*objects, *self._parts]
        self._compiler.link_shared_object(
            objects,
            file,
            output_dir=feature,
            extra_postargs=strip,
            export_symbols=[f"PyInit_{name}"],
            libraries=["m"] if unix else [],
            library_dirs=[] if unix else [str(Path(sys.base_prefix) / "libs")],
        )
        target = PACKAGE / feature / file
        fresh = target.with_name(f".{file}.new")
        shutil.copyfile(self._work / feature / file, fresh)
        fresh.chmod(0o755)
        fresh.replace(target)
        return target


def can_link() -> str | None:
    """Say why extension modules cannot be made here; None when they can."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            from distutils.ccompiler import new_compiler
            from distutils.sysconfig import customize_compiler

            import setuptools  # noqa: F401 - brings distutils

            source = Path(folder) / "try.c"
            source.write_text("#include <Python.h>\nint nothing(void) { return 0; }\n")
            compiler = new_compiler()
            customize_compiler(compiler)
            include = [sysconfig.get_path("include")]
            compiler.compile([str(source)], output_dir=folder, include_dirs=include)
        except Exception as error:  # noqa: BLE001 - of any compiler
            return f"no C compiler for this Python works here ({error})"
    return None


def made_files() -> list[Path]:
    """Return the modules that were made for this Python, and their record."""
    known = json.loads(RECORD.read_text(encoding="ascii"))
    modules = [PACKAGE / one.partition("/")[0] / about["file"] for one, about in known.items()]
    return [*modules, RECORD]


def build(features: list[str], *, anew: bool = False, say: Any = print) -> int:
    """Make the modules of features that have changed; return how many were made."""
    clock = time.perf_counter()
    known = {} if anew or not RECORD.is_file() else json.loads(RECORD.read_text(encoding="ascii"))
    listed = exported()
    places = sorted({name.partition(".")[0] for name in listed})
    stamps = {place: stamp_of(place) for place in places}
    types = {p: {n: v for n, v in listed.items() if n.partition(".")[0] == p} for p in places}
    codes = {
        place: {name: [code_of(w) for w in one_of_each(v)] for name, v in of.items()}
        for place, of in types.items()
    }

    how = _digest(Path(__file__))

    def is_made(module: str) -> bool:
        place, about = module.partition("/")[0], known.get(module, {})
        made = {name: [code for code, _ in v] for name, v in about.get("kernels", {}).items()}
        there = about and (PACKAGE / place / about["file"]).is_file()
        same = there and about["stamp"] == stamps[place] and about.get("how") == how
        return bool(same and made == codes[place])

    waiting = [one for one in modules_of(features or places) if not is_made(one)]
    stamp = _digest(HERE / "dispatch.c")
    dispatch = known.get(f"base/{DISPATCH}", {})
    dispatch_is_made = (
        dispatch.get("stamp") == stamp and (PACKAGE / "base" / dispatch["file"]).is_file()
    )
    for gone in set(known) - {*modules_of(places), f"base/{DISPATCH}"}:  # no kernels any more
        (PACKAGE / gone.partition("/")[0] / known.pop(gone)["file"]).unlink(missing_ok=True)
        _write_record(known)
    if not waiting and dispatch_is_made:
        return 0
    WORK.mkdir(parents=True, exist_ok=True)
    os.chdir(WORK)
    linker = Linker(WORK)
    if not dispatch_is_made:
        path = linker.link("base", DISPATCH, linker.compile(HERE / "dispatch.c"))
        known[f"base/{DISPATCH}"] = {**_about(path), "stamp": stamp}
    # The largest first: the last one to end is then a small one.
    waiting.sort(key=lambda one: -sum(map(len, types[one.partition("/")[0]].values())))
    running: dict[str, subprocess.Popen[bytes]] = {}
    total, processes = len(waiting), processors()
    while waiting or running:
        while waiting and len(running) < processes:
            module = waiting.pop(0)
            running[module] = _start(module)
        time.sleep(0.05)
        for module in [module for module, one in running.items() if one.poll() is not None]:
            if running.pop(module).returncode:
                for other in running.values():
                    other.kill()
                raise SystemExit(f"The kernels of {module} could not be compiled.")
            place, _, name = module.partition("/")
            path = linker.link(place, name, [f"{place}{name}.o"])
            kernels = json.loads((WORK / f"{place}{name}.json").read_text(encoding="ascii"))
            made = {"stamp": stamps[place], "how": how, "kernels": kernels}
            known[module] = {**_about(path), **made}
            say(f"{module}: {len(kernels)} kernels, {path.stat().st_size / 1e6:.2f} MB")
            _write_record(known)
    _write_record(known)
    say(f"{total} modules in {time.perf_counter() - clock:.0f} s; {RECORD}")
    return total


def _start(module: str) -> subprocess.Popen[bytes]:
    """Compile in another process: numba is told the processor by its environment.

    What it keeps of kernels that others call is as this file has made it: kept by its content.
    """
    environment = {
        **os.environ,
        "NUMBA_CPU_NAME": processor(module.partition("/")[2]),
        "NUMBA_CPU_FEATURES": "",
        "MEDIALIS_CACHE_DIR": str(WORK / f"numba-{_digest(HERE / 'build.py')}"),
    }
    command = [sys.executable, str(HERE / "build.py"), "--object", module]
    return subprocess.Popen(command, env=environment)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _about(path: Path) -> dict[str, Any]:
    return {"file": path.name, "size": path.stat().st_size}


def _write_record(known: dict[str, Any]) -> None:
    fresh = RECORD.with_suffix(".new")
    fresh.write_text(json.dumps(known, indent=1, sort_keys=True), encoding="ascii")
    fresh.replace(RECORD)


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("features", nargs="*", help="folders of the core; all if none is given")
    parser.add_argument("--all", action="store_true", help="make them anew")
    parser.add_argument("--object", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.object:
        compile_module(options.object, WORK)
        return
    if reason := can_link():
        raise SystemExit(f"Kernels are not made ahead: {reason}. numba compiles them when needed.")
    build(options.features, anew=options.all)


if __name__ == "__main__":
    main()
