"""Settings of a training on photographs without poses: what is wrong with them shows before these are looked for."""

from __future__ import annotations

from pathlib import Path

from ..datasets.dataset import view_name
from ..datasets.depths import depth_files
from ..datasets.exr import is_exr
from ..datasets.lengths import require_images
from ..datasets.named_like_images import composed
from ..datasets.scans.apps import is_scan
from ..poses.input import find_photographs, is_video, mask_folder
from ..poses.panoramas import SIDES
from ..poses.photographs import solid_name
from ..report.run_folder import POSED
from ..support.errors import DataError
from ..training.config import TrainConfig
from ..training.resolve import require_same_light
from .resume import require_no_stopped_run


def check_unposed(config: TrainConfig, out: Path, resume: bool = False) -> None:
    """Raise the ``DataError`` that a training with these settings into the run folder ``out`` would raise after the
    search for poses, as far as that, and the names of the photographs, or that they are frames of a video or a scan,
    tell."""
    if not resume:
        require_no_stopped_run(out)
    source = Path(config.data)
    if config.depths is not None and not Path(config.depths).is_dir():
        raise DataError(config.depths, "no such folder", "give a folder with a depth map per image")
    photographs = {}
    if not is_video(source) and not is_scan(source):
        photographs = find_photographs(source, out / POSED, mask_folder(source, config.masks))
    require_same_light(config, any(map(is_exr, photographs.values())))
    if not photographs:
        return
    names = [solid_name(name) for name in photographs]
    names += [f"{side}/{name}" for side in SIDES for name in names]  # of the views of panoramas, if they are some
    if config.scale is not None:
        require_images(config.scale[:2], names)
    if config.depths is not None:
        maps = depth_files(Path(config.depths))
        if not any(composed(view_name(name)) in maps for name in names):
            remedy = f"name them like the images, as {view_name(names[0])}.png"
            raise DataError(config.depths, "has no depth map for any of the images", remedy)
