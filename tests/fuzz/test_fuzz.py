"""The fuzzers themselves, and a few cases of each kind; `make fuzz` runs more."""

import json
import random
import sys
from pathlib import Path

import numpy as np
import pytest

from fuzz.__main__ import main
from fuzz.good_files import good_files
from fuzz.kinds import KINDS, Case, load_kind, make_case
from fuzz.mutations import LARGEST, MUTATIONS, mutated
from fuzz.nasty_shapes import MAKERS, grid_box, nasty_mesh, sphere, tube

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs signals and limits of Unix")


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Let workers find this package, and what the tests test."""
    import medialis

    places = Path(__file__).parents[1], Path(medialis.__file__).parents[1]
    monkeypatch.setenv("PYTHONPATH", ":".join(map(str, places)))


@pytest.mark.slow
def test_the_runner_finds_every_fault_and_goes_on(tmp_path, capsys):
    """Exceptions, crashes, hangs and lack of memory are findings; what was slow once is none."""
    given = ["--kinds", "faults", "--seed", "3", "--output", str(tmp_path), "--count"]
    assert main([*given, "2"]) == 1
    assert main([*given, "7"]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[-1] == "2 passed, 5 failed"
    state = json.loads((tmp_path / "state.json").read_text())["3"]["faults"]
    assert (state["next"], state["failed"]) == (7, 5)
    titles = {}
    for folder in (tmp_path / "findings").iterdir():
        titles[folder.name] = (folder / "finding.txt").read_text().splitlines()[0]
        assert (folder / "input.txt").exists()
    assert titles == {
        "faults-3-1": "a finding",
        "faults-3-2": "KeyError outside of medialis",
        "faults-3-3": "crash: exit -6",
        "faults-3-4": "hang",
        "faults-3-5": "MemoryError outside of medialis",
    }
    assert not list((tmp_path / "work").iterdir())
    assert main(["--seed", "3", "--case", "faults:1", "--output", str(tmp_path)]) == 1
    assert capsys.readouterr().out.startswith("a finding\nits details")
    assert main(["--seed", "3", "--case", "faults:0", "--output", str(tmp_path)]) == 0


def test_no_findings_end_with_0(tmp_path, capsys):
    assert main(["--kinds", "faults", "--count", "1", "--output", str(tmp_path)]) == 0
    assert capsys.readouterr().out.endswith("1 passed, 0 failed\n")


def test_a_case_is_its_seed_kind_and_number(tmp_path):
    """Mutated bytes and shapes are the same in every run, whatever ran before."""
    datas = [good.data for good in good_files()]
    assert datas == [good.data for good in good_files()]
    for mutation in MUTATIONS:
        for data in (datas[0], b"", b"\x00"):
            made = {mutation(random.Random(5), data, [datas[1]]) for _ in range(2)}
            assert len(made) == 1
    assert len(mutated(random.Random(1), datas[0], datas)) <= LARGEST
    draws = [make_case(1, "files", n, tmp_path, tmp_path).rng.random() for n in (1, 2, 1)]
    assert draws[0] == draws[2] != draws[1]
    first, second = (nasty_mesh(random.Random("1:shapes:7")) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes() and first[2] == second[2]


@pytest.mark.parametrize("maker", MAKERS)
def test_nasty_shapes_are_small_and_name_their_own_points(maker):
    for number in range(20):
        points, faces = maker(random.Random(number))
        assert np.isfinite(points).all() and len(points) < 2000
        assert faces.dtype == np.int32 and 0 <= faces.min() <= faces.max() < len(points)


@pytest.mark.parametrize("mesh", [grid_box(4), tube(7, 3), sphere(5)])
def test_the_plain_shapes_are_closed(mesh):
    """Damage is done to shapes without fault: each edge has two faces, the volume is inside."""
    points, faces = mesh
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert {tuple(pair) for pair in ends.tolist()} == {tuple(p) for p in ends[:, ::-1].tolist()}
    assert len({tuple(pair) for pair in ends.tolist()}) == len(ends)
    assert np.linalg.det(points[faces]).sum() > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "count"),
    [("files", 50), ("shapes", 5), ("defaults", 4), ("disk", 1), ("calls", 1), ("attackers", 3)],
)
def test_some_cases_of_each_kind(name, count, tmp_path, capsys):
    seed = "1" if name == "calls" else "0"  # a single run, and not a batch
    code = main(["--kinds", name, "--count", str(count), "--seed", seed, "--output", str(tmp_path)])
    assert code == 0, capsys.readouterr().out


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_can_be_loaded(name):
    kind = load_kind(name)
    assert kind.processor_seconds > 0 and Case.__dataclass_fields__.keys() >= {"rng", "folder"}
