"""Adaptive density control (Kerbl et al. 2023, Sec. 5.2): clone, split, remove, reset opacities.

Removal by size on screen is off unless asked for. The paper names 20 px, but the authors' code never does it
(their issues 123 and 544: the radii are cleared before the test), and it hurts: fox at 225x400, 1,500 steps,
at most 30,000 primitives gives 24.17 dB with 20 px, 26.83 dB without. A first reset, and with it the start of
removal by size, at step 500 instead of 150 gives 27.69 dB: short runs need time to heal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import drjit as dr
import numpy as np

from ...scene.opacity import sigmoid
from ...scene.quaternions import rotated
from ..events import Densified, Event, OpacityReset
from ..milestones import scaled_milestone
from ..optimizer.splat_optimizer import SplatOptimizer
from .densify_stats import DensifyStats
from .strategy import Seen, Strategy, Training

MIN_REFINEMENTS = 30  # per run, however short
MIN_RESET_EVERY = 500  # steps; opacities need about 200 to come back


class Choice(NamedTuple):
    """Of a refinement, [N] each: who grows, who of these is cloned, not split, and who is removed."""

    grow: np.ndarray
    small: np.ndarray
    remove: np.ndarray


class Growth(Protocol):
    """Who grows and who is removed, where that is not ``by_gradient``; a dataclass of numbers, as a strategy."""

    def __call__(self, t: Training, rule: Densification, stats: DensifyStats) -> Choice: ...


class Halves(Protocol):
    """Where the halves of a split go and what they are: rows from ``first`` on, first those of one side."""

    def __call__(self, optimizer: SplatOptimizer, first: int, rng: np.random.Generator) -> None: ...


@dataclass(frozen=True)
class Densification(Strategy[DensifyStats]):
    """Numbers of the recipe, for a run of 30,000 steps; ``scaled`` fits them to a shorter one."""

    start: int = 500  # first refinement
    stop: int = 15_000  # no refinement from here on
    every: int = 100  # steps between refinements
    gradient_threshold: float = 2e-4  # of the screen-space position, normalised device coordinates
    clone_scale: float = 0.01  # larger primitives are split, smaller ones cloned; times the extent
    split_divisor: float = 1.6  # of the scales of both halves
    min_opacity: float = 0.005  # below: removed
    max_screen_radius: float = math.inf  # pixels, above: removed (after the first opacity reset)
    max_world_scale: float = 0.1  # times the extent, above: removed (after the first opacity reset)
    reset_every: int = 3000  # steps between opacity resets
    reset_opacity_to: float = 0.01
    max_primitives: int | None = None  # a cap that is never exceeded
    growth: Growth | None = None  # who grows, where that is not who has a large gradient
    halves: Halves | None = None  # of a split, where they are not samples of the primitive
    batch_views: int = 1  # of a step

    def scaled(self, factor: float) -> Densification:
        """The numbers for a run ``factor`` times as long. Milestones scale with it, with two exceptions.

        The interval stays, unless that made fewer than 30 refinements: what a refinement needs is enough
        views for its statistic, not a share of the run; with several views in a step they come sooner. Opacity
        resets keep 500 steps apart, fewer if steps are larger.
        """
        start, stop = scaled_milestone(self.start, factor), scaled_milestone(self.stop, factor)
        every = max(1, min(round(self.every / self.batch_views), (stop - start) // MIN_REFINEMENTS))
        least = min(self.reset_every, round(MIN_RESET_EVERY / math.sqrt(self.batch_views)))
        reset_every = max(scaled_milestone(self.reset_every, factor), least)
        return replace(self, start=start, stop=stop, every=every, reset_every=reset_every)

    def refines(self, step: int) -> bool:
        """Whether to refine after ``step`` steps."""
        return self.start <= step < self.stop and step % self.every == 0

    def resets_opacity(self, step: int) -> bool:
        """Whether to reset opacities after ``step`` steps: not in the last half of an interval before growth ends.

        Else what comes then, as pruning, would meet opacities that have not come back.
        """
        return 0 < step <= self.stop - self.reset_every / 2 and step % self.reset_every == 0

    def removes_large(self, step: int) -> bool:
        """Whether size is a reason to remove: only after the first opacity reset, with shapes settled."""
        return step > self.reset_every

    def reset_opacity(self, optimizer: SplatOptimizer) -> None:
        """Opacities to at most ``reset_opacity_to``, moments to zero: floaters must earn theirs."""
        limit = float(np.log(self.reset_opacity_to / (1 - self.reset_opacity_to)))
        optimizer.assign("logit_opacities", np.minimum(optimizer.numpy("logit_opacities"), limit))
        optimizer.reset_moments("logit_opacities")

    def new_state(self, t: Training) -> DensifyStats:
        return DensifyStats.zeros(t.optimizer.n)

    def collects(self, t: Training, state: DensifyStats) -> bool:
        return t.step_count < self.stop

    def after_backward(self, t: Training, state: DensifyStats, seen: Seen) -> None:
        if t.memory and seen.frame.view:
            t.memory.pairs = max(t.memory.pairs, seen.frame.view.n_isects)
        if seen.by_center and seen.frame.projection and t.step_count < self.stop:
            state.add(*seen.by_center, seen.frame.projection, seen.camera.width, seen.camera.height)

    def due(self, t: Training, state: DensifyStats) -> bool:
        return self.refines(t.step_count)

    def after_step(self, t: Training, state: DensifyStats) -> list[Event]:
        events = self._refine(t, state) if self.refines(t.step_count) else []
        if self.resets_opacity(t.step_count):
            self.reset_opacity(t.optimizer)
            events.append(OpacityReset())
        return events

    def _refine(self, t: Training, state: DensifyStats) -> list[Event]:
        rule, full = self, None
        if t.memory:
            most, full = t.memory.bounded(self.max_primitives, t.optimizer.n)
            rule = replace(self, max_primitives=most)
        if rule.growth:
            choice = rule.growth(t, rule, state)
        else:
            choice = by_gradient(rule, t.optimizer, state, t.step_count, t.extent)
        done = grow_and_remove(t.optimizer, choice, rule.split_divisor, t.rng, rule.halves)
        state.clear(t.optimizer.n)
        if t.memory:
            t.memory.give_back(t.optimizer.n)
        events: list[Event] = [done] if done != Densified(0, 0, 0) else []
        return events + ([full] if full and t.optimizer.n >= full.most else [])

    def rearranged(self, state: DensifyStats, index: np.ndarray, fresh: np.ndarray) -> None:
        state.follow(index)


def by_gradient(
    rule: Densification, optimizer: SplatOptimizer, stats: DensifyStats, step: int, extent: float
) -> Choice:
    """3DGS, after ``step`` steps: grow where the image pulls at primitives, remove what cannot be seen.

    Neither the result nor anything on the way to it has more than ``rule.max_primitives`` rows; if not all fit, those
    with the largest gradients come first. What is too large stays only if it is split, as a half may be small enough.
    Values have to be finite (``broken.py``).

    Raises ``ValueError`` for statistics of another number of primitives.
    """
    n = optimizer.n
    if (rows := dr.width(stats.views)) != n:
        raise ValueError(f"by_gradient: the statistics have {rows} rows, the optimizer has {n}; make new ones")
    largest, opacity = optimizer.largest_scales, sigmoid(optimizer.numpy("logit_opacities"))
    gradient = stats.mean_gradient()
    grow = gradient > rule.gradient_threshold
    small = largest <= rule.clone_scale * extent  # cloned, not split
    remove, to_halve = opacity < rule.min_opacity, np.zeros(n, bool)
    if rule.removes_large(step):
        limit = rule.max_world_scale * extent
        halved = np.where(grow & ~small, largest / rule.split_divisor, largest)
        remove |= stats.max_radius.numpy() > rule.max_screen_radius
        remove |= halved > limit
        to_halve = ~remove & (largest > limit)
    _spare_one(remove, opacity)
    grow &= ~remove
    if rule.max_primitives is not None:
        grow = _within(rule.max_primitives, grow, remove, to_halve, gradient)
        remove |= to_halve & ~grow
        _spare_one(remove, opacity)
        _remove_surplus(rule.max_primitives, remove, opacity)
    return Choice(grow, small, remove)


def _remove_surplus(most: int, remove: np.ndarray, opacity: np.ndarray) -> None:
    """Of a start above the cap: remove all but the most opaque."""
    alive = np.flatnonzero(~remove)
    if len(alive) > most:
        remove[alive[np.argsort(-opacity[alive], kind="stable")[most:]]] = True


def _spare_one(remove: np.ndarray, opacity: np.ndarray) -> None:
    """Keep the most opaque where all are about to be removed: an empty model cannot recover."""
    if remove.all():
        remove[np.argmax(opacity)] = False


def _within(most: int, grow: np.ndarray, remove: np.ndarray, to_halve: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """[N] those that ``grow`` and fit into ``most`` rows, by gradient; who is ``to_halve`` stays only as halves."""
    room = most - int(np.sum(~remove & ~to_halve))
    candidates = np.flatnonzero(grow)
    candidates = candidates[np.argsort(-gradient[candidates], kind="stable")]
    rows = np.cumsum(1 + to_halve[candidates])  # one more each, and both halves of what does not stay as it is
    fitting = np.zeros(len(grow), bool)
    fitting[candidates[rows <= room]] = True
    return fitting


def grow_and_remove(
    optimizer: SplatOptimizer,
    choice: Choice,
    split_divisor: float,
    rng: np.random.Generator,
    halves: Halves | None = None,
) -> Densified:
    """Clone or split those that grow, of which there is one more each, and remove others, none of these."""
    grow, small, remove = choice
    n = optimizer.n
    clone, split = np.flatnonzero(grow & small), np.flatnonzero(grow & ~small)
    keep = np.flatnonzero(~remove & ~(grow & ~small))
    index = np.concatenate([keep, clone, split, split])
    fresh = np.arange(len(index)) >= len(keep)
    if len(index) != n or len(clone) or len(split):
        optimizer.rearrange(index, fresh)
        if len(split):
            first = len(index) - 2 * len(split)
            halves(optimizer, first, rng) if halves else _place_halves(optimizer, first, rng, split_divisor)
    return Densified(len(clone), len(split), int(remove.sum()))


def _place_halves(optimizer: SplatOptimizer, first: int, rng: np.random.Generator, divisor: float) -> None:
    """Rows from ``first`` on are copies of split primitives: sample their centres from it and shrink them."""
    rows = np.arange(first, optimizer.n)
    log_scales, quats = optimizer.numpy("log_scales")[rows], optimizer.numpy("quats")[rows]
    offset = rng.normal(size=(len(rows), 3)) * np.exp(log_scales)  # [R, 3] in the primitive's frame
    optimizer.assign("means", optimizer.numpy("means")[rows] + rotated(offset, quats), rows)
    optimizer.assign("log_scales", log_scales - np.log(divisor), rows)
