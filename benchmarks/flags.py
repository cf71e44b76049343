"""Types of flags: what is none is refused by argparse, in one line that names the flag."""

from __future__ import annotations

import argparse


def at_least_one(text: str) -> int:
    """A number of rounds, pixels or primitives."""
    if (number := int(text)) < 1:
        raise argparse.ArgumentTypeError(f"{number} is none: 1 at least")
    return number


def part(text: str) -> float:
    """A part of 1."""
    if not 0 <= (number := float(text)) <= 1:
        raise argparse.ArgumentTypeError(f"{text} is no part: 0 to 1")
    return number
