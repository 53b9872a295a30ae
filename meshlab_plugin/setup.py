# SPDX-License-Identifier: GPL-3.0-or-later
"""Put the .pth file beside the packages of the wheel; the rest is in pyproject.toml."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

STARTED = "medialis_meshlab.pth"


class WithStart(build_py):
    """Builds the packages, and what Python runs when it starts."""

    def run(self) -> None:
        """Build all."""
        super().run()
        self.copy_file(STARTED, str(Path(self.build_lib) / STARTED))


setup(cmdclass={"build_py": WithStart})
