"""What is told of the depth maps of a run: by its report, and by ``dogsplat info``."""

from __future__ import annotations

from typing import Any

from ..support.wording import count, finite, fixed


def told_of_depth_maps(metrics: dict[str, Any]) -> str | None:
    """How many views learned from depth maps, and what these hold, by ``metrics.json``; None for runs without any."""
    known = metrics.get("depths") or {}
    views, used, error = (finite(known.get(name)) for name in ("views", "used", "error"))
    if views is None or used is None:
        return None
    kind = "inverse depth" if known.get("inverse") is True else "depth"
    scaled = "" if error is None else f", median error {fixed(100 * error, 1)} % at the sparse points"
    return f"{count(used)} of {count(views)} training views, {kind}{scaled}"
