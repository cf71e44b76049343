"""Folders that an experiment goes on with: what is kept in one is of one capture and of the same settings."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from mi_dogsplat.support.resumable import begin

SETTINGS = "settings.json"


def same_settings(out: Path, args: argparse.Namespace, place: str, names: Sequence[str]) -> None:
    """Note in a folder what its contents depend on: the path ``place`` of the arguments, and others by their names.

    Raises ``DataError`` for a folder that was begun with others: what is kept there would be told as theirs.
    """
    path = str(Path(getattr(args, place)).resolve())
    begin(out / SETTINGS, {place: path} | {name: getattr(args, name) for name in names}, "call")
