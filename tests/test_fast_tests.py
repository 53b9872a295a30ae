"""What `make test-fast` leaves out: no folder of tests, and no operation."""

from pathlib import Path

import pytest

from medialis.operations.registry import OPERATIONS

TESTS = Path(__file__).parent
RUNS_EACH = "tests/operations/test_operations.py::test_layers_on_the_input_have_its_points"


@pytest.fixture(scope="module")
def fast(request) -> set[str]:
    """Return the tests that are not slow; a run of some folders cannot tell."""
    items = request.session.items
    files = set(TESTS.rglob("test_*.py")) - set((TESTS / "blender").iterdir())
    if len({item.path for item in items} & files) < 0.9 * len(files):
        pytest.skip("looks at all tests together")
    return {item.nodeid for item in items if item.get_closest_marker("slow") is None}


def test_every_folder_has_fast_tests(fast):
    folders = {path.parent.relative_to(TESTS.parent) for path in TESTS.rglob("test_*.py")}
    folders -= {Path("tests/blender")}  # has a target of its own
    assert folders == {Path(name.split("::")[0]).parent for name in fast} & folders


def test_every_operation_is_run_by_a_fast_test(fast):
    assert {f"{RUNS_EACH}[{operation.name}]" for operation in OPERATIONS} <= fast
