"""All that a training holds, as named arrays: what goes into a checkpoint, and back."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .strategy.densify import DensifyStats

if TYPE_CHECKING:
    from .train import Trainer


def state_of(trainer: Trainer) -> dict[str, np.ndarray]:
    """See ``Trainer.state``."""
    state = {f"optimizer.{name}": value for name, value in trainer.optimizer.state().items()}
    state |= {f"stats.{name}": value for name, value in trainer.stats.state().items()}
    if trainer.photographs.exposure:
        state |= {f"exposure.{name}": value for name, value in trainer.photographs.exposure.state().items()}
    if trainer.pruning:
        state |= {f"pruning.{name}": value for name, value in trainer.pruning.state().items()}
    rng = np.array(json.dumps(trainer.rng.bit_generator.state))
    progress = {"step": np.array(trainer.step_count), "seconds": np.array(trainer.seconds)}
    progress |= {"order": np.array(trainer.order, np.int64), "dog_activated": np.array(trainer.dog_activated)}
    progress |= {"pairs": np.array(trainer.memory.pairs if trainer.memory else 0)}
    losses = {"l1_sum": trainer.l1_sum.numpy().copy(), "loss_sum": trainer.loss_sum.numpy().copy()}
    return state | progress | losses | {"summed": np.array(trainer.summed), "rng": rng}


def restore(trainer: Trainer, state: dict[str, np.ndarray]) -> None:
    """See ``Trainer.restore``."""

    def part(prefix: str) -> dict[str, np.ndarray]:
        return {name[len(prefix) :]: value for name, value in state.items() if name.startswith(prefix)}

    trainer.optimizer.restore(part("optimizer."))
    trainer.stats = DensifyStats(trainer.optimizer.n)
    trainer.stats.restore(part("stats."))
    trainer.step_count, trainer.seconds = int(state["step"]), float(state["seconds"])
    trainer.order = state["order"].tolist()
    trainer.dog_activated = bool(state.get("dog_activated", False))
    if trainer.photographs.exposure and "exposure.values" in state:
        trainer.photographs.exposure.restore(part("exposure."))
    if trainer.pruning:
        trainer.pruning.restore(part("pruning."))
    trainer.rng.bit_generator.state = json.loads(str(state["rng"]))
    Float: Any = dr.detached_t(mi.Float)
    trainer.l1_sum, trainer.loss_sum = (dr.opaque(Float, float(state[name][0])) for name in ("l1_sum", "loss_sum"))
    trainer.summed = int(state["summed"])
    if trainer.memory:
        trainer.memory.pairs = int(state["pairs"])
