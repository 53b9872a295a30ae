"""``python -m medialis``: the command line."""

import sys

from medialis.cli.commands import main

sys.exit(main())
