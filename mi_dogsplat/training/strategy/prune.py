"""Pruning of a model in training: the scheduler decides when and how many, a score decides who."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...scene.ply import read_ply
from ...scene.splats import Splats
from ...support.errors import DataError
from ..optimizer import SplatOptimizer
from .scheduler import PruningRule, PruningScheduler, target_count


def model_to_prune(path: str, target: float) -> Splats:
    """Read a model. Raises ``DataError`` if it cannot be read, or cannot be pruned to ``target``.

    Quaternions are brought to length 1, which changes no picture: a training step of one turns by step / length.
    """
    splats = read_ply(path)
    if splats.n_splats < 2:
        raise DataError(path, f"holds {splats.n_splats} primitives", "pruning needs at least 2")
    try:
        target_count(target, splats.n_splats)
    except ValueError as error:
        raise DataError("--target", str(error), f"choose another one for {path}") from None
    length = np.linalg.norm(splats.quats.astype(np.float64), axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    return replace(splats, quats=np.where(usable, splats.quats / np.where(usable, length, 1), splats.quats))


def keep_best(optimizer: SplatOptimizer, scores: np.ndarray, count: int) -> None:
    """Keep the ``count`` primitives with the largest scores [N], in their order and with their moments.

    What has no score (NaN) goes first; among equals those further back go first. Raises ``ValueError`` unless there
    is one score per primitive.
    """
    if len(scores) != optimizer.n:
        raise ValueError(f"keep_best: {len(scores)} scores for {optimizer.n} primitives")
    best = np.argsort(-np.asarray(scores), kind="stable")[:count]  # NaN sorts to the end
    optimizer.rearrange(np.sort(best), np.zeros(len(best), bool))


class Pruning:
    """The pruning window of a run. N_0 and with it the target are known when the first check comes."""

    def __init__(self, rule: PruningRule, target: float):
        self.rule, self.target = rule, target
        self.scheduler: PruningScheduler | None = None
        self.skipped = False  # there was nothing to prune

    def due(self, step: int) -> bool:
        """Whether to ``check`` after ``step`` steps."""
        if self.scheduler is None:
            return not self.skipped and step >= self.rule.start
        return self.scheduler.checks(step)

    def check(
        self, step: int, optimizer: SplatOptimizer, l1: Callable[[], float], scores: Callable[[], np.ndarray]
    ) -> dict[str, Any]:
        """Measure, decide, and prune if that is the decision.

        Args:
            step: steps done.
            l1: measures the mean L1 over all training views.
            scores: computes the importance of each primitive, [N].

        Returns: fields of the row of the history: ``event``, ``train_l1``, after a prune ``pruned_from`` and
        ``pruned_to``. A model that is not above its target is left alone, with an event that says so.
        """
        n = optimizer.n
        if self.scheduler is None:
            try:
                self.scheduler = PruningScheduler(self.rule, n, target_count(self.target, n))
            except ValueError as error:
                self.skipped = True
                return {"event": f"no pruning: {error}"}
        measured = l1()
        decision = self.scheduler.decide(step, n, measured)
        if not decision.prune:
            return {"event": f"refine: {decision.reason}", "train_l1": measured}
        keep_best(optimizer, scores(), decision.keep)
        event = f"prune {n} -> {decision.keep}: {decision.reason}"
        return {"event": event, "train_l1": measured, "pruned_from": n, "pruned_to": decision.keep}

    def state(self) -> dict[str, np.ndarray]:
        """Numbers that ``restore`` needs; none before the first check."""
        numbers = self.scheduler.state() if self.scheduler else {"skipped": 1} if self.skipped else {}
        return {name: np.array(value) for name, value in numbers.items()}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take over a ``state()``; an empty one means that the window is still to come."""
        self.skipped, self.scheduler = "skipped" in state, None
        if "n_start" in state:
            self.scheduler = PruningScheduler(self.rule, int(state["n_start"]), int(state["n_target"]))
            self.scheduler.restore({name: value.item() for name, value in state.items()})
