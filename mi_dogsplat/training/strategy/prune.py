"""Pruning of a model in training: the scheduler decides when and how many, a score decides who."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...scores.score import Score
from ..events import Event, NotPruned, Pruned, Refined
from ..optimizer.splat_optimizer import SplatOptimizer
from .scheduler import Progress, PruningRule, PruningScheduler, target_count
from .strategy import Strategy, Training


def keep_best(optimizer: SplatOptimizer, scores: np.ndarray, count: int) -> None:
    """Keep the ``count`` primitives with the largest scores [N], in their order and with their moments.

    What has no score (NaN) goes first; among equals those further back go first. Raises ``ValueError`` unless there
    is one score per primitive.
    """
    if len(scores) != optimizer.n:
        raise ValueError(f"keep_best: {len(scores)} scores for {optimizer.n} primitives")
    best = np.argsort(-np.asarray(scores), kind="stable")[:count]  # NaN sorts to the end
    optimizer.keep(np.sort(best))


@dataclass(frozen=True)
class Pruning(Strategy[Progress]):
    """The pruning window of a run. N_0 and with it the target are known when the first check comes."""

    rule: PruningRule
    score: Score

    def new_state(self, t: Training) -> Progress:
        return Progress()

    def due(self, t: Training, state: Progress) -> bool:
        """Whether there is a check after this step."""
        return PruningScheduler(self.rule, state).checks(t.step_count)

    def begin(self, t: Training, state: Progress) -> list[Event]:
        return self.after_step(t, state)

    def after_step(self, t: Training, state: Progress) -> list[Event]:
        """Where a check is due, measure, decide, and prune if that is the decision.

        A model that is not above its target is left alone, with an event that says so.
        """
        if not self.due(t, state):
            return []
        scheduler, n = PruningScheduler(self.rule, state), t.optimizer.n
        if not state.begun:
            try:
                scheduler.begin(n, target_count(t.target, n))
            except ValueError as error:
                state.finished = True
                return [NotPruned(str(error))]
        measured = t.training_l1() if self.rule.compares else None
        decision = scheduler.decide(t.step_count, n, measured)
        if not decision.prune:
            return [Refined(decision.reason, measured)]
        keep_best(t.optimizer, t.scores(self.score), decision.keep)
        return [Pruned(n, decision.keep, decision.reason, measured)]
