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
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets.exr import is_exr
from ..datasets.lengths import require_images
from ..datasets.masks import mask_files
from ..datasets.world import write_world
from ..support.arguments import checks_arguments
from ..support.classes import require_class
from ..support.errors import DataError
from ..support.files import read_json, remove_parts, write_json
from ..support.locks import locked
from ..support.resumable import begin
from ..support.settings import refuse
from .advice import TAKE_MORE, Advice, advice_on_capture, advice_on_model, hopeless
from .colmap_database import pycolmap_module
from .config import FREE, SETTINGS, PosesConfig
from .evidence import Evidence, gather
from .feature_masks import feature_masks
from .features import extract
from .frames import CHOICE, take_frames
from .input import find_photographs, is_video, mask_folder, require_input
from .lens_choice import lens_of, lens_of_photographs
from .light import is_light, prepare_light, radiance_name
from .mapping import reconstruct
from .matching import match
from .output import renamed, undistort, write_model
from .panoramas import SIDES, cut_masks, cut_panoramas
from .photographs import Photograph, masks_of, prepare, prepare_masks, solid_name
from .rigs import tie_views
from .summary import Summary, outcome_of, summary_of
from .video import says_panorama
from .world import place

DATABASE, SECONDS, COPIED = "work/database.db", "work/seconds.json", "work/copied.json"
FEATURE_MASKS, PANORAMAS, PANORAMA_MASKS = "work/masks", "work/panoramas", "work/panorama_masks"
SHOWN = "work/shown"
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


@dataclass(frozen=True)
class Search:
    """What is looked for, and where: poses of the images of ``source``, into the folder ``out``.

    ``photographs``: files by their names in ``source``; none of a video. ``masks``: their folder, None without one.
    """

    source: Path
    photographs: Mapping[str, Path]
    masks: Path | None
    out: Path
    config: PosesConfig

    @property
    def top(self) -> Path:
        """The data set of the images as they were taken, with their lens."""
        return self.out / "distorted" if self.config.undistort else self.out

    @property
    def images(self) -> Path:
        """The images in which features are sought: those of the data set, or what a screen shows of them."""
        return self.out / SHOWN if self.config.linear else self.top / "images"

    @property
    def database(self) -> Path:
        return self.out / DATABASE

    @property
    def feature_masks(self) -> Path:
        """The folder for masks of transparent images."""
        return self.out / FEATURE_MASKS

    @cached_property
    def digests(self) -> dict[str, str | None]:
        """Of the images and the masks, by their names and sizes."""
        images = digest(self.photographs or {self.source.name: self.source})
        return {"source_sha256": images, "masks_sha256": digest(mask_files(self.masks)) if self.masks else None}

    def settings(self) -> dict[str, Any]:
        """What decides on the poses: the flags, the images and the masks."""
        settings = {"source": str(self.source), **self.digests, **dataclasses.asdict(self.config)}
        return json.loads(json.dumps(settings))  # as they are read again

    def free(self) -> tuple[str, ...]:
        """Names of those settings that may change before the search goes on."""
        free = FREE
        if not model_folder(self.top).is_dir():  # the scale is measured in the model, once there is one
            free += ("scale",)
        if not self.database.is_file():  # nothing is known of the images: one that cannot be read may be left out
            free += ("source_sha256", "masks_sha256")
        return free


@checks_arguments
def find_poses(
    source: str | Path, out: str | Path, config: PosesConfig, progress: Progress = lambda stage, done, n: None
) -> Summary:
    """Fill the folder ``out`` with poses of the images of ``source``, a folder or a video, or what is missing there.

    ``progress`` gets the name of a stage, what is done, and of how much. Raises ``DataError`` for what cannot be read,
    for a folder with other contents, and for a capture of which no model could be made, with the reason.
    """
    require_class("find_poses: how they are found", config, PosesConfig, "give a PosesConfig")
    source, out = Path(source), Path(out)
    require_input(source)
    if out.resolve() == source.resolve():
        is_what = "is the video itself" if is_video(source) else "is the folder of the photographs itself"
        raise DataError(out, is_what, "name another folder for the poses")
    if config.frames is not None and not is_video(source):
        refuse("frames", f"is for videos, and {source} is a folder of images", "leave it out")
    if config.linear and is_video(source):
        refuse("linear", f"is for photographs, and {source} is a video", "leave it out")
    pycolmap = pycolmap_module(config.gpu)
    search = _search_for(source, out, config)
    if not (out / SETTINGS).is_file():  # of another search ``begin`` says first that it is one
        _require_named(search)
    begin(out / SETTINGS, search.settings(), "search for poses", search.free())
    with locked(out, "another process is looking for poses in it"):
        remove_parts(out)
        if not is_done(out):
            search.database.parent.mkdir(exist_ok=True)
            stages = Stages(out / SECONDS, progress)
            if not model_folder(search.top).is_dir():
                _forget_copies_of_others(search)
                _reconstruct(pycolmap, search, stages)
            if config.undistort:
                _undistort(pycolmap, search, stages)
        return Summary.read(out)


def _search_for(source: Path, out: Path, config: PosesConfig) -> Search:
    """What is looked for, with the lens, and whether the light is kept, that the images ask for. Raises ``DataError``
    for images that do not go with the settings."""
    masks = mask_folder(source, config.masks)
    photographs = {} if is_video(source) else find_photographs(source, out, masks, config.linear)
    light = next((path for path in photographs.values() if is_exr(path)), None)
    if light and config.panoramas:
        raise DataError(light, "is OpenEXR, of which no panoramas are cut", "export the panoramas as JPEG or PNG")
    if photographs:
        lens = lens_of_photographs((p for p in photographs.values() if not is_light(p)), config.lens)
    else:
        lens = lens_of({source: says_panorama(source)}, config.lens)
    config = dataclasses.replace(config, lens=lens, linear=config.linear or light is not None)
    return Search(source, photographs, masks, out, config)


