"""The command line."""

from medialis.cli.commands import main

__all__ = ["main"]
