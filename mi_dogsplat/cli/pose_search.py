"""A search for poses as the commands show it."""

from __future__ import annotations

from pathlib import Path

from ..poses.config import PosesConfig
from .errors import resumable


def search_poses(source: Path, out: Path, config: PosesConfig) -> None:
    """Write the data set ``out`` while bars show how far it is, then print what was found. Stopped, it is resumable."""
    from ..poses.run import find_poses
    from .progress import StageBars

    with resumable(), StageBars() as bars:
        summary = find_poses(source, out, config, bars.show)
    print("\n".join(summary.lines()), flush=True)
