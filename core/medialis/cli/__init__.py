"""The command line: one subcommand for each operation, made from the registry, and some more.

`main` takes words and returns an exit code: 0 done, 1 a check is not passed (`--fail`), 2 bad input
or options, 3 some of a batch failed, 130 cancelled; what goes wrong is one line on stderr.
`arguments.py` says what each command takes, `commands.py` what it does (read this one first),
`doctor.py` what is installed and what is missing, and `display.py` what a person sees. A new
operation needs nothing here. Another command: its arguments in `build_parser`, its function in
`COMMANDS`; completion and help follow.
"""

from medialis.cli.commands import main

__all__ = ["main"]
