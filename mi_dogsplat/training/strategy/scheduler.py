"""Reconstruction-aware Pruning Scheduler: when to prune, and how many (Wang et al. 2026, RPS).

Numbers in, a decision out; no tensors. Two rules:

Refinement Interval Regulation (RIR), *when*. At every check the mean L1 over the whole training set is compared with
that just before the previous prune. Where refinement has brought it down to ``beta`` of that, the model can bear the
next prune; else it is refined on. The first check always prunes, and ``max_interval`` steps without a prune force one.

Dynamic Pruning Ratio Adjustment (DPRA), *how many*. Of ``N_0 - N_target`` primitives round t removes the part 1/2^t:
much while there is redundancy, little near the target. These parts never add up to all of it, so the target is met,
exactly, by a last snap: in round ``rounds`` where that is given, at the latest when the window closes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal


def scaled_milestone(step: int, factor: float) -> int:
    """A step of a schedule of another length; what is not at the start stays at least one step from it."""
    return max(min(1, step), round(step * factor))


def target_count(target: float, n: int) -> int:
    """Number of primitives that a target means for a model of ``n``: below 1 it is a ratio, else a count.

    Raises ``ValueError`` for a target that is no ratio and no whole number, or that leaves none or removes none.
    """
    if not (0 < target < 1 or (target >= 1 and float(target).is_integer())):  # NaN is neither
        raise ValueError(f"the target {target:g} is neither a ratio between 0 and 1 nor a whole number of primitives")
    count = int(target) if target >= 1 else round(target * n)
    if count < 1:
        raise ValueError(f"the target {target:g} of {n} primitives leaves none")
    if count >= n:
        raise ValueError(f"the target of {count} primitives is not below the {n} that there are")
    return count


@dataclass(frozen=True)
class PruningRule:
    """Numbers of the recipe, in steps of its schedule; ``scaled`` fits them to a run of another length.

    Raises ``ValueError`` for numbers that make no schedule.
    """

    start: int = 15_000  # first check
    stop: int = 25_000  # last check: the window closes
    check_every: int = 500
    max_interval: int = 2000  # steps since a prune after which the next one is forced
    beta: float = 0.95  # prune when L1 is at most this times the L1 before the previous prune
    # round t removes (N_0 - N_target) / 2^t, or / rounds; or multiplies the count by (N_target / N_0)^part, a part each
    division: Literal["halving", "equal"] | tuple[float, ...] = "halving"
    rounds: int | None = None  # the prune of this number snaps to the target; None: only the end of the window does

    def __post_init__(self) -> None:
        if not (0 <= self.start <= self.stop and self.check_every >= 1 and self.max_interval >= 1):
            raise ValueError(f"PruningRule: {self} makes no schedule")
        if isinstance(self.division, tuple):
            if self.rounds != len(self.division) or min(self.division, default=0) <= 0:
                raise ValueError('PruningRule: "division" has a positive part of the way for each of "rounds"')
        elif self.division not in ("halving", "equal") or (self.division == "equal" and self.rounds is None):
            raise ValueError('PruningRule: "division" is "halving", or "equal" together with "rounds"')
        if self.rounds is not None and self.rounds < 1:
            raise ValueError(f'PruningRule: "rounds" is {self.rounds}, expected at least 1')

    def scaled(self, factor: float) -> PruningRule:
        """The rule for a run ``factor`` times as long. The longest interval stays a whole number of checks.

        Else rounding would delay a forced prune by a check, and a 7,000-step run would have fewer of them.
        """
        every = scaled_milestone(self.check_every, factor)
        checks = min(math.ceil(self.max_interval / self.check_every), max(1, round(self.max_interval * factor / every)))
        start, stop = scaled_milestone(self.start, factor), scaled_milestone(self.stop, factor)
        return replace(self, start=start, stop=stop, check_every=every, max_interval=checks * every)


@dataclass(frozen=True)
class Decision:
    """What to do after a check."""

    prune: bool
    keep: int  # primitives left after it
    reason: str  # for the history


class PruningScheduler:
    """State of the schedule for a model of ``n_start`` primitives that shall end with exactly ``n_target``.

    Raises ``ValueError`` unless 1 <= n_target < n_start.
    """

    def __init__(self, rule: PruningRule, n_start: int, n_target: int):
        if not 1 <= n_target < n_start:
            raise ValueError(f"PruningScheduler: cannot prune {n_start} primitives to {n_target}")
        self.rule, self.n_start, self.n_target = rule, n_start, n_target
        self.round = 0  # prunes so far
        self.previous_l1 = math.inf  # just before the previous prune
        self.previous_step = rule.start  # of the previous prune
        self.next_check = rule.start
        self.finished = False

    def checks(self, step: int) -> bool:
        """Whether to measure and ``decide`` after ``step`` steps. A check that was missed is made up for."""
        return not self.finished and step >= min(self.next_check, self.rule.stop)

    def decide(self, step: int, n: int, l1: float) -> Decision:
        """Prune or refine.

        Args:
            step: steps done; ``ValueError`` unless ``checks(step)``.
            n: primitives there are now.
            l1: mean L1 over all training views, the image clamped to [0, 1].
        """
        if not self.checks(step):
            raise ValueError(f"PruningScheduler.decide: step {step} is no check")
        rule = self.rule
        due = step - (step - rule.start) % rule.check_every  # when this check ought to have been
        self.next_check = due + rule.check_every
        if n <= self.n_target:
            self.finished = True
            return Decision(False, n, f"{n} primitives are left, the target is {self.n_target}")

        closing, waited = step >= rule.stop, due - self.previous_step
        recovered = l1 <= rule.beta * self.previous_l1
        comparison = f"L1 {l1:.4g} {'<=' if recovered else '>'} {rule.beta:g} x {self.previous_l1:.4g}"
        if closing:
            reason = "the window closes"
        elif self.round == 0:
            reason = "first check"
        elif recovered:
            reason = comparison
        elif waited >= rule.max_interval:
            reason = f"forced by {waited} steps since the last prune, {comparison}"
        else:
            return Decision(False, n, comparison)

        self.round += 1
        self.previous_l1, self.previous_step = l1, due
        keep = self.n_target if closing else self._keep(n)
        self.finished = keep == self.n_target
        if self.finished and not closing:
            reason += f", round {self.round} meets the target"
        return Decision(True, keep, reason)

    def _keep(self, n: int) -> int:
        """What the current round leaves of ``n``; it removes at least one."""
        rule = self.rule
        if self.round == rule.rounds:
            return self.n_target
        if isinstance(rule.division, tuple):
            part = rule.division[self.round - 1] / sum(rule.division)
            return max(self.n_target, min(n - 1, round(n * (self.n_target / self.n_start) ** part)))
        parts = 2**self.round if rule.division == "halving" else rule.rounds or 1
        removed = max(1, round((self.n_start - self.n_target) / parts))
        return max(self.n_target, n - removed)

    def state(self) -> dict[str, float]:
        """Numbers that ``restore`` needs to go on with the same decisions."""
        names = ("n_start", "n_target", "round", "previous_l1", "previous_step", "next_check", "finished")
        return {name: getattr(self, name) for name in names}

    def restore(self, state: Mapping[str, float]) -> None:
        """Take over a ``state()``. Raises ``KeyError`` where a number is missing."""
        for name in self.state():
            setattr(self, name, type(getattr(self, name))(state[name]))
