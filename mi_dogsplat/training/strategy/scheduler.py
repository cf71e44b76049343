"""Reconstruction-aware Pruning Scheduler: when to prune, and how many (Wang et al. 2026, RPS).

Numbers in, a decision out; no tensors. Two rules:

Refinement Interval Regulation (RIR), *when*. At every check the mean L1 over the whole training set is compared with
that just before the previous prune. Where refinement has brought it down to ``beta`` of that, the model can bear the
next prune; else it is refined on. The first check always prunes, and ``max_interval`` steps without a prune force one.
Where that is no longer than from check to check, every check prunes, and nobody asks for the L1, which takes a picture
of every view.

Dynamic Pruning Ratio Adjustment (DPRA), *how many*. Of ``N_0 - N_target`` primitives round t removes the part 1/2^t:
much while there is redundancy, little near the target. These parts never add up to all of it, so the target is met,
exactly, by a last snap: in round ``rounds`` where that is given, at the latest when the window closes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from ...support.wording import counted
from ..milestones import scaled_milestone


def target_count(target: float, n: int) -> int:
    """Number of primitives that a target means for a model of ``n``: below 1 it is a ratio, else a count.

    Raises ``ValueError`` for a target that is no ratio and no whole number, or that leaves none or removes none.
    """
    if not (0 < target < 1 or (target >= 1 and float(target).is_integer())):  # NaN is neither
        raise ValueError(f"the target {target:g} is neither a ratio between 0 and 1 nor a whole number of primitives")
    count = int(target) if target >= 1 else round(target * n)
    if count < 1:
        raise ValueError(f"the target {target:g} of {counted(n, 'primitive')} leaves none")
    if count >= n:
        raise ValueError(f"the target of {counted(count, 'primitive')} is not below the {n:,} that there are")
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

    @property
    def compares(self) -> bool:
        """Whether a decision depends on the L1: else every check prunes."""
        return self.max_interval > self.check_every

    def scaled(self, factor: float) -> PruningRule:
        """The rule for a run ``factor`` times as long. The longest interval reaches as many checks.

        Else rounding would delay a forced prune by a check, and a 7,000-step run would have fewer of them.
        """
        start, stop = scaled_milestone(self.start, factor), scaled_milestone(self.stop, factor)
        every = scaled_milestone(self.check_every, factor)
        if self.check_every == self.stop - self.start:  # else what is due beside the second check may be a step later
            every = max(1, stop - start)
        checks = math.ceil(self.max_interval / self.check_every)  # the last of which is forced to prune
        before = checks * self.check_every - self.max_interval  # steps by which the interval ends before that check
        checks = min(checks, max(1, round(checks * self.check_every * factor / every)))
        longest = checks * every - min(int(before * factor), every - 1)
        return replace(self, start=start, stop=stop, check_every=every, max_interval=longest)

    def earlier(self, steps: int) -> PruningRule:
        """The rule with a window that many steps earlier."""
        return replace(self, start=self.start - steps, stop=self.stop - steps)


@dataclass(frozen=True)
class Decision:
    """What to do after a check."""

    prune: bool
    keep: int  # primitives left after it
    reason: str  # for the history


@dataclass
class Progress:
    """How far the pruning of a run has come."""

    n_start: int = 0  # primitives at the first check; 0: still to come
    n_target: int = 0
    round: int = 0  # prunes so far
    previous_l1: float = math.inf  # just before the previous prune
    previous_step: int = 0  # of the previous prune
    next_check: int = 0
    finished: bool = False

    @property
    def begun(self) -> bool:
        """Whether there was a first check."""
        return self.n_start > 0


@dataclass(frozen=True)
class PruningScheduler:
    """Decisions by the rule, for a model of ``n_start`` primitives that shall end with exactly ``n_target``.

    ``unit``: what is counted, for people.
    """

    rule: PruningRule
    progress: Progress
    unit: str = "primitives"

    def begin(self, n_start: int, n_target: int) -> None:
        """The first check has come. Raises ``ValueError`` unless 1 <= n_target < n_start."""
        if not 1 <= n_target < n_start:
            raise ValueError(f"PruningScheduler: cannot prune {n_start} primitives to {n_target}")
        p = self.progress
        p.n_start, p.n_target, p.previous_step, p.next_check = n_start, n_target, self.rule.start, self.rule.start

    def checks(self, step: int) -> bool:
        """Whether to measure and ``decide`` after ``step`` steps. A check that was missed is made up for."""
        p = self.progress
        return not p.finished and step >= (min(p.next_check, self.rule.stop) if p.begun else self.rule.start)

    def decide(self, step: int, n: int, l1: float | None) -> Decision:
        """Prune or refine.

        Args:
            step: steps done; ``ValueError`` unless ``checks(step)``.
            n: primitives there are now.
            l1: mean L1 over all training views, as ``Trainer.training_l1`` has it; None where the rule does not
                compare, else ``ValueError``.
        """
        rule, p = self.rule, self.progress
        if not self.checks(step):
            raise ValueError(f"PruningScheduler.decide: step {step} is no check")
        if l1 is None and rule.compares:
            raise ValueError("PruningScheduler.decide: the rule compares, but there is no L1")
        due = step - (step - rule.start) % rule.check_every  # when this check ought to have been
        p.next_check = due + rule.check_every
        if n <= p.n_target:
            p.finished = True
            return Decision(False, n, f"{n} {self.unit} are left, the target is {p.n_target}")

        closing = step >= rule.stop
        prunes, reason = (True, "the window closes") if closing else self._judged(due, l1)
        if not prunes:
            return Decision(False, n, reason)
        p.round += 1
        p.previous_step = due
        if l1 is not None:
            p.previous_l1 = l1
        keep = p.n_target if closing else self._keep(n)
        p.finished = keep == p.n_target
        if p.finished and not closing:
            reason += f", round {p.round} meets the target"
        return Decision(True, keep, reason)

    def _judged(self, due: int, l1: float | None) -> tuple[bool, str]:
        """(whether to prune at a check within the window, due at that step; why): RIR."""
        rule, p = self.rule, self.progress
        if p.round == 0:
            return True, "first check"
        if l1 is None:
            return True, "every check prunes"
        waited, recovered = due - p.previous_step, l1 <= rule.beta * p.previous_l1
        reason = f"L1 {l1:.4g} {'<=' if recovered else '>'} {rule.beta:g} x {p.previous_l1:.4g}"
        if recovered or waited < rule.max_interval:
            return recovered, reason
        return True, f"forced by {waited} steps since the last prune, {reason}"

    def _keep(self, n: int) -> int:
        """What the current round leaves of ``n``, DPRA; it removes at least one."""
        rule, p = self.rule, self.progress
        if p.round == rule.rounds:
            return p.n_target
        if isinstance(rule.division, tuple):
            part = rule.division[p.round - 1] / sum(rule.division)
            return max(p.n_target, min(n - 1, round(n * (p.n_target / p.n_start) ** part)))
        parts = 2**p.round if rule.division == "halving" else rule.rounds or 1
        removed = max(1, round((p.n_start - p.n_target) / parts))
        return max(p.n_target, n - removed)
