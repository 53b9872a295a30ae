"""The mechanism of operations: what one is, how it is found, run and what it gives.

It names no feature. A feature declares its operations in its own `operation.py`: names, help,
options, a `run` function, formats of its own. Every host makes its doors from these declarations.

Read `declaration.py` first: an `Operation` and its parts. `names.py` finds them as text, without
loading anything; `registry.py` has `run`, the one way in; `result.py` has layers, outcomes and
results; `positions.py` says what a position is, so that shapes far from the origin lose nothing.
"""
