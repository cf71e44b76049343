"""The one exception for bad input: it names the file, what is wrong and what to do, on one line."""

from __future__ import annotations

from pathlib import Path


class DataError(ValueError):
    """Bad input. ``str(e)`` is one line: ``<path>: <problem>; <remedy>``.

    The command line prints that line and exits with status 2; as a library the exception is a ``ValueError``.
    """

    def __init__(self, path: str | Path, problem: str, remedy: str):
        super().__init__(" ".join(f"{path}: {problem}; {remedy}".split()))
        self.path = Path(path)
