"""From a scan by an app of a phone to a COLMAP folder: its photographs, poses and depth maps are there already.

The folder is that of a search for poses (``run.py``), with ``depth/`` beside ``images/``, and ``masks/`` where the app
has left the photographs black borders. Its points are those of the depth maps.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ..datasets.colmap_write import write_colmap
from ..datasets.depth_files import read_depth
from ..datasets.depth_points import depth_points
from ..datasets.images import image_size, read_image, stored
from ..datasets.scans.apps import read_scan
from ..datasets.scans.scan import REMEDY, Scan, ScanFrame
from ..datasets.world import World, write_world
from ..scene.cameras import Camera, affine, inverse_rigid
from ..scene.orientation import UP, up_of_cameras
from ..support.arguments import checks_arguments
from ..support.classes import require_class
from ..support.errors import DataError
from ..support.files import read_json, remove_parts, replacing, write_json
from ..support.locks import locked
from ..support.resumable import begin
from ..support.settings import refuse
from .borders import black_border, write_border_masks
from .config import FREE, SETTINGS, PosesConfig
from .frame_choice import SMALL
from .frames import CHOICE, choose_frames, take_frames
from .output import appearing
from .photographs import readable
from .run import Progress, digest, is_done, model_folder
from .scan_depth import depth_file, write_depth
from .scan_summary import ScanSummary
from .world import upright

SEARCHED = ("lens", "masks", "linear", "undistort", "scale")  # settings of structure from motion alone


@checks_arguments
def take_scan(
    source: str | Path, out: str | Path, config: PosesConfig, progress: Progress = lambda stage, done, n: None
) -> ScanSummary:
    """Fill the folder ``out`` with the photographs, poses, depth maps and points of a scan, or what is missing there.

    ``progress``: see ``find_poses``. Raises ``DataError`` for what cannot be read, for settings that are of structure
    from motion, and for a folder with other contents.
    """
    require_class("take_scan: how it is read", config, PosesConfig, "give a PosesConfig")
    source, out = Path(source), Path(out)
    for name in SEARCHED:
        if getattr(config, name) != getattr(PosesConfig(), name):
            refuse(name, f"is for photographs without poses, and {source} is a scan with poses", "leave it out")
    scan = read_scan(source)
    begin(out / SETTINGS, _settings(source, scan, config), "search for poses", FREE)
    with locked(out, "another process is looking for poses in it"):
        remove_parts(out)
        if not is_done(out):
            _take(scan, out, config.frames, progress)
        return ScanSummary.read(out)


@dataclass(frozen=True, eq=False)
class _Taken:
    """A frame whose image is in the data set, and the camera of that."""

    frame: ScanFrame
    camera: Camera


def _settings(source: Path, scan: Scan, config: PosesConfig) -> dict[str, Any]:
    files = [file for frame in scan.frames for file in (frame.image, frame.depth, frame.confidence) if file]
    named = {str(file): file for file in [scan.video, *files] if file}
    settings = {"source": str(source), "source_sha256": digest(named), **dataclasses.asdict(config)}
    return json.loads(json.dumps(settings))  # as they are read again


def _take(scan: Scan, out: Path, n: int | None, progress: Progress) -> None:
    images, depths = out / "images", out / "depth"
    frames = _images(scan, out, n, lambda done, of: progress("images", done, of))
    taken = [_Taken(frame, _camera(images / frame.name, frame)) for frame in frames]
    border = black_border([images / frame.name for frame in frames]) if scan.corrected else None
    n_masks = 0 if border is None else write_border_masks(border, [frame.name for frame in frames], out / "masks")
    shares: list[float] = []
    for done, one in enumerate(taken, 1):
        if one.frame.depth:
            shares.append(write_depth(one.frame, depths))
        progress("depth maps", done, len(taken))
    taken, up_from = _placed(taken, scan.up)
    n_depths = sum(share > 0 for share in shares)
    points, colors = depth_points(_with_depths(taken, images, depths), max(1, n_depths))
    middle = np.median(points, axis=0) if len(points) else np.zeros(3)
    moved = [(one.frame.name, _moved(one.camera, affine(np.eye(3), -middle))) for one in taken]
    known = float(np.mean(shares)) if shares else 0.0
    summary = ScanSummary(scan.app, len(taken), scan.corrected, len(points), n_depths, known, n_masks, up_from)
    summary.write(out)
    write_world(out, World(UP, 1.0))
    with appearing(model_folder(out)) as folder:
        write_colmap(folder, moved, points - middle, colors)


def _images(scan: Scan, out: Path, n: int | None, progress: Callable[[int, int], None]) -> list[ScanFrame]:
    """Write the images of the chosen frames, unless they are there; the frames."""
    images, choice = out / "images", out / "work" / CHOICE
    choice.parent.mkdir(exist_ok=True)
    by_number = {frame.number: frame for frame in scan.frames}
    if scan.video:
        names = {p.name for p in take_frames(scan.video, choice, images, n, progress, len(scan.frames), turned=False)}
        return [frame for frame in scan.frames if frame.name in names]
    if not choice.is_file():
        all_of_them = scan.keyframes and n is None
        greys = ((frame.number, _grey(frame.image)) for frame in scan.frames if frame.image)
        write_json(choice, list(by_number) if all_of_them else choose_frames(greys, n, progress))
    frames = [by_number[number] for number in read_json(choice, REMEDY)]
    for done, frame in enumerate(frames, 1):
        if frame.image and not (images / frame.name).is_file():
            with replacing(images / frame.name) as part:
                shutil.copyfile(frame.image, part)
        progress(done, len(frames))
    return frames


def _grey(file: Path) -> np.ndarray:
    """A small picture [H, W] in 0..1 of an image."""
    with readable(file) as image:
        image.draft("L", (SMALL, SMALL))
        grey = stored(image).convert("L")
    grey.thumbnail((SMALL, SMALL), Image.Resampling.BOX)
    return np.asarray(grey, np.float32) / 255


def _camera(image: Path, frame: ScanFrame) -> Camera:
    try:
        return frame.camera(*image_size(image))
    except ValueError as error:
        raise DataError(image, f"has no camera that can be used ({error})", REMEDY) from None


def _placed(taken: Sequence[_Taken], up: np.ndarray | None) -> tuple[list[_Taken], str]:
    """The frames in a world whose up is -y, and how that was found, in words."""
    c2w = np.stack([one.camera.c2w for one in taken])
    up_from = "as the cameras were held" if up is None else "by gravity"
    turn = affine(upright(c2w, up_of_cameras(c2w) if up is None else up))
    return [_Taken(one.frame, _moved(one.camera, turn)) for one in taken], up_from


def _moved(camera: Camera, rigid: np.ndarray) -> Camera:
    """A camera after the world has been moved by a rigid matrix [4, 4]."""
    return dataclasses.replace(camera, w2c=camera.w2c @ inverse_rigid(rigid))


def _with_depths(
    taken: Sequence[_Taken], images: Path, depths: Path
) -> Iterator[tuple[Camera, np.ndarray, np.ndarray]]:
    """What ``depth_points`` takes, of those frames that have a depth map in the data set."""
    for one in taken:
        if (file := depth_file(one.frame, depths)).is_file():
            yield one.camera, read_depth(file), read_image(images / one.frame.name)
