"""Branches measured: closed forms of drawn forks, of a mesh of capsules, and their files."""

import csv
import json
import math
import re

import numpy as np
import pytest
from shown_suite.shapes import fork as fork_of_rods

import medialis
from medialis.cli.display import summary_lines
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.operation import branch_rows

ANGLE = 50.0


def drawn_fork(bend=0.0):
    """A stem of 10 along -y with radius 2, two arms of 8 that leave it 50 degrees apart.

    Radii of the arms fall from 1 to 0.5. Within 2 of the fork, a radius, they are bent by `bend`.
    """
    half = math.radians(ANGLE / 2)
    nodes, edges, radii = [[0.0, 0.0, 0.0]], [], [2.0]
    limbs = [((0, -1), 10, 2.0, 2.0), *(((s * math.sin(half), math.cos(half)), 8, 1.0, 0.5)
                                        for s in (-1, 1))]  # fmt: skip
    for (x, y), length, first, last in limbs:
        before = 0
        for step in range(1, 11):
            at = length * step / 10
            nodes.append([at * x, at * y, bend if at < 2 and length == 8 else 0.0])
            radii.append(first + (last - first) * (step - 1) / 9)
            edges.append([before, len(nodes) - 1])
            before = len(nodes) - 1
    return CurveSkeleton.of(nodes, edges, radii)


def test_a_drawn_fork_has_its_lengths_radii_and_angles():
    fork = drawn_fork()
    table = fork.branch_table
    assert np.allclose(table["length"], [10, 8, 8]) and np.allclose(table["tortuosity"], 1.0)
    assert np.allclose(table["least_radius"], [2, 0.5, 0.5])
    # (2 + 1) / 2 over the first tenth, then falling from 1 to 0.5.
    assert np.allclose(table["mean_radius"], [2, *[(1.5 + 9 * 0.75) / 10] * 2])
    angles = np.degrees(table["fork_angle"])
    assert np.allclose(angles, [180 - ANGLE / 2, ANGLE, ANGLE])
    ends = fork.degrees[np.stack([table["start"], table["end"]])]
    assert np.array_equal(np.isnan(fork.fork_angles.T), ends == 1)


def test_what_is_within_two_radii_of_a_fork_is_no_direction():
    straight, bent = (drawn_fork(bend).fork_angles for bend in (0.0, 0.8))
    assert np.allclose(straight, bent, equal_nan=True, atol=1e-12)


def test_measures_move_and_scale_with_the_shape():
    fork, turn = drawn_fork(), np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    moved = CurveSkeleton.of(3 * fork.nodes @ turn.T + 7, fork.edges, 3 * fork.radii)
    for name, values in fork.branch_table.items():
        scale = 3.0 if name in ("length", "mean_radius", "least_radius") else 1.0
        assert np.allclose(moved.branch_table[name], scale * values), name


def test_rings_lines_and_single_nodes():
    """A ring has no chord and no fork, a line of two nodes no fork, a node no branch."""
    turn = 2 * np.pi * np.arange(12) / 12
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    edges = [[k, (k + 1) % 12] for k in range(12)] + [[12, 13]]
    nodes = [*ring, [5, 0, 0], [6, 0, 0], [9, 9, 9]]
    curve = CurveSkeleton.of(nodes, edges, np.ones(15))
    table = curve.branch_table
    assert np.isinf(table["tortuosity"][0]) and np.isnan(table["fork_angle"]).all()
    assert table["length"] == pytest.approx([24 * math.sin(math.pi / 12), 1.0])
    assert [row["kind"] for row in branch_rows(curve)] == ["loop", "end to end"]
    empty = CurveSkeleton.of([[0, 0, 0]], [], [1.0])
    assert all(len(column) == 0 for column in empty.branch_table.values())
    assert branch_rows(empty) == []


@pytest.mark.parametrize("angle", [60.0, 90.0])
def test_rods_that_fork(angle):
    """Arms of 40 and radius 3 on a stem of 40 and radius 4; where they meet they are
    blended, and the middle of what they are together there lies beside where their axes meet."""
    curve = medialis.curve_skeleton(medialis.surface_skeleton(fork_of_rods(angle, cells=60)()))
    table = {name: np.asarray(values) for name, values in curve.branch_table.items()}
    assert curve.branch_count == 3 and len(curve.junctions) == 1
    stem = int(np.argmax(table["mean_radius"]))
    arms = [row for row in range(3) if row != stem]
    assert np.degrees(table["fork_angle"][arms]) == pytest.approx([angle] * 2, abs=1.5)
    assert np.degrees(table["fork_angle"][stem]) == pytest.approx(180 - angle / 2, abs=1.5)
    assert table["mean_radius"][[stem, *arms]] == pytest.approx([4, 3, 3], rel=0.03)
    assert table["length"] == pytest.approx([40] * 3, abs=2.0)  # cells are 1.6 to 1.9 wide
    assert table["tortuosity"] == pytest.approx([1] * 3, abs=0.01)


