"""How accurate the results are, on shapes with a known answer.

    python benchmarks/accuracy.py --poke-out ../shared/shapes [--refine 0.005]
    python benchmarks/accuracy.py --poke-out part.ply other.obj

`--poke-out` prints how many balls poke out of the triangles of the surface by more than 1.1 times
the tolerance and what bending facets explain; `accuracy_suite/poke_out.py` defines it. Of a folder
it takes the closed meshes without faces that cross.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from accuracy_suite.poke_out import print_poke_out


def main() -> None:
    """Parse the command line and do what it says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--poke-out", nargs="+", type=Path, required=True, metavar="PATH")
    parser.add_argument("--refine", type=float)
    arguments = parser.parse_args()
    print_poke_out(arguments.poke_out, arguments.refine)


if __name__ == "__main__":
    main()
