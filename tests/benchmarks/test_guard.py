import subprocess
from contextlib import nullcontext

import guard
import numpy as np
import pytest

import medialis
from medialis.formats.ply_attributes import write_ply


def test_a_ratio_and_its_noise():
    """Of normal times three standard errors: 3 * 1.25 * sqrt(2 / n) of the deviation."""
    rng = np.random.default_rng(0)
    before, now = 1 + 0.02 * rng.normal(size=4001), 1.3 * (1 + 0.02 * rng.normal(size=4001))
    ratio, noise = guard.judged(list(before), list(now))
    assert ratio == pytest.approx(1.3, rel=2e-3)
    assert noise == pytest.approx(1.3 * 3 * 1.25 * 0.02 * (2 / 4001) ** 0.5, rel=0.1)
    assert guard.judged([1.0, 1.0, 1.0], [2.0, 2.0, 2.0]) == (2.0, 0.0)


@pytest.fixture
def sample(tmp_path):
    shape = medialis.organic_shape(120)
    write_ply(tmp_path / "creature.ply", shape.points, shape.faces)
    return tmp_path / "creature.ply"


class Timed:
    """In the place of a process: its times, one after the other, or an error."""

    def __init__(self, times):
        self.times = times

    def seconds(self, path, name):
        return 0.5 if name == "U" else self.times[name]


def test_what_is_slower_or_fails_now_is_told(tmp_path, capsys):
    before = Timed({"read": 1.0, "parts": 1.0, "smooth": "no such operation"})
    now = Timed({"read": 1.05, "parts": 1.2, "smooth": 1.0})
    path = tmp_path / "a.ply"
    assert guard.compared([before, now], path, ["read", "smooth"], 3, 1.1)
    assert not guard.compared([before, now], path, ["parts"], 3, 1.1)
    assert not guard.compared([now, before], path, ["smooth"], 3, 1.1)
    told = capsys.readouterr().out
    assert "| parts | 2.0 | 2.4 | 1.20 | 0.00 | **slower** |" in told
    assert "| smooth | | | | | before it says no such operation |" in told


def test_kernels_are_made_ahead_by_the_sources_of_a_package_or_compiled_on_both_sides(
    tmp_path, capfd
):
    base, build = tmp_path / "medialis" / "base", tmp_path / "kernel_library" / "build.py"
    base.mkdir(parents=True)
    build.parent.mkdir()
    build.write_text("import os, sys\nprint('built for', os.environ['PYTHONPATH'])\nsys.exit(0)")
    assert not guard.made_ahead(tmp_path)  # of a checkout without any, none are made
    (base / "made-any.json").touch()
    assert guard.made_ahead(tmp_path)
    assert capfd.readouterr().out == f"built for {tmp_path}\n"
    build.write_text("raise SystemExit('no C compiler')")
    assert not guard.made_ahead(tmp_path)
    build.unlink()
    assert not guard.made_ahead(tmp_path)


@pytest.mark.parametrize("made", [True, False])
def test_both_sides_have_kernels_of_one_kind(sample, made, monkeypatch):
    kinds = []

    class Told(Timed):
        def __init__(self, package, kernels):
            super().__init__({"read": 1.0})
            kinds.append(kernels)

        def close(self):
            pass

    monkeypatch.setattr(guard, "git", lambda *words: "a commit")
    monkeypatch.setattr(guard, "package_of", lambda commit: nullcontext(sample.parent))
    monkeypatch.setattr(guard, "made_ahead", lambda package: made or package != sample.parent)
    monkeypatch.setattr(guard, "Side", Told)
    words = ["guard.py", "--against", "HEAD", "--files", str(sample), "--operations", "read"]
    monkeypatch.setattr("sys.argv", words)
    assert guard.main() == 0
    assert kinds == (["", ""] if made else ["numba", "numba"])


@pytest.mark.slow
def test_a_checkout_is_as_fast_as_its_last_commit(sample, monkeypatch, capsys):
    """With a limit that only what takes another way goes beyond."""
    try:
        guard.git("rev-parse", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("the sources are not in a repository of git")
    words = ["guard.py", "--against", "HEAD", "--files", str(sample), "--operations", "read"]
    monkeypatch.setattr("sys.argv", [*words, "surface_skeleton", "--limit", "20"])
    assert guard.main() == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| s")]
    assert len(rows) == 1 and "says" not in rows[0]
