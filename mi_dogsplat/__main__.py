"""``python -m mi_dogsplat`` is the command ``dogsplat``."""

import sys

from .cli.commands import main

sys.exit(main())
