"""Standard streams, also where whoever started the program has closed some of them, or lacks a letter of ours."""

from __future__ import annotations

import os
import sys
from io import TextIOWrapper


def open_closed_streams() -> None:
    """Put the null device where a standard stream is closed (``dogsplat info FILE >&-``): Python has None there.

    Its descriptor is filled too, so that no file that is opened later becomes what others take for standard output.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is not None:
            continue
        null = os.open(os.devnull, os.O_RDWR)
        if null != number and not _is_open(number):
            os.dup2(null, number)
        setattr(sys, name, open(null, mode, encoding="utf-8"))  # noqa: SIM115, as long as the process


def print_every_character() -> None:
    """Standard output shows what its encoding lacks as an escape, as standard error does: the μ of PSNR-μ in cp1252."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def let_go_of_closed_terminals() -> None:
    """Throw away what is left for a stream whose terminal was closed: at its end Python would write it once more, fail,
    and turn the status into 120."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
