"""What the numbers of the accuracy table must not exceed."""

from __future__ import annotations

from collections.abc import Callable, Iterator

NAMED = 8
"""Rows that are named where more miss a requirement: those with the largest numbers."""

Row = dict[str, float]
Table = dict[str, dict[str, Row]]


def requirements(table: Table) -> Iterator[tuple[str, bool, str]]:
    """Say of each requirement what it is, whether it holds, and the rows that miss it."""

    def rows(section: str, text: str = "") -> dict[str, Row]:
        return {name: row for name, row in table.get(section, {}).items() if text in name}

    yield _judged(
        "at most 0.5 % of the balls of real closed shapes poke out",
        rows("poke_out"), lambda r: r["poke_out"] <= 0.5, "poke_out",
    )  # fmt: skip
    yield _judged(
        "centers of shapes with a known axis within 0.1 % of the diagonal of it, in the mean",
        rows("axis"), lambda r: r["to_axis_mean"] <= 0.1, "to_axis_mean",
    )  # fmt: skip
    yield _judged(
        "the union of the balls is within 0.1 % of the diagonal of the surface, both sides",
        rows("union"), lambda r: max(r["out_max"], r["back_max"]) <= 0.1, "out_max", "back_max",
    )  # fmt: skip
    yield _judged(
        "number of sheets", rows("sheets"), lambda r: r["sheets"] == r["true_sheets"], "sheets"
    )
    yield _judged(
        "area of all sheets within 1 %",
        rows("sheets"), lambda r: abs(r["area_error"]) <= 1, "area_error",
    )  # fmt: skip
    yield _judged(
        "length of the Y-curves within 1 %",
        rows("sheets"), lambda r: r["y_error"] is None or abs(r["y_error"]) <= 1, "y_error",
    )  # fmt: skip
    yield _judged(
        "95 % of the thicknesses within 2 % of the ray",
        rows("rays"), lambda r: r["right"] >= 95, "right",
    )  # fmt: skip
    yield _judged(
        "95 % of the thicknesses of organic shapes within 2 % of the truth",
        rows("thickness"), lambda r: r["right"] >= 95, "right",
    )  # fmt: skip
    yield _judged(
        "first thin spot within 2 % of the true minimum",
        rows("thin"), lambda r: abs(r["value_error"]) <= 2, "value_error",
    )  # fmt: skip
    yield _judged(
        "and within one spacing of its place", rows("thin"), lambda r: r["off"] <= 1, "off"
    )
    yield _judged(
        "loops of curve skeletons", rows("curves"), lambda r: r["loops"] == r["true_loops"], "loops"
    )
    yield _judged(
        "expected loops are given and right",
        rows("curves"), lambda r: r["expected_loops"] == r["true_loops"], "expected_loops",
    )  # fmt: skip
    yield _judged(
        "ends of curve skeletons",
        rows("curves"), lambda r: r["true_ends"] in (None, r["ends"]), "ends",
    )  # fmt: skip
    yield _judged(
        "number of segments",
        rows("segments"), lambda r: r["segments"] == r["true_segments"], "segments",
    )  # fmt: skip


def _judged(
    what: str, rows: dict[str, Row], holds: Callable[[Row], bool], *names: str
) -> tuple[str, bool, str]:
    missed = sorted(
        ((title, row) for title, row in rows.items() if not holds(row)),
        key=lambda one: -abs(one[1][names[0]] or 0.0),
    )
    texts = [
        f"{title}: {', '.join(f'{row[name]:.3g}' for name in names)}"
        for title, row in missed[:NAMED]
    ]
    texts += ["..."] * (len(missed) > NAMED)
    count = f"{len(missed)} of {len(rows)}: " if missed else f"{len(rows)} measured"
    return what, bool(rows) and not missed, count + "; ".join(texts)
