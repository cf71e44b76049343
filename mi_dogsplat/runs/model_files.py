"""The model of a run as files: ``point_cloud.ply``, and beside it one in the format that it was trained for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..formats.model import Model
from ..formats.sizes import FileKind, by_part
from ..formats.write import write_model
from ..report.run_folder import MODEL
from ..scene.drawing import Drawing
from ..scene.splats import Splats
from ..support.files import write_bytes
from ..training.config import FORMATS, TrainConfig

STEM = Path(MODEL).stem


def model_files(out: Path) -> list[Path]:
    """What the model of a run may be called, by its format: a run replaces some of them, and removes the others."""
    return [out / f"{STEM}.{name}" for name in FORMATS]


def write_model_files(out: Path, splats: Splats, config: TrainConfig, drawing: Drawing) -> dict[str, Any]:
    """Write them, and remove those of an earlier run in other formats.

    Returns ``bytes`` of the file in the format of the run and, where that is not plain, ``bytes_by_part``.
    A PLY file that has to meet a size holds no more bands than its primitives have (layout "rows" of ``write_ply``).
    """
    for name in set(FORMATS) - {"ply", config.format}:
        (out / f"{STEM}.{name}").unlink(missing_ok=True)
    kind, sized = FileKind(config.format, drawing), config.target_bytes is not None
    if sized or config.format != "ply":
        write_bytes(out / f"{STEM}.{config.format}", kind.encoded(splats))
    if not sized or config.format != "ply":
        write_model(out / f"{STEM}.ply", Model(splats, drawing))
    size = (out / f"{STEM}.{config.format}").stat().st_size
    return {"bytes": size} | ({"bytes_by_part": by_part(kind, splats)} if sized or config.format != "ply" else {})
