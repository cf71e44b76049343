"""Where the viewer's model comes from: a file, or the newest state of a run, read again when it changes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..formats.read import files_of, read_model
from ..report.run_folder import MODEL, read_run
from ..runs.checkpoint import CHECKPOINT, load_checkpoint
from ..scene.appearance import APPEARANCE, Appearance, read_appearance
from ..scene.drawing import Drawing
from ..scene.radiance import brightened
from ..scene.splats import Splats
from ..support.errors import DataError
from ..training.optimizer.group_rows import group_arrays
from ..training.optimizer.sh_rows import sh_arrays

RAW = ("means", "log_scales", "quats", "logit_opacities")


class Source:
    """A model file, or a run folder, whose checkpoint is read while it trains. Raises ``DataError`` if neither."""

    def __init__(self, path: Path):
        self.path = path
        self.is_run = path.is_dir()
        run = read_run(path) if self.is_run else None
        self.config, self.data = (run.config, run.data) if run else ({}, None)
        said = {name: self.config[name] for name in ("antialiased", "near_clip", "up") if name in self.config}
        self.white: float | None = self.config.get("white")  # of a run on linear images, which trains in units of it
        said["scale"] = self.config.get("unit")
        linear = None if self.white is None else True
        self._of_run = Drawing(**said, linear=linear, white=self.white)
        self.appearance: Appearance | None = None  # of its photographs, where a run that has ended has learned it
        self.drawing = self._of_run  # what the run, or a file once it is read, says
        self._files: list[Path] = []  # of which it was made when it was last read
        self._seen: list[tuple] = []

    def poll(self) -> tuple[Splats, str] | None:
        """The model and what it is in words, if it changed since it was asked before. Raises ``DataError``."""
        file = self._newest()
        if file in self._files and _signatures(self._files) == self._seen:
            return None
        files = [file] if file.suffix == ".npz" else files_of(file)
        seen = _signatures(files)  # before they are read: what is written meanwhile is read next time
        if file.suffix == ".npz":
            found = self._of_checkpoint(file)
        else:
            model = read_model(file)
            self.drawing = self._of_run.over(model.drawing)
            found = model.splats, file.name
        learned = self.path / APPEARANCE
        self.appearance = read_appearance(learned) if self.is_run and learned.is_file() else None
        self._files, self._seen = files, seen
        return found

    def _of_checkpoint(self, file: Path) -> tuple[Splats, str]:
        """Its model, and how far it is. Raises ``DataError``."""
        try:
            state = load_checkpoint(file)
            splats, step = splats_of_state(state), int(state["step"])
        except (ValueError, KeyError, TypeError, IndexError) as error:
            if self.is_run and isinstance(error, DataError):
                raise
            raise DataError(file, "is not a checkpoint of a training", "give a model or a run folder") from error
        splats = splats if self.white is None else brightened(splats, self.white)
        steps = self.config.get("steps")
        of = f" of {steps:,}" if isinstance(steps, int) else ""
        return splats, f"step {step:,}{of}"

    def _newest(self) -> Path:
        """The file to read: of a run the younger of checkpoint and model."""
        if not self.is_run:
            if not self.path.is_file():
                raise DataError(self.path, "no such file or folder", "give a model or a run folder")
            return self.path
        files = [file for name in (CHECKPOINT, MODEL) if (file := self.path / name).is_file()]
        if not files:
            problem = f"holds neither {MODEL} nor {CHECKPOINT}"
            raise DataError(self.path, problem, "wait for its first checkpoint (one a minute), or give a run folder")
        return max(files, key=lambda file: file.stat().st_mtime_ns)


def _signatures(files: list[Path]) -> list[tuple]:
    """By which a change of files is noticed; of one that is gone, nothing."""
    there = [file.stat() if file.is_file() else None for file in files]
    return [(status.st_mtime_ns, status.st_size) if status else () for status in there]


def splats_of_state(state: Mapping[str, np.ndarray]) -> Splats:
    """The model in a ``Trainer.state()``. Raises ``KeyError`` for something else."""
    part = {name.removeprefix("optimizer."): values for name, values in state.items() if name.startswith("optimizer.")}
    n = part["logit_opacities"].size
    arrays = {name: part[name].reshape(n, -1) if name != "logit_opacities" else part[name] for name in RAW}
    arrays |= sh_arrays(part["sh_dc"].reshape(n, 3), part, part)
    return Splats(**arrays, **group_arrays(part))
