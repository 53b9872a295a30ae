"""`medialis doctor` tells the truth about an installation."""

import json
from importlib.metadata import PackageNotFoundError, version

import pytest

from medialis import doctor
from medialis.cli import main


def states(findings):
    return {finding.name: finding.state for finding in findings}


def test_a_sound_installation_has_nothing_broken(capsys):
    assert main(["doctor", "--json"]) == 0
    found = {entry["name"]: entry for entry in json.loads(capsys.readouterr().out)}
    assert found["numba"]["text"] == version("numba") and found["medialis"]["state"] == "ok"
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    assert "BROKEN" not in text and all(name in text for name in found)


def test_what_is_missing_comes_with_the_way_to_get_it(monkeypatch):
    def installed(name):
        if name in ("scipy", "distributed"):
            raise PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(doctor, "version", installed)
    monkeypatch.setattr(doctor.shutil, "which", lambda command: None)
    found = doctor.examine()
    assert states(found)["scipy"] == "broken" and states(found)["distributed"] == "missing"
    assert states(found)["Blender"] == "missing"
    assert 'pip install "medialis[dask]"' in doctor.as_text(found)


def test_something_broken_is_an_exit_code(monkeypatch, capsys):
    finding = doctor.Finding("numba", "broken", "pip install numba")
    monkeypatch.setattr(doctor, "examine", lambda: [finding])
    assert main(["doctor"]) == 2
    assert "BROKEN numba" in capsys.readouterr().out


@pytest.mark.parametrize("writable", [True, False])
def test_the_kernel_cache_is_looked_at(tmp_path, monkeypatch, writable):
    monkeypatch.setattr("medialis._kernels.jit.kernel_cache", lambda: tmp_path / "a" / "b")
    monkeypatch.setattr(doctor.os, "access", lambda path, mode: writable)
    (finding,) = [f for f in doctor.examine() if f.name == "kernel cache"]
    assert finding.state == ("ok" if writable else "missing")
    assert ("medialis warmup" if writable else "MEDIALIS_CACHE_DIR") in finding.text
    assert not (tmp_path / "a").exists()
