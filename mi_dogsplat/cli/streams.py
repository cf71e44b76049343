"""Standard streams, also where whoever started the program has closed some of them, or lacks a letter of ours."""

from __future__ import annotations

import errno
import os
import sys
from io import TextIOWrapper
from typing import TextIO


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


def is_unread(error: OSError) -> bool:
    """Whether nobody reads a stream any more, as after its terminal was closed; a full disk is something else."""
    return isinstance(error, BrokenPipeError) or error.errno == errno.EIO


def discard(stream: TextIO) -> None:
    """Throw away what a stream still holds, and what is written to it from now on."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, stream.fileno())
    os.close(null)


def discard_unread() -> None:
    """The same of those that nobody reads any more: Python would write what is left once more at its end, fail, and
    turn the status into 120."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            discard(stream)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
