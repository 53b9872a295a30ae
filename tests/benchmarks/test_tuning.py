"""What is said beside the numbers that tune: it is what was measured, of the values that stand."""

import ast

import pytest
from tuning import FEATURES, known_numbers, pairs, read_record
from tuning_suite.numbers import (
    PACKAGE,
    WAYS,
    is_read_at_import,
    module_of,
    other_values,
    percent,
    with_comments,
)

MODULES = {
    module_of(path): path for folder in FEATURES for path in sorted((PACKAGE / folder).glob("*.py"))
}


def test_the_record_is_of_the_values_in_the_code():
    """`python benchmarks/tuning.py FOLDER` measures anew what has another value."""
    record, known = read_record(), known_numbers()
    assert record
    for key, entry in record.items():
        assert key in known, f"{key} is gone: `python benchmarks/tuning.py --write` drops it"
        assert entry["value"] == known[key].value, key
        assert set(entry) - {"value", "reached"} == set(other_values(known[key])), key


@pytest.mark.parametrize("module", MODULES)
def test_what_is_said_beside_numbers_is_what_the_record_says(module):
    """`python benchmarks/tuning.py --write` writes it."""
    source = MODULES[module].read_text(encoding="utf-8")
    assert with_comments(module, source, read_record()) == source


def made_up(change):
    return {
        number.key: {"reached": 1, **{way: [0.0, change, ""] for way in other_values(number)}}
        for number in known_numbers().values()
    }


@pytest.mark.parametrize("module", ["medialis.rigging.limbs", "medialis.walls.ribs"])
def test_writing_replaces_what_was_said_and_changes_nothing_else(module):
    source = MODULES[module].read_text(encoding="utf-8")
    once = with_comments(module, source, made_up(0.034))
    assert once.count("halved 3 %") > 10 and max(map(len, once.splitlines())) <= 100
    assert ast.dump(ast.parse(once)) == ast.dump(ast.parse(source))
    assert with_comments(module, once, made_up(0.034)) == once
    assert with_comments(module, once, read_record()) == with_comments(
        module, source, read_record()
    )
    assert "# halved" not in with_comments(module, once, {})


def test_changes_are_said_in_few_characters():
    said = [percent(change) for change in (0.0, 1e-12, 0.004, 0.034, 0.5, 1.0)]
    assert said == ["0 %", "< 0.1 %", "0.4 %", "3 %", "50 %", "100 %"]


@pytest.mark.slow
def test_a_number_moves_the_same_in_this_process_and_in_its_own():
    """And one that has the value that stands moves nothing, however much is kept."""
    from tuning_suite.runs import Base, in_own_process

    number = known_numbers()["rigging.limbs.TAPER"]
    base, chosen = Base(), [pair for pair in pairs("rigging") if pair[1] == "creature"][:1]
    assert base.reads(chosen[0], number) and not is_read_at_import(number)
    assert not base.reads(chosen[0], known_numbers()["walls.ribs.WIDER"])
    before = [base.result(pair) for pair in chosen]
    assert base.with_value(number, number.value, chosen) == before
    moved = {way: base.with_value(number, other_values(number)[way], chosen) for way in WAYS}
    assert moved["halved"] != before
    assert moved["halved"] == in_own_process(number, other_values(number)["halved"], chosen)
    assert base.with_value(number, number.value, chosen) == before
