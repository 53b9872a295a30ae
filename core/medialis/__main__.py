"""``python -m medialis``: the command line."""

import sys

from medialis.cli import main

sys.exit(main())
