"""The code blocks of the tutorial on rigging run, and do what the page says."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from medialis.cli.commands import main

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "rigging.md"


@pytest.mark.slow
def test_every_code_block_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = {}
    found = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE.read_text("utf-8"), re.M | re.S)
    assert [language for language, _ in found] == ["python"] * 3 + ["bash"]
    for language, code in found:
        if language == "python":
            exec(code, names)
            continue
        for line in code.splitlines():
            program, *arguments = shlex.split(line)
            assert program == "medialis" and main(arguments) == 0
    moved = np.linalg.norm(names["posed"] - names["figure"].points, axis=1)
    share = names["share"][:, 0]
    assert (moved[share == 0] == 0).all() and moved[share > 0.99].max() > 0.05
    assert "bone 003.L below bone 002" in capsys.readouterr().out
    assert (tmp_path / "rigged" / "armature.ply").is_file()
