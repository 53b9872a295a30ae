"""`run` with the options of each operation in its signature, for editors: see `run.pyi`."""

from medialis.show.result import run as run
