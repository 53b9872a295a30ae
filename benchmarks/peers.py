"""Compare medialis with other packages on ten generated shapes with a known answer.

    python benchmarks/peers.py [--write] [--environment FOLDER] [--only TEXT ...]

From nothing: makes an environment for the packages (with pip, into build/peers), runs each with its
defaults and with some other settings, and prints the table; `--write` writes docs/peers.md. CGAL is
compiled and compared where its headers and a compiler are there (Debian: libcgal-dev, g++).
Each method gets a minute of processor time a setting for all shapes together; what is not done by
then counts as wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from peers_suite.measure import cases, measured, write_cases
from peers_suite.methods import METHODS, PACKAGES, Method, Settings
from peers_suite.table import Outcomes, page, table

HERE = Path(__file__).resolve().parent
SUITE = HERE / "peers_suite"
SECONDS, LONGEST = 60, 300
"""Of processors, and by the clock, that a method has for all shapes."""
AT_ONCE = 2


def environment(folder: Path) -> Path:
    """Return the Python of the environment of the peers, which is made where it is missing."""
    python = folder / "bin" / "python"
    done = folder / "packages.txt"
    wanted = " ".join(PACKAGES)
    if not done.is_file() or done.read_text() != wanted:
        print(f"installing {wanted} into {folder}", flush=True)
        venv.create(folder, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
        done.write_text(wanted)
    return python


def versions(python: Path) -> dict[str, str]:
    """Return the versions of the packages, and of CGAL where it is compiled."""
    command = [python, SUITE / "worker.py", "versions", *PACKAGES]
    return json.loads(subprocess.run(command, capture_output=True, check=True).stdout)


def cgal_program(folder: Path) -> str | None:
    """Compile the program that calls CGAL and return CGAL's version, or None without it."""
    compiler = shutil.which("g++")
    if compiler is None:
        return None
    asked = subprocess.run(
        [compiler, "-E", "-x", "c++", "-"], capture_output=True, text=True,
        input="#include <CGAL/version.h>\nversion CGAL_VERSION_STR\n",
    )  # fmt: skip
    if asked.returncode:
        return None
    flags = ["-O2", "-DNDEBUG", "-DCGAL_EIGEN3_ENABLED", "-isystem", "/usr/include/eigen3"]
    source, program = SUITE / "cgal_skeleton.cpp", folder / "cgal_skeleton"
    built = subprocess.run(
        [compiler, *flags, source, "-o", program, "-lgmp", "-lmpfr"], capture_output=True
    )
    return asked.stdout.split("version")[-1].strip().strip('"') if built.returncode == 0 else None


def run(method: Method, settings: Settings, python: Path, folder: Path) -> dict[str, dict]:
    """Run a method on all shapes and measure what it found; missing ones did not come to an end."""
    own = method.package in ("medialis", "CGAL")
    with tempfile.TemporaryDirectory() as results:
        command = [sys.executable if own else python, SUITE / "worker.py", method.name]
        command += [json.dumps(settings), folder, results]
        try:
            subprocess.run(
                command, timeout=LONGEST, capture_output=True, env=_variables(own),
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS)),
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            print(f"{method.label} {settings}: not done in {LONGEST} seconds", flush=True)
        found = {}
        for stem, case in cases().items():
            path = Path(results) / f"{stem}.npz"
            if path.is_file():
                with np.load(path) as held:
                    found[stem] = measured(dict(held), case)
            elif path.with_suffix(".txt").is_file():
                found[stem] = {"failed": path.with_suffix(".txt").read_text()}
        return found


def _variables(own: bool) -> dict[str, str]:
    """Return the environment of a worker: one thread, and nothing of ours for others."""
    variables = dict(os.environ)
    for name in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
        variables[f"{name}_NUM_THREADS"] = "1"
    if not own:
        variables.pop("PYTHONPATH", None)
    return variables


def main() -> None:
    """Parse the command line and do what it says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--environment", type=Path, default=HERE.parent / "build" / "peers")
    parser.add_argument("--only", nargs="*", default=[], metavar="TEXT")
    arguments = parser.parse_args()
    clock = time.perf_counter()
    python = environment(arguments.environment.absolute())
    installed = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_cases(folder)
        print(f"{time.perf_counter() - clock:5.0f} s: shapes written", flush=True)
        known = versions(python)
        if cgal := cgal_program(folder):
            known["CGAL"] = cgal
        chosen = [
            m for m in METHODS if not arguments.only or any(t in m.label for t in arguments.only)
        ]
        jobs = [
            (method, settings)
            for method in chosen
            if cgal or method.package != "CGAL"
            for settings in (method.default, *method.others)
        ]
        with ThreadPoolExecutor(AT_ONCE) as pool:
            waiting = [pool.submit(run, *job, python, folder) for job in jobs]
            outcomes: Outcomes = []
            for (method, settings), one in zip(jobs, waiting, strict=True):
                outcomes.append((method, settings, one.result()))
                print(
                    f"{time.perf_counter() - clock:5.0f} s: {method.label} {settings}", flush=True
                )
    print(table(outcomes))
    installing, running = (installed - clock) / 60, (time.perf_counter() - installed) / 60
    print(f"{installing:.1f} minutes to install, {running:.1f} to run")
    if arguments.write:
        path = HERE.parent / "docs" / "peers.md"
        path.write_text(page(outcomes, known, installing, running), encoding="utf-8")


if __name__ == "__main__":
    main()
