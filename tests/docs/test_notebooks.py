"""The notebooks run from top to bottom, as they are, and what their cells end with shows itself."""

import ast
import json
from pathlib import Path

import pytest

import medialis

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "docs/examples").glob("*.ipynb"))
LONGEST_TEXT = 400
"""Characters that the last value of a cell may be shown as, where it has no picture."""

by_name = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def cells(path, kind):
    found = json.loads(path.read_text("utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in found if cell["cell_type"] == kind]


def run_cell(code, names):
    """Run a cell; return the value of its last line, where that is an expression."""
    tree, last = ast.parse(code), None
    if isinstance(tree.body[-1], ast.Expr):
        last = ast.Expression(tree.body.pop().value)
    exec(compile(tree, "cell", "exec"), names)
    return None if last is None else eval(compile(last, "cell", "eval"), names)


@by_name
def test_notebooks_are_of_the_format_and_hold_no_outputs(path):
    """nbformat 4.5: cells have ids of their own; a fresh one has neither numbers nor outputs."""
    book = json.loads(path.read_text("utf-8"))
    assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in book["cells"]]
    assert len(set(ids)) == len(ids) and all(len(one) <= 64 for one in ids)
    assert book["cells"][0]["cell_type"] == "markdown"
    for cell in book["cells"]:
        assert {"cell_type", "id", "metadata", "source"} <= set(cell)
        if cell["cell_type"] == "code":
            assert cell["execution_count"] is None and cell["outputs"] == []


@pytest.mark.slow
@by_name
def test_notebooks_run(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(medialis.Result, "_repr_html_", lambda _: "")  # pictures have their tests
    names = {"__name__": "__main__"}
    shown = [run_cell(code, names) for code in cells(path, "code")]
    texts = [repr(value) for value in shown if value is not None]
    assert texts and all(len(text) <= LONGEST_TEXT for text in texts), max(texts, key=len)
    assert capsys.readouterr().out
