"""The command ``dogsplat``."""

from .main import main as main
