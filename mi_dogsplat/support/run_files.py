"""What tells the folder of a run, by the names of its files."""

from __future__ import annotations

from collections.abc import Collection


def are_of_run(files: Collection[str]) -> bool:
    """Whether these are the files of a run, which has settings and a history."""
    return "config.json" in files and any(file.endswith(".jsonl") for file in files)
