"""What midsurface, wall check and thickness get right of parts with fillets that are known.

    python-with-cadquery benchmarks/parts_suite/make.py FOLDER
    python benchmarks/known_parts.py FOLDER [--kinds tee ell] [--radii 0 0.5] [--files step 0.1]
        [--measures midsurface walls thickness] [--json FILE]

One line a file; an exclamation mark is beside what is wrong. Right is: the number of sheets, of
welds; their length within 2 %; offsets from the true middle within 1 % of the thickness (99th
percentile, two thicknesses off welds); thickness within 0.5 % (99th percentile); ribs, one by one;
verdicts at limits, with areas and the ends of thin places.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from parts_suite import measure
from parts_suite.truth import RADII, TESSELLATIONS, read

FILES = ("step", *(f"{step:g}" for step in TESSELLATIONS))
MEASURES = ("midsurface", "walls", "thickness")


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kinds", nargs="*", default=[])
    parser.add_argument("--radii", nargs="*", type=float, default=list(RADII))
    parser.add_argument("--files", nargs="*", default=list(FILES), choices=FILES)
    parser.add_argument("--measures", nargs="*", default=list(MEASURES), choices=MEASURES)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    for path, known in _files(given):
        row = _row(path, known, given.measures)
        rows.append(row)
        print(_line(row, known), flush=True)
        if given.json:
            given.json.write_text(json.dumps(rows, default=str), encoding="utf-8")
    print("\n".join(measure.summary(rows)))


def _files(given: argparse.Namespace) -> Iterator[tuple[Path, measure.Known]]:
    for about in sorted(given.folder.glob("*.json")):
        truth = read(about)
        if given.kinds and truth["kind"] not in given.kinds:
            continue
        if truth["radius_walls"] not in given.radii:
            continue
        for file in given.files:
            name = f"{about.stem}.step" if file == "step" else f"{about.stem}_{file}.stl"
            yield given.folder / name, measure.Known(truth)


def _row(path: Path, known: measure.Known, wanted: list[str]) -> dict[str, Any]:
    row: dict[str, Any] = {"file": path.name, "right": {}}
    right, truth = row["right"], known.truth
    if "midsurface" in wanted:
        found = row["midsurface"] = measure.midsurface(path, known)
        good = "failed" not in found
        right["sheets"] = good and found["sheets"] == truth["sheets"]
        right["welds"] = good and found["welds"] == len(truth["welds"])
        length = sum(truth["welds"])
        right["weld length"] = good and abs(found["weld_length"] - length) <= 0.02 * length
        right["offset"] = good and found["offset"] <= 0.01
        right["sheet thickness"] = good and found["thickness"] <= 0.005
        right["angle"] = good and found["angle_5"] >= 25.0
    if "thickness" in wanted:
        found = row["thickness"] = measure.thickness(path, known)
        right["thickness"] = found["p99"] <= 0.005
    if "walls" in wanted:
        found = row["walls"] = measure.walls(path, known)
        right["ribs"] = found["ribs_right"]
        right["rib count"] = len(found["ribs"]) == len(truth["ribs"])
        right["verdicts"] = not found["wrong"]
        right["ends"] = found["ends"] <= 0.01
    return row


def _line(row: dict[str, Any], known: measure.Known) -> str:
    """Return a line of the table."""
    truth, right = known.truth, row["right"]

    def told(name: str, text: str) -> str:
        return text if right.get(name, True) else f"{text}!"

    words = [f"{row['file']:28s}"]
    if found := row.get("midsurface"):
        if "failed" in found:
            words.append(f"no midsurface! {found['failed']}")
        else:
            length = sum(truth["welds"]) or 1.0
            words += [
                told("sheets", f"sheets {found['sheets']}/{truth['sheets']}"),
                told("welds", f"welds {found['welds']}/{len(truth['welds'])}"),
                told("weld length", f"{found['weld_length'] / length:.3f}"),
                told("offset", f"off {100 * found['offset']:.2f}%"),
                f"({100 * found['offset_most']:.1f})",
                told("sheet thickness", f"t {100 * found['thickness']:.2f}%"),
                f"area {100 * found['area']:+.1f}%",
                told("angle", f"angles {found['angle']:.0f} {found['angle_5']:.0f}"),
            ]
    if found := row.get("thickness"):
        words.append(told("thickness", f"field {100 * found['p99']:.2f}%"))
        words.append(f"({100 * found['most']:.1f})")
    if found := row.get("walls"):
        words.append(told("ribs", f"ribs {len(found['ribs'])}/{len(truth['ribs'])}"))
        if not right["ribs"]:
            words.append(str(found["ribs"][:4]))
        words.append(told("verdicts", "; ".join(found["wrong"]) or "verdicts"))
        words.append(told("ends", f"ends {100 * found['ends']:.2g}%"))
    words += [f"{row[name]['seconds']:.1f}s" for name in MEASURES if "seconds" in row.get(name, {})]
    return " ".join(words)


if __name__ == "__main__":
    main()