def written(tmp_path, unit):
    for ending in ("swc", "json", "graphml", "obj", "csv", "branches.json", "branches.graphml"):
        medialis.write_curve_skeleton(tmp_path / f"a.{ending}", drawn_fork(), unit=unit)
        yield ending, (tmp_path / f"a.{ending}").read_text("utf-8")


def test_files_say_the_unit_once_it_is_known(tmp_path):
    without = dict(written(tmp_path, None))
    for ending, text in written(tmp_path, "mm"):
        said = {"csv": "length (mm)", "json": '"unit": "mm"', "branches.json": '"unit": "mm"'}
        assert said.get(ending, "lengths in mm") in text, ending
        assert "mm" not in without[ending], ending
    assert medialis.read_curve_skeleton(tmp_path / "a.swc").branch_count == 3
    again = medialis.read_curve_skeleton(tmp_path / "a.json")
    assert np.array_equal(again.nodes, drawn_fork().nodes)


def test_table_and_graph_of_branches_hold_what_the_table_has(tmp_path):
    networkx, table = pytest.importorskip("networkx"), drawn_fork().branch_table
    dict(written(tmp_path, "mm"))
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text("utf-8").splitlines()))
    assert [row["branch"] for row in rows] == ["0", "1", "2"]
    for name, head in (("length", "length (mm)"), ("tortuosity", "tortuosity")):
        assert [float(row[head]) for row in rows] == table[name].tolist()
    degrees = [float(row["fork_angle (degrees)"]) for row in rows]
    assert degrees == np.degrees(table["fork_angle"]).tolist()
    content = json.loads((tmp_path / "a.branches.json").read_text("utf-8"))
    assert [node["degree"] for node in content["nodes"]] == [3, 1, 1, 1]
    assert [edge["fork_angle"] for edge in content["edges"]] == table["fork_angle"].tolist()
    graph = networkx.read_graphml(tmp_path / "a.branches.graphml")
    assert graph.number_of_nodes() == 4 and graph.number_of_edges() == 3
    lengths = sorted(data["length"] for *_, data in graph.edges(data=True))
    assert lengths == sorted(table["length"].tolist())


def test_the_longest_branches_are_on_the_screen():
    """With their numbers, lengths with their unit, and no more than three of them."""
    nodes = [[0, 0, 0], *([k, 9 - k, 1] for k in (1, 7, 3, 5, 8))]
    star = CurveSkeleton.of(nodes, [[0, k] for k in range(1, 6)], np.linspace(1, 2, 6))
    rows = branch_rows(star)
    manifest = {
        "operation": "curve_skeleton", "input": "a.ply", "values": {"branch_table": rows},
        "unit": "mm", "messages": [], "notes": [], "files": ["a/manifest.json"], "layers": [],
        "seconds": {"total": 1.0}, "picture": None,
    }  # fmt: skip
    lines = list(summary_lines(manifest, 200))
    head = next(k for k, line in enumerate(lines) if "mean radius" in line)
    longest = sorted(range(len(rows)), key=lambda k: -rows[k]["length"])[:3]
    assert longest != [0, 1, 2]
    for line, row in zip(lines[head + 1 : head + 4], longest, strict=True):
        words = re.split(" {2,}", line)
        assert int(words[1]) == row and f"{rows[row]['length']:.4g} mm" in words
        assert f"{math.degrees(rows[row]['fork_angle']):.1f} degrees" in words
    assert lines[head + 4] == "  2 more in manifest.json"


def test_pandas_has_the_same_columns():
    pandas, fork = pytest.importorskip("pandas"), drawn_fork()
    frame = medialis.to_pandas(fork)
    assert isinstance(frame, pandas.DataFrame) and list(frame) == list(fork.branch_table)
    assert frame.least_radius.tolist() == fork.least_radii.tolist()
