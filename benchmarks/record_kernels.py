"""List the kernels of each operation and their types, for `medialis.hosts.compile_ahead`.

    python benchmarks/record_kernels.py     # writes core/medialis/hosts/kernels.txt; some minutes

It runs all operations on a small shape with nothing compiled, then each alone; `midsurface` on one
with walls.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "core" / "medialis" / "hosts" / "kernels.txt"


def word(numba_type):
    """Return a type as `compile_ahead.example` reads it; None for what it has no word for."""
    import numpy as np
    from numba import types
    from numba.core.errors import NumbaError
    from numba.np.numpy_support import as_dtype

    layout = ""
    if isinstance(numba_type, types.Array):
        layout = f":{numba_type.ndim}{numba_type.layout}{'' if numba_type.mutable else 'r'}"
        numba_type = numba_type.dtype
    try:
        return np.dtype(as_dtype(numba_type)).str[1:] + layout
    except (NotImplementedError, NumbaError):
        return None


def name_of(dispatcher):
    """Return a kernel as the list writes it."""
    return f"{dispatcher.py_func.__module__.removeprefix('medialis.')}:{dispatcher.__name__}"


def callees(dispatcher):
    """Return the kernels that a kernel calls."""
    from numba.core.dispatcher import Dispatcher

    function = dispatcher.py_func
    called = (function.__globals__.get(name) for name in function.__code__.co_names)
    return [found for found in called if isinstance(found, Dispatcher)]


def height(dispatcher):
    """Return how many levels of kernels are below one."""
    return max((1 + height(found) for found in callees(dispatcher)), default=0)


def shape_for(operation):
    """Return the shape that an operation runs on."""
    import medialis

    sample = medialis.operation(operation).sample
    small = sample == "creature"
    shape = medialis.organic_shape(56) if small else medialis.sample_shape(sample)
    return medialis.make_shape(shape.points, shape.faces, repair=True)


def record_all():
    """Run all operations and print what is compiled: height, kernel, types."""
    from numba.core import event

    import medialis

    class Listener(event.Listener):
        def on_start(self, started):
            pass

        def on_end(self, ended):
            dispatcher = ended.data["dispatcher"]
            if not dispatcher.py_func.__module__.startswith("medialis."):
                return
            words = [word(one) for one in ended.data["args"]]
            if None not in words:
                print("KERNEL", height(dispatcher), name_of(dispatcher), *words, flush=True)

    with event.install_listener("numba:compile", Listener()):
        for operation in medialis.OPERATIONS:
            medialis.run(operation.name, shape_for(operation.name))


def record_one(operation):
    """Run one operation and print the kernels that it calls, and those that they call."""
    from numba.core.dispatcher import Dispatcher

    import medialis

    medialis.run(operation, shape_for(operation))
    modules = [m for name, m in sys.modules.items() if name.startswith("medialis.")]
    found = [v for m in modules for v in vars(m).values() if isinstance(v, Dispatcher)]
    waiting, seen = [one for one in found if one.signatures], set()
    while waiting:
        one = waiting.pop()
        if name_of(one) not in seen:
            seen.add(name_of(one))
            waiting += callees(one)
    print("USED", *sorted(seen))


def said(folder, *arguments):
    """Return what this script says in a process of its own, with its kernels in a folder."""
    environment = dict(os.environ, MEDIALIS_CACHE_DIR=folder, PYTHONPATH=str(ROOT / "core"))
    command = [sys.executable, __file__, *arguments]
    run = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return [line.split()[1:] for line in run.stdout.splitlines() if line[:4] in ("KERN", "USED")]


def main():
    """Write the list."""
    from medialis import OPERATIONS

    with tempfile.TemporaryDirectory() as folder:
        kernels = said(folder, "all")
        used = {o.name: set(said(folder, o.name)[0]) for o in OPERATIONS}
    lines = {}
    for _, name, *types in sorted(kernels, key=lambda kernel: int(kernel[0])):
        operations = [operation for operation, names in used.items() if name in names]
        lines[f"{name}|{' '.join(operations)}|{' '.join(types)}"] = None
    LIST.write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    print(f"{len(lines)} kernels in {LIST}")


if __name__ == "__main__":
    if sys.argv[1:] == ["all"]:
        record_all()
    elif sys.argv[1:]:
        record_one(sys.argv[1])
    else:
        sys.path.insert(0, str(ROOT / "core"))
        main()
