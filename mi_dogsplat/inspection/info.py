"""``dogsplat info``: what a file or folder is, in a few lines, and what is wrong with it."""

from __future__ import annotations

from pathlib import Path

from ..formats.read import format_of, is_model_name, is_sog_meta
from ..formats.sog_read import META
from ..poses.config import SETTINGS as POSES
from ..report.run_folder import POSED
from ..support.arguments import checks_arguments
from ..support.errors import DataError
from ..support.run_files import are_of_run
from ..support.wording import printable
from .dataset import describe_dataset
from .model import describe_model
from .run import RUN_FILES, describe_run

ACCEPTED = (
    "give a model (.ply .spz .sog .glb .gltf .usd .splat), a run folder, or a data set: a COLMAP folder, a folder with "
    "transforms.json or transforms_train.json, or a Mitsuba scene .xml"
)
DATA_FILES = (".xml", ".json")


@checks_arguments
def describe(path: str | Path) -> list[str]:
    """Printable lines about a model, a run folder, a scene or a data set. Raises ``DataError`` for all else and what is
    broken.

    A Mitsuba scene needs a variant to be set; one without splats is a data set, whose sensors are rendered.
    """
    path = Path(path)
    kind = kind_of(path)
    if kind == "data" and path.suffix == ".xml":
        from ..datasets.scene_file import has_splats  # here: see ``kind_of``
        from .scene import describe_scene  # of the active variant

        if has_splats(path):
            return [printable(text) for text in describe_scene(path)]
    described = {"model": describe_model, "run": describe_run, "data": describe_dataset}[kind](path)
    return [printable(text) for text in described]


def kind_of(path: Path) -> str:
    """``model``, ``run`` or ``data``, by names, or by the first bytes where these say nothing. Raises ``DataError``."""
    if not path.exists():
        raise DataError(path, "no such file or folder", ACCEPTED)
    if path.name in RUN_FILES and path.is_file() and are_of_run([file.name for file in path.parent.iterdir()]):
        raise DataError(path, "is a file of a run", f"give its folder: {path.parent}")
    if path.is_file() and (is_model_name(path) or _begins_as_model(path)):
        return "model"
    if path.is_dir() and any((path / name).is_file() for name in RUN_FILES):
        return "run"
    if path.is_file() and path.suffix in DATA_FILES:
        return "data"
    from ..poses.input import has_cameras  # here: data sets need the extra "train", models and runs do not

    if path.is_dir() and has_cameras(path):
        return "data"
    raise _unknown(path)


def _begins_as_model(path: Path) -> bool:
    if path.suffix in DATA_FILES:
        return False
    try:
        return bool(format_of(path))
    except (DataError, OSError):
        return False


def _unknown(path: Path) -> DataError:
    from ..datasets.scans.apps import is_scan  # here: see ``kind_of``
    from ..poses.input import needs_poses, require_input

    meta = path / META
    if meta.is_file() and is_sog_meta(meta):  # whose pictures are no photographs
        return DataError(path, "this is a folder", f"give the model in it: {meta}")
    if (path / POSED / POSES).is_file():
        return DataError(path, "is a run that has not begun to train", "give its dogsplat train command again")
    if needs_poses(path):
        require_input(path)
        remedy = "dogsplat poses makes a data set of it; dogsplat train does that by itself"
        return DataError(path, "is the scan of a phone" if is_scan(path) else "has no cameras yet", remedy)
    return DataError(path, "not something dogsplat knows", ACCEPTED)
