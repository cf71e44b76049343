"""``python -m tests.helpers.killed_while_writing NAME ARGUMENTS``:
``dogsplat ARGUMENTS``, killed with half of NAME written."""

import os
import signal
import sys

from mi_dogsplat.cli import main

name, *arguments = sys.argv[1:]


def fsync(descriptor: int) -> None:
    """What every file goes through before it gets its name."""
    path = os.readlink(f"/proc/self/fd/{descriptor}")
    if f".{name}." in path:
        os.ftruncate(descriptor, os.fstat(descriptor).st_size // 2)
        os.kill(os.getpid(), signal.SIGKILL)


os.fsync = fsync
sys.exit(main(arguments))
