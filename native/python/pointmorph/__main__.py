"""``python -m pointmorph`` is the command line."""

import sys

from pointmorph.cli import main

sys.exit(main())
