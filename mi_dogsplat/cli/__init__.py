"""The command `dogsplat`."""

from .commands import main as main
