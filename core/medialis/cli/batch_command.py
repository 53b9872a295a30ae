"""The command `medialis batch`: its options in, a summary and an exit code out."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from medialis.base.errors import Cancelled, InvalidOptionError
from medialis.base.options import NUMBERS, Kind
from medialis.cli.arguments import EXIT_CANCELLED, EXIT_OK, EXIT_SOME_FAILED, number
from medialis.cli.display import clear_bar, say, shown_progress
from medialis.operations.declaration import Operation
from medialis.operations.registry import operation


def run_batch(options: argparse.Namespace) -> int:
    """Run a batch and return the exit code."""
    from medialis.batches.batch import batch
    from medialis.batches.jobs import FAILED, TABLES
    from medialis.formats.json_npz import json_text

    progress = shown_progress(options.progress, batch=True)
    try:
        rows = batch(
            [name.strip() for name in options.operations.split(",")],
            options.files,
            options.output,
            parameters={**settings(options.set), "read_shape": {"unit": options.unit}},
            workers=options.scheduler or options.workers,
            picture=not options.no_picture,
            report=options.report,
            progress=progress,
        )
    except (KeyboardInterrupt, Cancelled):
        clear_bar()
        say(
            "medialis: cancelled; what is finished stays, the same command goes on from there.",
            file=sys.stderr,
        )
        return EXIT_CANCELLED
    for message in progress.messages:
        if message.level >= logging.WARNING:
            say(f"warning: {message}", file=sys.stderr)
    bad = [row for row in rows if row.status == FAILED]
    if options.json:
        say(json_text([asdict(row) for row in rows]))
    else:
        groups: dict[tuple[str, str], list[str]] = {}
        for row in bad:
            groups.setdefault((row.file, row.sentence), []).append(row.operation)
        for (file, sentence), names in groups.items():
            say(f"failed: {', '.join(names)} of {file}: {sentence}")
        say(f"{len(rows) - len(bad)} results, {len(bad)} failed")
        for name in TABLES:
            say(Path(options.output) / name)
    return EXIT_SOME_FAILED if bad else EXIT_OK


def settings(given: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Parse OPERATION.PARAMETER=VALUE into the parameters of each operation.

    Raises
    ------
    InvalidOptionError
        For another form, or an unknown operation.
    """
    result: dict[str, dict[str, Any]] = {}
    for text in given:
        place, equals, value = text.partition("=")
        name, dot, key = place.partition(".")
        if not equals or not dot:
            raise InvalidOptionError(
                f"--set must be OPERATION.PARAMETER=VALUE, such as thickness.threshold=0.02; got "
                f"{text!r}."
            )
        chosen = operation(name)
        key = key.replace("-", "_")
        result.setdefault(chosen.name, {})[key] = _value(chosen, key, value)
    return result


def _value(chosen: Operation, key: str, text: str) -> Any:
    """Convert the text of a parameter; what is no value of its kind goes on to the check."""
    kind = next((p.kind for p in chosen.parameters if p.name == key), None)
    if kind is Kind.BOOL:
        return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}.get(
            text.lower(), text
        )
    return number(text) if kind in NUMBERS and kind is not Kind.LENGTH else text
