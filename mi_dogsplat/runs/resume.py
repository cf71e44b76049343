"""What an earlier run in the same folder leaves to a new one: its checkpoint and history, or nothing."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..report.run_folder import CONFIG, HISTORY, METRICS, MISFITS, REFINED, RENDER_MS, REPORT, Run, read_run
from ..scene.appearance import APPEARANCE
from ..support.errors import DataError
from ..support.files import json_text, replacing
from ..support.locks import locked
from ..training.config import FREE_TO_RESUME
from ..training.train import Trainer
from .checkpoint import CHECKPOINT, load_checkpoint
from .inputs import INPUTS, is_same_input, noted_inputs
from .own_recipe import require_same_recipe

IN_USE = "another process is training in it"


def require_no_stopped_run(out: Path) -> None:
    """Raise ``DataError`` for the folder of a run that was stopped: beginning anew would lose what it has done.

    Says of one that goes on in another process that it does.
    """
    if not (out / CHECKPOINT).is_file() or (out / METRICS).is_file():
        return
    with locked(out, IN_USE):
        folder = CHECKPOINT.parent.as_posix()
        problem, other = "holds a training that was stopped", f"remove {folder}/ there, or name another folder"
        raise DataError(out, problem, f"add --resume (in Python resume=True) to go on with it; to start again, {other}")


def resume_run(trainer: Trainer, out: Path, recipe: Mapping[str, Any] | None = None) -> None:
    """Put the trainer where the checkpoint of ``out`` is, and cut the history there.

    recipe: what ``recipe.json`` is to hold; None for a run by the recipe of its preset.

    Raises ``DataError`` where there is no run, or one of other settings or another recipe, or its files are damaged.
    """
    before = read_run(out)
    if not (out / CONFIG).is_file():
        raise DataError(out, "there is no run, so there is no checkpoint", "train without --resume")
    now = json.loads(json.dumps(dataclasses.asdict(trainer.config)))
    places = noted_inputs(out)

    def differs(name: str) -> bool:
        if name in INPUTS:
            return not is_same_input(before.config[name], now[name], places.get(name))
        return before.config[name] != now[name] and name not in FREE_TO_RESUME

    changed = [name for name in now if name in before.config and differs(name)]
    if changed:
        name = changed[0]
        problem = f"{name} was {before.config[name]} and is {now[name]} now"
        raise DataError(out, problem, "resume with the settings of the run, or name another folder")
    require_same_recipe(out, before.recipe, recipe)
    path = out / CHECKPOINT
    kept = []
    if path.exists():  # else the run was killed before its first checkpoint
        restore_from(trainer, path)
        kept = _rows_until(trainer, before)
    with replacing(out / HISTORY) as part:
        part.write_text("".join(json_text(row) + "\n" for row in kept), encoding="utf-8")


def _rows_until(trainer: Trainer, run: Run) -> list[dict[str, Any]]:
    """Those that came before the checkpoint; what was done after the last step has a second row at that step."""
    rows = list(zip(run.history, run.column("step"), strict=True))
    there = [row for row, step in rows if step == trainer.step_count]
    return [row for row, step in rows if step < trainer.step_count] + (there if trainer.ended else there[:1])


def restore_from(trainer: Trainer, path: Path) -> None:
    """Put the trainer where a checkpoint is. Raises ``DataError`` if it is of another kind of run."""
    try:
        trainer.restore(load_checkpoint(path))
    except (ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(path, f"does not fit this run ({error})", "remove it, and start again") from None


def forget_results(out: Path) -> None:
    """Remove what an earlier run in this folder measured and drew."""
    folders = out / "test", (out / MISFITS).parent
    pictures = [path for top in folders for suffix in (".png", ".exr", ".json") for path in top.glob(f"*{suffix}")]
    results = METRICS, REPORT, APPEARANCE, RENDER_MS
    for path in (*(out / name for name in results), *pictures):
        path.unlink(missing_ok=True)
    for path in (*(out / REFINED).glob("*.json"), *(out / REFINED).glob("*.ply")):
        path.unlink()
