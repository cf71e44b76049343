"""The files and folders that a run reads, which its settings name as the user did, from some working folder."""

from __future__ import annotations

from pathlib import Path

from ..report.run_folder import CONFIG, REFINED
from ..support.errors import DataError
from ..support.files import read_json, write_json
from ..training.config import TrainConfig
from .checkpoint import CHECKPOINT
from .model_files import model_files

INPUTS = ("data", "masks", "depths", "model")  # settings that are paths
PLACES = CHECKPOINT.parent / "inputs.json"  # in a run folder: where they were


def check_inputs(config: TrainConfig, out: Path) -> None:
    """Raise ``DataError`` for an input whose path no JSON holds, and for one that the run replaces or removes."""
    for path in _named(config).values():
        try:
            _place(path).encode()
        except UnicodeEncodeError:
            raise DataError(path, f"its path is not UTF-8, which {CONFIG} needs", "rename it") from None
    run, remedy = out.resolve(), "name another folder for the run"
    if config.model is not None and Path(config.model).resolve() in model_files(run):
        raise DataError(out, "is the run that its model comes from", remedy)
    if Path(config.data).resolve().is_relative_to((run / REFINED).resolve()):
        raise DataError(out, "is the run that its data come from", remedy)


def note_inputs(config: TrainConfig, out: Path) -> None:
    """Keep where the inputs of a run are."""
    (out / PLACES).parent.mkdir(exist_ok=True)
    write_json(out / PLACES, {name: _place(path) for name, path in _named(config).items()})


def noted_inputs(out: Path) -> dict[str, str]:
    """What ``note_inputs`` kept; nothing for runs of versions that did not. Raises ``DataError``."""
    path = out / PLACES
    found = read_json(path, "remove it") if path.is_file() else {}
    if not isinstance(found, dict) or not all(isinstance(place, str) for place in found.values()):
        raise DataError(path, "does not say where the inputs of the run were", "remove it")
    return found


def is_same_input(before: str | None, now: str | None, place: str | None) -> bool:
    """Whether the name that a run began with and the one that it goes on with mean the same file or folder.

    ``place`` is where that was in the beginning, None where nobody knows. If it is not there any more, it may have been
    moved together with the run, under the same name.
    """
    if before is None or now is None:
        return before is now
    if place is not None and Path(place).exists():
        return _place(now) == place
    return before == now or _place(before) == _place(now)


def _named(config: TrainConfig) -> dict[str, str]:
    """The inputs that a run has, as its settings name them."""
    named = {name: getattr(config, name) for name in INPUTS}
    return {name: path for name, path in named.items() if path is not None}


def _place(path: str) -> str:
    return str(Path(path).resolve())
