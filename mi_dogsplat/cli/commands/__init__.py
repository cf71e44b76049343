"""The commands of ``dogsplat``, a file each: its flags, what it calls, and what it prints of what comes back.

Modules that are heavy, or belong to an extra, are imported when their command runs.
"""

from __future__ import annotations

import argparse
from typing import Protocol

from . import (
    ablate,
    capture,
    check,
    clean,
    compare,
    export,
    film,
    info,
    masks,
    mesh,
    poses,
    prune,
    render,
    serve,
    simplify,
    train,
    view,
)
from . import eval as evaluate


class Command(Protocol):
    """A module of this folder."""

    @property
    def SUMMARY(self) -> str:
        """A line in the help of the program."""
        ...

    @property
    def EXAMPLES(self) -> str:
        """What its own help says after the flags: commands to copy, and what comes of them."""
        ...

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Give its parser what it is called with."""
        ...

    def run(self, args: argparse.Namespace) -> int | None:
        """Do what it is called for, and return the exit status (None: 0); its docstring is in its help."""
        ...


COMMANDS: dict[str, Command] = {  # in the order of the help
    "train": train,
    "prune": prune,
    "ablate": ablate,
    "compare": compare,
    "render": render,
    "eval": evaluate,
    "capture": capture,
    "poses": poses,
    "masks": masks,
    "check": check,
    "export": export,
    "film": film,
    "simplify": simplify,
    "clean": clean,
    "mesh": mesh,
    "view": view,
    "serve": serve,
    "info": info,
}
