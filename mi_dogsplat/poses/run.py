"""From photographs or a video to a COLMAP folder, stage by stage.

The folder holds ``poses.json`` (the settings, written first), ``work/`` (COLMAP's database, and how far the stages
are), ``images/``, ``masks/`` if there are any, ``summary.json``, and last ``sparse/0``. So what was interrupted is no
data set yet, and the same command goes on where it stopped. With ``--undistort`` the photographs and their model lie
in ``distorted/``.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets.masks import mask_files
from ..datasets.world import write_world
from ..support.errors import DataError
from ..support.files import read_json, remove_parts, write_json
from ..support.locks import locked
from ..support.resumable import begin
from ..support.settings import refuse
from .advice import TAKE_MORE, Advice, Outcome, advice_on_capture, advice_on_model, hopeless
from .colmap_database import pycolmap_module
from .config import FREE, SETTINGS, PosesConfig
from .evidence import Evidence, gather
from .features import extract
from .frames import CHOICE, take_frames
from .input import find_photographs, is_video, mask_folder, require_input
from .mapping import reconstruct
from .matching import match
from .output import undistort, write_model
from .photographs import Photograph, prepare, prepare_masks
from .summary import Summary, camera_line, field_of_view
from .video import require_av
from .world import Placed, place

SUMMARY = "summary.json"
DATABASE, SECONDS, COPIED = "work/database.db", "work/seconds.json", "work/copied.json"
Progress = Callable[[str, int, int], None]


@dataclass
class Stages:
    """Tells the progress of each stage, and keeps the time that each has taken, over all starts."""

    file: Path
    progress: Progress

    def __post_init__(self) -> None:
        self.seconds: dict[str, float] = read_json(self.file, "remove the file") if self.file.is_file() else {}

    @contextmanager
    def of(self, name: str) -> Iterator[Callable[[int, int], None]]:
        """The progress of one stage: called with what is done and of how many, 0 where nobody knows."""
        start = time.monotonic()
        try:
            yield lambda done, n: self.progress(name, done, n)
        finally:
            self.seconds[name] = round(self.seconds.get(name, 0.0) + time.monotonic() - start, 2)
            write_json(self.file, self.seconds)


def find_poses(
    source: str | Path, out: str | Path, config: PosesConfig, progress: Progress = lambda stage, done, n: None
) -> Summary:
    """Fill the folder ``out`` with poses of the images of ``source``, a folder or a video, or what is missing there.

    ``progress`` gets the name of a stage, what is done, and of how much. Raises ``DataError`` for what cannot be read,
    for a folder with other contents, and for a capture of which no model could be made, with the reason.
    """
    source, out = Path(source), Path(out)
    require_input(source)
    if out.resolve() == source.resolve():
        raise DataError(out, "is the folder of the photographs itself", "name another one for the poses")
    if config.frames is not None and not is_video(source):
        refuse("frames", f"is for videos, and {source} is a folder of images", "leave it out")
    pycolmap = pycolmap_module(config.gpu)
    masks = mask_folder(source, config.masks)
    sources = {} if is_video(source) else find_photographs(source, out, masks)
    if not sources:
        require_av()
    top = out / "distorted" if config.undistort else out
    free = FREE if _model_folder(top).is_dir() else (*FREE, "scale")  # it is measured in the model, once there is one
    settings = _settings(source, sources or {source.name: source}, masks, config)
    if not (out / DATABASE).is_file():  # nothing is known of the images yet: one that cannot be read may be left out
        free = (*free, "source_sha256", "masks_sha256")
    begin(out / SETTINGS, settings, "search for poses", free)
    with locked(out, "another process is looking for poses in it"):
        remove_parts(out)
        if not is_done(out):
            (out / DATABASE).parent.mkdir(exist_ok=True)
            stages = Stages(out / SECONDS, progress)
            if not _model_folder(top).is_dir():
                _forget_copies_of_others(out, top, [settings["source_sha256"], settings["masks_sha256"]])
                _reconstruct(pycolmap, source, sources, masks, out, top, config, stages)
            if config.undistort:
                _undistort(pycolmap, top, out, stages)
        return _summary(out)


def is_done(out: Path) -> bool:
    """Whether a folder holds poses that ``find_poses`` has found."""
    return (out / SETTINGS).is_file() and _model_folder(out).is_dir()


def _model_folder(top: Path) -> Path:
    return top / "sparse" / "0"


def _settings(source: Path, files: Mapping[str, Path], masks: Path | None, config: PosesConfig) -> dict[str, Any]:
    """What decides on the poses: the flags, and the images and masks by their names and sizes."""
    digest = {"source_sha256": _digest(files), "masks_sha256": _digest(mask_files(masks)) if masks else None}
    settings = {"source": str(source), **digest, **dataclasses.asdict(config)}
    return json.loads(json.dumps(settings))  # as they are read again


def _digest(files: Mapping[str, Path]) -> str:
    listed = json.dumps([[file.name, file.stat().st_size] for file in dict.fromkeys(files.values())]).encode()
    return hashlib.sha256(listed).hexdigest()


def _forget_copies_of_others(out: Path, top: Path, source: list[str | None]) -> None:
    """Before there is a database: remove what was copied, or chosen of a video, unless it is of this ``source``, which
    are the digests of images and masks."""
    copied = out / COPIED
    if (out / DATABASE).is_file() or (copied.is_file() and read_json(copied, "remove the file") == source):
        return
    for folder in (top / "images", top / "masks"):
        if folder.is_dir():
            shutil.rmtree(folder)
    (out / DATABASE).with_name(CHOICE).unlink(missing_ok=True)
    write_json(copied, source)


def _reconstruct(
    pycolmap: Any, source: Path, sources: dict[str, Path], masks: Path | None, out: Path, top: Path,
    config: PosesConfig, stages: Stages,
) -> None:  # fmt: skip
    """All stages up to a model in ``top``, and its summary in ``out``."""
    images, database = top / "images", out / DATABASE
    with stages.of("images") as progress:
        if sources:
            photographs = prepare(sources, images, progress)
        else:
            photographs = take_frames(source, database.with_name(CHOICE), images, config.frames, progress)
        n_masks = prepare_masks(masks, photographs, top / "masks") if masks else 0
    with stages.of("features") as progress:
        extract(pycolmap, database, images, top / "masks" if n_masks else None, photographs, config, progress)
    with stages.of("matching") as progress:
        match(pycolmap, database, not sources, config, progress)
    evidence = gather(pycolmap, database)
    if hopeless(evidence):
        raise _nothing_found(source, evidence)
    with stages.of("mapping") as progress:
        models = reconstruct(pycolmap, database, images, len(photographs), config, progress)
    if not models:
        raise _nothing_found(source, evidence)
    downs = {p.name: np.array(p.down) for p in photographs if p.down is not None}
    placed = place(pycolmap, models[0], config.scale, downs)
    summary = _summary_of(models, photographs, evidence, config, placed, n_masks, stages.seconds)
    write_json(out / SUMMARY, dataclasses.asdict(summary))
    for folder in {out, top}:  # two data sets with --undistort
        write_world(folder, placed.world)
    write_model(models[0], _model_folder(top))


def _summary_of(
    models: list[Any], photographs: list[Photograph], evidence: Evidence, config: PosesConfig,
    placed: Placed, n_masks: int, seconds: dict[str, float],
) -> Summary:  # fmt: skip
    """What is told of the first of the ``models``, which is the data set."""
    names = [{image.name for image in model.images.values() if image.has_pose} for model in models]
    others = tuple(n for n in (len(more - names[0]) for more in names[1:]) if n)
    error = float(models[0].compute_mean_reprojection_error())
    shrunk = min(1.0, config.feature_size / max(max(p.width, p.height) for p in photographs))
    cameras = [camera for _, camera in sorted(models[0].cameras.items())]
    guessed = [field_of_view(camera) for camera in cameras if not camera.has_prior_focal_length]
    outcome = Outcome(len(photographs), len(names[0]), others, error * shrunk, tuple(guessed))
    return Summary(
        n_images=len(photographs),
        n_registered=len(names[0]),
        n_points=models[0].num_points3D(),
        error=error,
        observations=float(models[0].compute_mean_observations_per_reg_image()),
        cameras=[camera_line(camera) for camera in cameras],
        n_masks=n_masks,
        up_from=placed.up_from,
        scale=placed.world.scale,
        without_pose=[p.name for p in photographs if p.name not in names[0]],
        advice=[str(a) for a in advice_on_capture(evidence) + advice_on_model(outcome)],
        seconds=seconds,
    )


def _nothing_found(source: Path, evidence: Evidence) -> DataError:
    reason = [*advice_on_capture(evidence), Advice("no two images are far enough apart to begin with", TAKE_MORE)][0]
    return DataError(source, f"no poses found: {reason.problem}", reason.remedy)


def _undistort(pycolmap: Any, top: Path, out: Path, stages: Stages) -> None:
    """What is in ``top`` without its lens, in ``out``."""
    with stages.of("undistortion") as progress:
        model = undistort(pycolmap, top, out, progress)
    write_json(out / SUMMARY, dataclasses.asdict(_summary(out)) | {"seconds": stages.seconds})
    write_model(model, _model_folder(out))


def _summary(out: Path) -> Summary:
    remedy = "remove the folder, and begin anew"
    try:
        return Summary(**read_json(out / SUMMARY, remedy))
    except TypeError as error:
        raise DataError(out / SUMMARY, f"is no summary ({error})", remedy) from error
