"""Ctrl-C while the command ``dogsplat`` loads its packages, before anything in it could catch what Python raises."""

from __future__ import annotations

import os
import signal
import sys
import threading
from itertools import pairwise
from pathlib import PurePath
from types import FrameType
from typing import NoReturn

SCRIPTS = ("dogsplat", "dogsplat.exe", "dogsplat-script.py")  # as installers call it, on Windows too
INTERRUPTED = 128 + signal.SIGINT


def end_when_interrupted() -> None:
    """From now on Ctrl-C ends the process at once, without a word: nothing is done yet.

    Only in the command: a program that imports the package goes on getting ``KeyboardInterrupt``. Where Ctrl-C is
    ignored, as in what a shell runs in the background, it stays so.
    """
    here = threading.current_thread() is threading.main_thread()
    if here and _is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def raise_when_interrupted() -> None:
    """From now on Ctrl-C raises ``KeyboardInterrupt`` again, for whoever catches it."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    os._exit(INTERRUPTED)


def _is_command() -> bool:
    """Whether this process is ``dogsplat``, or ``python -m mi_dogsplat``."""
    script = PurePath(sys.argv[0]).name.lower() if sys.argv else ""
    return script in SCRIPTS or ("-m", "mi_dogsplat") in pairwise(sys.orig_argv)
