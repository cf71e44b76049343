"""The state of a trainer as arrays, from which it goes on as if nothing had happened."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from .strategy.sieve import Sieve
from .strategy.strategy import Strategy, Training, arrays_of, restore_fields

FORMAT = 2  # another one is that of an earlier version


class WithState(Training, Protocol):
    """A trainer, with what it does not show to its strategies."""

    seconds: float
    ended: bool
    order: list[int]
    sieve: Sieve
    strategies: list[Strategy[Any]]
    states: dict[str, Any]


def state_of(trainer: WithState) -> dict[str, np.ndarray]:
    """Everything that ``restore`` needs to go on as if nothing had happened.

    Every value of a primitive is finite: what is broken is dropped first, which after a row with ``l1`` is nothing.
    """
    trainer.sieve.drop_broken(trainer)
    if trainer.memory:
        trainer.memory.give_back(trainer.optimizer.n)  # for what is copied to the host
    parts = {"optimizer": trainer.optimizer.state(), "losses": trainer.losses.state()}
    parts |= {name: arrays_of(state) for name, state in trainer.states.items()}
    if trainer.photographs.appearance:
        parts["appearance"] = trainer.photographs.appearance.state()
    progress = {"step": np.array(trainer.step_count), "seconds": np.array(trainer.seconds), "format": np.array(FORMAT)}
    rng = json.dumps(trainer.rng.bit_generator.state)
    progress |= {"order": np.array(trainer.order, np.int64), "rng": np.array(rng)}
    progress["views"] = np.array(_names(trainer))
    progress |= {"ended": np.array(trainer.ended), "pairs": np.array(trainer.memory.pairs if trainer.memory else 0)}
    return progress | {f"{part}.{name}": values for part in parts for name, values in parts[part].items()}


def _names(trainer: WithState) -> list[str]:
    """Of the training views."""
    return [view.name for view in trainer.photographs.originals]


def restore(trainer: WithState, state: Mapping[str, np.ndarray]) -> None:
    """Take over a ``state()``. Raises ``ValueError`` or ``KeyError`` if it is of another kind of run.

    It may be that of another recipe at the end of its densification: strategies that it does not know begin.
    """
    if "format" not in state or int(state["format"]) != FORMAT:
        raise ValueError("it is of another version of mi_dogsplat")
    if "exposure.values" in state:
        raise ValueError("it has the affine colour maps of an earlier version")
    # what is learned of views, and the order in which they come, go by their numbers
    if "views" in state and state["views"].tolist() != _names(trainer):  # unknown to earlier versions
        raise ValueError("its training views are not those of the data now")

    def part(prefix: str) -> dict[str, np.ndarray]:
        start = f"{prefix}."
        return {name[len(start) :]: value for name, value in state.items() if name.startswith(start)}

    trainer.optimizer.restore(part("optimizer"))
    trainer.losses.restore(part("losses"))
    for strategy in trainer.strategies:
        saved = part(strategy.name) or arrays_of(strategy.new_state(trainer))  # which may take long
        restore_fields(trainer.states[strategy.name], saved)
    if trainer.photographs.appearance and "appearance.mean" in state:
        trainer.photographs.appearance.restore(part("appearance"))
    trainer.step_count, trainer.seconds = int(state["step"]), float(state["seconds"])
    trainer.ended = bool(state.get("ended", False))  # unknown to earlier versions
    trainer.order = state["order"].tolist()
    trainer.rng.bit_generator.state = json.loads(str(state["rng"]))
    if trainer.memory:
        trainer.memory.pairs = int(state["pairs"])