def _require_named(search: Search) -> None:
    """Raise ``DataError`` for masks of other images, and for places in others: with a video nobody knows its frames."""
    if not search.photographs:
        return
    names = [solid_name(name) for name in search.photographs]
    if search.masks:
        masks_of(search.masks, names)
    if search.config.scale is not None:
        views = [f"{side}/{name}" for side in SIDES for name in names] if search.config.panoramas else names
        require_images(search.config.scale[:2], views)


def is_done(out: Path) -> bool:
    """Whether a folder holds poses that ``find_poses`` has found."""
    return (out / SETTINGS).is_file() and model_folder(out).is_dir()


def model_folder(top: Path) -> Path:
    """Of a data set."""
    return top / "sparse" / "0"


def digest(files: Mapping[str, Path]) -> str:
    """Of files, by their names and sizes."""
    listed = json.dumps([[file.name, file.stat().st_size] for file in dict.fromkeys(files.values())]).encode()
    return hashlib.sha256(listed).hexdigest()


def _forget_copies_of_others(search: Search) -> None:
    """Before there is a database: remove what was copied, or chosen of a video, unless it is of these images and
    masks."""
    copied, digests = search.out / COPIED, list(search.digests.values())
    if search.database.is_file() or (copied.is_file() and read_json(copied, "remove the file") == digests):
        return
    made = (search.out / name for name in (FEATURE_MASKS, PANORAMAS, PANORAMA_MASKS, SHOWN))
    for folder in (search.top / "images", search.top / "masks", *made):
        if folder.is_dir():
            shutil.rmtree(folder)
    search.database.with_name(CHOICE).unlink(missing_ok=True)
    write_json(copied, digests)


def _reconstruct(pycolmap: Any, search: Search, stages: Stages) -> None:
    """All stages up to the model of the images as they were taken, and its summary."""
    database, top, config = search.database, search.top, search.config
    images, masks = search.images, top / "masks"
    with stages.of("images") as progress:
        if config.panoramas:
            photographs, n_masks = _panoramas(search, progress)
        else:
            photographs, n_masks = _images(search, images, masks, progress)
    n_frames = len(photographs) // len(SIDES) if config.panoramas else len(photographs)
    with stages.of("features") as progress:
        hidden = feature_masks(photographs, images, masks if n_masks else None, search.feature_masks)
        extract(pycolmap, database, images, hidden, photographs, config, progress)
        if config.panoramas:
            tie_views(pycolmap, database)
    with stages.of("matching") as progress:
        match(pycolmap, database, not search.photographs and not config.panoramas, config, progress)
    evidence = gather(pycolmap, database)
    if hopeless(evidence):
        raise _nothing_found(search.source, evidence)
    with stages.of("mapping") as progress:
        models = reconstruct(pycolmap, database, images, n_frames, config, progress)
    if not models:
        raise _nothing_found(search.source, evidence)
    downs = {p.name: np.array(p.down) for p in photographs if p.down is not None}
    placed = place(pycolmap, models[0], config.scale, downs)
    advice = advice_on_capture(evidence) + advice_on_model(outcome_of(models, photographs, config.feature_size))
    summary_of(models[0], photographs, n_masks, placed, advice, stages.seconds).write(search.out)
    for folder in {search.out, top}:  # two data sets with --undistort
        write_world(folder, placed.world)
    model = renamed(models[0], radiance_name) if config.linear else models[0]
    write_model(model, model_folder(top))


def _images(
    search: Search, images: Path, masks: Path, progress: Callable[[int, int], None]
) -> tuple[list[Photograph], int]:
    """Write the photographs, or the chosen frames, and their masks into folders; and how many masks there are."""
    if search.photographs and is_light(next(iter(search.photographs.values()))):
        radiance = search.top / "images" if search.config.linear else None
        photographs = prepare_light(search.photographs, images, radiance, progress)
    elif search.photographs:
        photographs = prepare(search.photographs, images, progress)
    else:
        choice = search.database.with_name(CHOICE)
        photographs = take_frames(search.source, choice, images, search.config.frames, progress)
    return photographs, prepare_masks(search.masks, photographs, masks) if search.masks else 0


def _panoramas(search: Search, progress: Callable[[int, int], None]) -> tuple[list[Photograph], int]:
    """The same with panoramas, of which views are written."""
    whole, masks = search.out / PANORAMAS, search.out / PANORAMA_MASKS
    panoramas, n_masks = _images(search, whole, masks, progress)
    views = cut_panoramas(panoramas, whole, search.top / "images", progress)
    return views, cut_masks(panoramas, masks, search.top / "masks") if n_masks else 0


def _nothing_found(source: Path, evidence: Evidence) -> DataError:
    reason = [*advice_on_capture(evidence), Advice("no two images are far enough apart to begin with", TAKE_MORE)][0]
    return DataError(source, f"no poses found: {reason.problem}", reason.remedy)


def _undistort(pycolmap: Any, search: Search, stages: Stages) -> None:
    """The images without their lens, and their model, as the data set itself."""
    with stages.of("undistortion") as progress:
        model = undistort(pycolmap, search.top, search.out, progress)
    dataclasses.replace(Summary.read(search.out), seconds=stages.seconds).write(search.out)
    write_model(model, model_folder(search.out))
