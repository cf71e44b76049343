"""The apps whose scans are read, and which of them has made a folder."""

from __future__ import annotations

from pathlib import Path

from . import polycam, record3d, stray_scanner
from .scan import Scan

APPS = (polycam, record3d, stray_scanner)


def is_scan(path: Path) -> bool:
    """Whether a path is the folder of a scan. Raises ``DataError`` for one that has to be exported otherwise."""
    return path.is_dir() and any(app.find(path) for app in APPS)


def read_scan(path: Path) -> Scan:
    """The scan of a folder that is one. Raises ``DataError``."""
    for app in APPS:
        if folder := app.find(path):
            return app.read(folder)
    raise ValueError(f"{path} is no scan")
