"""What the numbers of a report say, in one line each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from medialis.base.progress import counted
from medialis.show.reports.page import number, place

GOOD, LOOK, INFO = "good", "look", "info"
NOUNS = {
    "pieces": "piece",
    "sheets": "sheet",
    "y_curves": "Y-curve",
    "parts": "part",
    "segments": "segment",
    "manifolds": "manifold",
    "patches": "patch",
    "bones": "bone",
}
"""Values of results that count what was found."""

ROUNDING = 1e-6
"""Share of the tolerance that a depth may exceed it by rounding."""


def verdicts(found: Mapping[str, Any]) -> list[dict[str, str]]:
    """Judge the measures of a run.

    Parameters
    ----------
    found : dict
        From `medialis.show.reports.measures.measure`, without the verdict.

    Returns
    -------
    list of dict
        ``about``, ``state`` and ``text``. The state is "good" where something that is known to be
        right was checked and holds, "look" where it does not hold or something is missing, and
        "info" where there is nothing to compare a number with.
    """
    lines = [
        *_topology(found["topology"], found["input"]["as_computed"]),
        _emptiness(found),
        _reconstruction(found),
        _envelope(found),
        _centredness(found["centredness"]),
        _balls(found["balls"]),
        _thinnest(found),
        _walls(found["values"]),
        _notes(found["messages"]),
    ]
    return [line for line in lines if line is not None]


def _line(about: str, state: str, text: str) -> dict[str, str]:
    return {"about": about, "state": state, "text": text}


def _topology(topology: Mapping[str, Any], after: Mapping[str, Any]) -> list[dict[str, str]]:
    lines = []
    if "loops" in topology:
        lines.append(_loops(topology, after))
        expected, got = topology["expected_components"], topology["skeleton_components"]
        text = f"{number(got)} found; a point cloud does not tell how many to expect."
        if expected is not None:
            text = f"{number(expected)} expected (the parts of the shape), {number(got)} found."
        lines.append(_line("Components", _compared(expected, got), text))
    else:
        lines.append(_line("Shape", INFO, _shape(topology, after)))
    if topology.get("expected_handles") is not None:
        lines.append(_solid(topology))
    counts = [counted(count, NOUNS[name]) for name, count in topology["found"].items()]
    if counts:
        lines.append(_line("Found", INFO, ", ".join(counts) + "."))
    return lines


def _solid(topology: Mapping[str, Any]) -> dict[str, str]:
    """Compare a medial mesh with the solid that the surface bounds."""
    names = (("parts_and_hollows", "surface piece"), ("handles", "handle"))
    right = all(topology[name] == topology[f"expected_{name}"] for name, _ in names)
    expected = " and ".join(counted(topology[f"expected_{name}"], noun) for name, noun in names)
    found = " and ".join(counted(topology[name], noun) for name, noun in names)
    text = f"The medial mesh is that of a solid with {expected}."
    if not right:
        text = f"{expected} expected, the medial mesh has {found}."
    return _line("Topology", GOOD if right else LOOK, text)


def _compared(expected: int | None, got: int) -> str:
    if expected is None:
        return INFO
    return GOOD if expected == got else LOOK


def _loops(topology: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, str]:
    expected, got = topology["expected_loops"], topology["loops"]
    why = "edges with three or more faces, or vertices that join sheets, leave it undefined"
    if after["faces"] == 0:
        why = "a point cloud has no handles to count"
    text = f"{number(got)} found; how many to expect is not known: {why}."
    if expected is not None:
        text = f"{number(expected)} expected (one for each handle), {number(got)} found."
        if expected == 0 and got == 0:
            text = "No loop expected (the shape has no handle), none found."
    if not topology["expected_loops_certain"]:
        text += " What is expected is a guess: edges with an odd number of faces, or no outside."
        return _line("Loops", INFO, text)
    return _line("Loops", _compared(expected, got), text)


def _shape(topology: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    if topology["components"] is None:
        return f"A cloud of {counted(after['vertices'], 'point')}."
    text = counted(topology["components"], "component")
    genus = topology["genus"]
    text += ", handles not defined" if genus is None else f", {counted(genus, 'handle')} (genus)"
    holes = topology["boundary_loops"]
    return text + (f", open with {counted(holes, 'hole')}." if holes else ", closed.")


def _emptiness(found: Mapping[str, Any]) -> dict[str, str] | None:
    emptiness, parameters = found["emptiness"], found["parameters"]
    if emptiness is None:
        return None
    deepest = emptiness["deepest"]
    if deepest == 0:
        return _line("Emptiness", GOOD, "No sample of the surface lies inside a ball.")
    text = f"The deepest sample lies {number(deepest, 3)} % of the diagonal inside a ball"
    if not found["balls"]["by_shrinking"] or "tolerance" not in parameters:
        return _line("Emptiness", INFO, text + ".")
    allowed = 100 * parameters["tolerance"]
    if deepest <= allowed * (1 + ROUNDING) + 100 * ROUNDING**2:
        return _line("Emptiness", GOOD, f"{text}: within the tolerance of {number(allowed)} %.")
    return _line("Emptiness", LOOK, f"{text}: more than the tolerance of {number(allowed)} %.")


def _reconstruction(found: Mapping[str, Any]) -> dict[str, str] | None:
    error = found["reconstruction"]
    if error is None:
        return None
    what, after = found["balls"]["what"], found["input"]["as_computed"]
    where = place(error["worst_place"], after["diagonal"])
    text = (
        f"Hausdorff distance from the surface to the {what} {_one_way(error, 'surface_to_balls')}, "
        f"back {_one_way(error, 'balls_to_surface')}; the largest is at {where}."
    )
    if found["balls"]["by_shrinking"] and not after["closed"]:
        text += " Balls bulge out at holes."
    return _line("Reconstruction", INFO, text)


def _envelope(found: Mapping[str, Any]) -> dict[str, str] | None:
    error = found["envelope"]
    if error is None:
        return None
    where = place(error["worst_place"], found["input"]["as_computed"]["diagonal"])
    text = (
        f"The surface and the envelope are {number(error['largest_error'], 3)} % of the diagonal "
        f"apart at most (mean {number(error['mean_error'], 2)} %); the largest is at {where}."
    )
    return _line("Envelope", INFO, text)


def _one_way(error: Mapping[str, Any], way: str) -> str:
    largest, mean = error[f"{way}_max"], error[f"{way}_mean"]
    if largest is None:
        return "not seen"
    return f"{number(largest, 3)} % of the diagonal (mean {number(mean, 2)} %)"


def _centredness(share: Mapping[str, float] | None) -> dict[str, str] | None:
    if share is None:
        return None
    return _line(
        "Centredness",
        INFO,
        f"Distance to the surface over the radius: median {number(share['median'], 3)}, from "
        f"{number(share['lowest'], 3)} to {number(share['highest'], 3)}; 1 is centred.",
    )


def _balls(counts: Mapping[str, Any] | None) -> dict[str, str] | None:
    if counts is None or "started" not in counts:
        return None
    missing = {"open": "without a second contact", "without_normal": "without a normal"}
    why = [f"{number(counts[name])} {text}" for name, text in missing.items() if counts[name]]
    text = f"{number(counts['maximal'])} of {counted(counts['started'], 'ball')} are maximal"
    return _line("Balls", INFO if why else GOOD, "; ".join([text, *why]) + ".")


def _thinnest(found: Mapping[str, Any]) -> dict[str, str] | None:
    spots = found["thin_spots"]
    if spots is None:
        return None
    if not spots:
        return _line("Thin spots", GOOD, "No place is thinner than the threshold.")
    value, diagonal = spots[0]["value"], found["input"]["as_computed"]["diagonal"]
    share = f" ({number(100 * value / diagonal, 3)} % of the diagonal)" if diagonal > 0 else ""
    text = f"{number(len(spots))} listed, the thinnest {number(value)}{share}."
    return _line("Thin spots", INFO, text)


def _walls(values: Mapping[str, Any]) -> dict[str, str] | None:
    if "passed" not in values:
        return None
    if values["passed"]:
        return _line("Walls", GOOD, "All walls are within the limits.")
    words = {"too_thin": "too thin", "too_thick": "too thick", "narrow_gaps": "gaps too narrow"}
    counts = [f"{number(values[name])} {text}" for name, text in words.items() if values[name]]
    return _line("Walls", LOOK, ", ".join(counts) + ".")


def _notes(messages: list[str]) -> dict[str, str]:
    if not messages:
        return _line("Notes", GOOD, "Nothing was repaired, refined or left out.")
    return _line("Notes", INFO, f"{counted(len(messages), 'note')} below.")
