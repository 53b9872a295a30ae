"""The signature of `run` for editors is that of the registry."""

import make_run_signatures


def test_the_stub_is_of_these_operations():
    """After a change of options: python docs/make_run_signatures.py."""
    assert make_run_signatures.STUB.read_text("utf-8") == make_run_signatures.stub()
