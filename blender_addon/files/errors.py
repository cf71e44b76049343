"""The one exception for bad input: it names the file, what is wrong and what to do, on one line."""

from __future__ import annotations

from pathlib import Path


class FileError(ValueError):
    """``str(e)`` is one line: ``<path>: <problem>; <remedy>``. Operators show it as it is."""

    def __init__(self, path: str | Path, problem: str, remedy: str):
        super().__init__(" ".join(f"{path}: {problem}; {remedy}".split()))
