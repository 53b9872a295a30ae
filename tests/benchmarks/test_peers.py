"""The measures by which other packages are compared, on skeletons whose faults are known."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from accuracy_suite.catalogue import shapes
from peers_suite.measure import NAMES, Case, euler_number, measured
from peers_suite.methods import METHODS, PACKAGES, Method
from peers_suite.table import chosen, page, table

WORKER = Path(__file__).resolve().parents[2] / "benchmarks/peers_suite/worker.py"
TURN = np.linspace(0, 2 * np.pi, 400, endpoint=False)
RING = np.stack([np.cos(TURN), np.sin(TURN), 0 * TURN], axis=1)
ALL = pytest.approx(100, abs=1e-9)
EDGES = np.stack([np.arange(400), (np.arange(400) + 1) % 400], axis=1)


@pytest.fixture(scope="module")
def torus():
    known = shapes()["torus"]
    return Case("torus", known.make(known.across / 5, None), known, known.truth())


def row(torus, nodes, edges):
    return measured({"nodes": nodes, "edges": edges, "seconds": 1.0}, torus)


def test_the_true_curve_is_right_in_all(torus):
    found = row(torus, RING, EDGES)
    assert found["topology"] == found["ends"] == 1 and found["inside"] == ALL
    assert found["reached"] == ALL and found["off"] < 0.1  # chords of 400 parts


def test_faults_are_seen(torus):
    cut = row(torus, RING, EDGES[:-1])
    assert cut["topology"] == cut["ends"] == 0 and cut["off"] < 0.1
    half = row(torus, RING, EDGES[:200])
    # Half the ring, and a radius of 0.3 more at each of its ends.
    assert half["reached"] == pytest.approx(100 * (0.5 + 2 * 0.3 / (2 * np.pi)), abs=1)
    beside = row(torus, RING + np.array([0, 0, 0.15]), EDGES)
    assert beside["off"] == pytest.approx(50, abs=0.5) and beside["inside"] == ALL
    above = row(torus, RING + np.array([0, 0, 0.45]), EDGES)
    assert above["off"] == pytest.approx(150, abs=0.5) and above["inside"] == 0
    two = row(torus, np.concatenate([RING, RING]), np.concatenate([EDGES, EDGES + 400]))
    assert two["topology"] == 0
    doubled = np.concatenate([EDGES, EDGES[:, ::-1], [[3, 3]]])
    assert row(torus, np.concatenate([RING, [[9, 9, 9]]]), doubled) == row(torus, RING, EDGES)
    nothing = row(torus, np.empty((0, 3)), np.empty((0, 2)))
    assert nothing["topology"] == nothing["reached"] == 0


def test_voxels_are_judged_by_their_euler_number(torus):
    line = np.zeros((60, 60, 9), bool)
    places = np.round(22 * RING + [29, 29, 4]).astype(int)
    line[tuple(places.T)] = True
    given = {"voxels": line, "pitch": 1 / 22, "origin": -np.array([29, 29, 4]) / 22}
    found = measured({**given, "seconds": 1.0}, torus)
    assert found["topology"] == 1 and found["inside"] == ALL
    assert found["reached"] == ALL
    assert found["off"] < 100 * 0.5 * np.sqrt(2) / 22 / 0.3


@pytest.mark.parametrize("wanted", [1, 2, 0, -1])
def test_the_euler_number_is_that_of_the_solid(wanted):
    voxels = np.zeros((9, 9, 3), bool)
    voxels[1:8, 1:8, 1] = True
    if wanted == 2:
        voxels[4] = False  # two plates
    for x in range(1 - wanted if wanted < 1 else 0):
        voxels[2 + 3 * x, 4, 1] = False  # holes
    assert euler_number(voxels) == wanted
    corner = np.zeros((2, 2, 2), bool)
    corner[0, 0, 0] = corner[1, 1, 1] = True
    assert euler_number(corner) == 1  # they touch: 26 neighbours


def test_thickness_is_compared_with_the_tube(torus):
    count = torus.shape.point_count
    found = measured({"thickness": np.full(count, 0.6), "seconds": 1.0}, torus)
    assert found["error_95"] < 1e-6
    values = np.full(count, 0.66)
    values[: count // 4] = np.nan
    found = measured({"thickness": values, "seconds": 1.0}, torus)
    assert found["error"] == pytest.approx(10, abs=1e-3) and found["error_95"] == np.inf


def test_the_best_setting_is_shown_beside_the_default():
    method = Method("a", "A", "a", others=({"x": 1}, {"x": 2}))
    good = {"seconds": 1.0, "topology": 1.0, "ends": 1.0, "inside": 100.0, "off": 3.0}
    good["reached"] = 90.0
    bad = {**good, "topology": 0.0, "off": 1.0}
    outcomes = [(method, {}, {"t": bad}), (method, {"x": 1}, {"t": good}), (method, {"x": 2}, {})]
    assert [settings for _, settings, _ in chosen(outcomes)] == [{}, {"x": 1}]
    lines = table(outcomes).splitlines()
    assert len(lines) == 4 and f"| 0 of {len(NAMES)} |" in lines[2] and "x 1" in lines[3]
    outcomes[0] = (method, {}, {"t": good})
    assert len(chosen(outcomes)) == 1


@pytest.mark.slow
def test_the_page_says_where_a_peer_is_better():
    own, peer = (Method(name, name, name) for name in ("medialis", "peer"))
    right = {"seconds": 2.0, "topology": 1.0, "ends": 1.0, "inside": 100.0, "off": 3.0}
    right["reached"] = 100.0
    wrong = {**right, "topology": 0.0, "off": 0.1}
    stems = [name.replace(" ", "_") for name in NAMES]
    ours = dict.fromkeys(stems, right)
    theirs = {**{stem: {**right, "seconds": 1.0, "off": 4.0} for stem in stems}, "knot": wrong}
    theirs["torus"] = {**right, "off": 2.0}
    outcomes = [(own, {}, ours), (peer, {}, theirs)]
    text = page(outcomes, {"peer": "1.2.3"}, 2.0, 10.0)
    assert "Skeleton, seconds: peer (12) is **better than** medialis (20)." in text
    assert "right topologies: peer (9) is behind medialis (10)." in text
    assert "On the torus, peer is nearer to the centre: 2 % off, medialis 3 %." in text
    assert "On the knot" not in text and "peer 1.2.3" in text


def test_every_method_has_a_function_and_a_package():
    text = WORKER.read_text("utf-8")
    for method in METHODS:
        assert f"def {method.name}(case" in text
        assert method.package in (*PACKAGES, "medialis", "CGAL")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["medialis_curve", "medialis_thickness"])
def test_a_worker_writes_what_is_measured(torus, tmp_path, name):
    shape = torus.shape
    arrays = {"points": shape.points, "faces": shape.faces, "normals": shape.normals}
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    np.savez(tmp_path / "in" / "torus.npz", **arrays, across=0.6)
    np.savez(tmp_path / "in" / "wrong.npz", points=shape.points, across=0.6)
    command = [sys.executable, WORKER, name, json.dumps({}), tmp_path / "in", tmp_path / "out"]
    subprocess.run(command, check=True, capture_output=True)
    with np.load(tmp_path / "out" / "torus.npz") as held:
        found = measured(dict(held), torus)
    assert found["seconds"] > 0
    assert found["topology"] == 1 if "topology" in found else found["error"] < 5
    assert "faces" in (tmp_path / "out" / "wrong.txt").read_text()
