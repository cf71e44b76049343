"""The model of a run as files: ``point_cloud.ply``, and beside it one in the format that it was trained for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..formats.sizes import by_part, encoded
from ..scene.drawing import Drawing, comments_of
from ..scene.ply import write_ply
from ..scene.splats import Splats
from ..support.files import replacing
from ..training.config import FORMATS, TrainConfig

STEM = "point_cloud"


def write_model_files(out: Path, splats: Splats, config: TrainConfig) -> dict[str, Any]:
    """Write them, and remove those of an earlier run in other formats.

    Returns ``bytes`` of the file in the format of the run and, where that is not plain, ``bytes_by_part``.
    A PLY file that has to meet a size holds no more bands than its primitives have (layout "rows" of ``write_ply``).
    """
    for name in set(FORMATS) - {"ply", config.format}:
        (out / f"{STEM}.{name}").unlink(missing_ok=True)
    ply, sized = out / f"{STEM}.ply", config.target_bytes is not None
    comments = comments_of(Drawing(config.antialiased, config.near_clip, linear=False))
    write_ply(ply, splats, "rows" if sized and config.format == "ply" else "3dgs", comments)
    if config.format == "ply":
        size, parts = ply.stat().st_size, by_part("ply", splats) if sized else {}
    else:
        content = encoded(config.format, splats)
        with replacing(out / f"{STEM}.{config.format}") as part:
            part.write_bytes(content)
        size, parts = len(content), by_part(config.format, splats)
    return {"bytes": size} | ({"bytes_by_part": parts} if parts else {})
