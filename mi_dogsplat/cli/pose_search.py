"""A search for poses, or the reading of a scan that has some, as the commands show it."""

from __future__ import annotations

from pathlib import Path

from ..poses.config import PosesConfig
from ..support.wording import printable
from .errors import resumable
from .printing import say


def search_poses(source: Path, out: Path, config: PosesConfig) -> None:
    """Write the data set ``out`` while bars show how far it is, then print what was found. Stopped, it is resumable."""
    from ..datasets.scans.apps import is_scan
    from ..poses.input import not_taken
    from ..poses.run import find_poses
    from ..poses.scan import take_scan
    from .progress import StageBars

    scanned = is_scan(source)
    for line in [] if scanned else not_taken(source, Path(config.masks) if config.masks else None):
        say(printable(f"{source}: not read: {line}"))
    with resumable(), StageBars() as bars:
        summary = (take_scan if scanned else find_poses)(source, out, config, bars.show)
    print("\n".join(summary.lines()), flush=True)
