"""``python -m pointmorph`` is the command line."""

import sys

from pointmorph.commands.cli import main

sys.exit(main())
