"""What lies beside the MeshLab plugin: the Python that it runs, and the filters that this has.

``python -m medialis.cli.meshlab_notes FOLDER`` writes both, as the build of the plugin does.
"""

from __future__ import annotations

import sys
from pathlib import Path

from medialis.files._files import complete_file
from medialis.files.results import json_text
from medialis.version import package_version

PROGRAM_NOTE = "medialis-program.txt"
"""File beside the plugin: the interpreter that has medialis, one line."""

FILTER_NOTE = "medialis-filters.json"
"""File beside the plugin: its menu and its dialogs, and the medialis that they are of."""


def write_notes(folder: Path, python: str = sys.executable) -> list[Path]:
    """Write both notes into a folder and return their paths.

    Raises
    ------
    FileError
        When the folder cannot be written.
    """
    from medialis.hosts.menu import menu_entries

    table = json_text({"medialis": package_version(), "filters": menu_entries()})
    texts = {PROGRAM_NOTE: str(Path(python).absolute()), FILTER_NOTE: table}
    for name, text in texts.items():
        with complete_file(folder / name) as stream:
            stream.write(f"{text}\n".encode())
    return [folder / name for name in texts]


if __name__ == "__main__":
    write_notes(Path(sys.argv[1]))
