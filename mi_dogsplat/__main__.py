"""``python -m mi_dogsplat`` is the command ``dogsplat``."""

import sys

from .cli import main

sys.exit(main())
