"""How accurate the results are, on shapes with a known answer.

    python benchmarks/accuracy.py [--write] [--sections axis thin ...] [--only box slab ...]
    python benchmarks/accuracy.py --poke-out ../shared/shapes [--refine 0.005]
    python benchmarks/accuracy.py --poke-out part.ply other.obj

The first measures all tables (some minutes) and prints their rows; `--write` writes
docs/accuracy.md and benchmarks/accuracy.json, where rows that were not measured stay as they are.
The measures are those of `benchmarks/accuracy_suite`, each with its units.

`--poke-out` prints how many balls poke out of the triangles of the surface by more than 1.1 times
the tolerance and what bending facets explain; `accuracy_suite/poke_out.py` defines it. Of a folder
it takes the closed meshes without faces that cross.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from accuracy_suite.poke_out import print_poke_out
from accuracy_suite.suite import SECTIONS
from accuracy_suite.table import compute, page, read_table, write


def main() -> None:
    """Parse the command line and do what it says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--sections", nargs="*", default=[], choices=list(SECTIONS))
    parser.add_argument("--only", nargs="*", default=[], metavar="TEXT")
    parser.add_argument("--poke-out", nargs="+", type=Path, metavar="PATH")
    parser.add_argument("--refine", type=float)
    arguments = parser.parse_args()
    if arguments.poke_out:
        print_poke_out(arguments.poke_out, arguments.refine)
        return
    table = compute(read_table(), arguments.sections, arguments.only)
    if arguments.write:
        write(table)
    else:
        print(page(table))


if __name__ == "__main__":
    main()
