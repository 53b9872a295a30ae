"""`run` with the options of each operation in its signature, for editors: see `typed_run.pyi`."""

from medialis.operations.registry import run as run
