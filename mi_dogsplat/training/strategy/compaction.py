"""Compaction to a file of a given size: bytes are divided between primitives, their bands of colour and their rows.

In the window in which a count is pruned to, and by the same rule (``scheduler.py``), in bytes: of what the file has
more than it may have, rounds take away their parts. Each round measures all options (``options.py``) and the size of
the file as it is, which scales the prices. Bands that go do not come back. Half-way between the window and the end of
the run, when rows of DoG, slopes, cuts and so on are there and bands have settled, the bytes are divided once more.
Rows that the primitives are to get count from the first check on, as if they were there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...formats.sizes import FileKind, prices
from ...scene.curvatures import mean_brightness
from ...scene.row_groups import CURVATURES, OWN_AXES, RowGroup
from ...scene.sh_basis import C0
from ...scene.splats import Splats
from ...support.errors import DataError
from ..events import Allocated, Event, NotPruned, Pruned, Refined
from ..optimizer.faded import drop_faded
from ..optimizer.sh_rows import bands_of
from ..optimizer.splat_optimizer import SplatOptimizer
from .options import Chosen, Options
from .scheduler import Progress, PruningRule, PruningScheduler
from .strategy import Strategy, Training

ATTEMPTS = 12  # to meet a size
FULL = 0.98  # of what a file may have


@dataclass
class Compacted(Progress):
    """How far it has come; the counts of ``Progress`` are bytes."""

    settled: bool = False  # whether the bytes were divided once more


@dataclass(frozen=True)
class Compaction(Strategy[Compacted]):
    """The window of a run that ends with a file of ``size`` bytes."""

    rule: PruningRule
    size: int
    kind: FileKind
    given: tuple[RowGroup, ...] = ()  # of which all primitives are to get rows

    def new_state(self, t: Training) -> Compacted:
        """Raises ``DataError`` where the file of a single primitive in its mean colour, with all rows that it is to
        get, is too large: they count in the first rounds, and none of them may go by then."""
        least = self.kind.size(self.kind.foreseen(with_rows(one_gaussian(), self.given)))
        if least > self.size:
            raise self._nothing_fits(self.size, f": one takes {least} bytes or more")
        return Compacted()

    def due(self, t: Training, state: Compacted) -> bool:
        """Whether there is a check after this step."""
        return PruningScheduler(self.rule, state).checks(t.step_count) or self._settles(t, state)

    def begin(self, t: Training, state: Compacted) -> list[Event]:
        return [] if state.finished else self.after_step(t, state)  # what is left then waits for a step

    def after_step(self, t: Training, state: Compacted) -> list[Event]:
        """Where a check is due, measure, decide, and divide the bytes anew if that is the decision."""
        if not self.due(t, state):
            return []
        splats = with_rows(t.optimizer.to_splats(), self.given)
        size = self.kind.size(self.kind.foreseen(splats))
        if self._settles(t, state):
            state.settled = True
            reason = "the rest of the run refines"
            return self._divide(t, splats, size, self.size, reason) if size > self.size else []
        scheduler = PruningScheduler(self.rule, state, "bytes")
        if size <= self.size and not state.begun:
            state.finished = True
            more = "it has room for more primitives"
            if t.step_count:  # a model that exists is pruned from the first step on, and does not grow
                more += ", where --max-primitives lets the model grow to them"
            return [NotPruned(f"the file has {size} bytes, the target is {self.size}; {more}")]
        if not state.begun:
            scheduler.begin(size, self.size)
        measured = t.training_l1() if self.rule.compares else None
        decision = scheduler.decide(t.step_count, size, measured)
        if not decision.prune:
            return [Refined(decision.reason, measured)]
        return self._divide(t, splats, size, decision.keep, decision.reason, measured)

    def end(self, t: Training, state: Compacted) -> list[Event]:
        """Leave out what can never be seen and, where the file is too large, what the model can do without best.

        Numbers are on the grids of the file by now: primitives go, and none changes. Raises ``DataError`` where
        none would be left.
        """
        drop_faded(t.optimizer, t.optimizer.to_splats().opacities)
        splats = t.optimizer.to_splats()
        size = self.kind.size(splats)
        if size <= self.size:
            return []
        return self._divide(t, splats, size, self.size, "the file has its size", ended=True)

    def _settles(self, t: Training, state: Compacted) -> bool:
        return state.finished and not state.settled and 2 * t.step_count >= t.steps + self.rule.stop

    def _divide(
        self,
        t: Training,
        splats: Splats,
        size: int,
        budget: int,
        reason: str,
        l1: float | None = None,
        ended: bool = False,
    ) -> list[Event]:
        """Give the model what gains most within ``budget``; ``size`` are the bytes of its file as it is."""
        options = Options.of(t, splats)
        if ended and self.kind.name != "ply":
            options = options.of_whole_primitives(splats.means)
        model, kept, after = self._fitting(splats, size, budget, options, ended)
        take(t.optimizer, model, kept)
        allocated = Allocated(after, budget, tuple(np.bincount(model.sh_degrees, minlength=4).tolist()), model.n_dog)
        return [Pruned(splats.n_splats, model.n_splats, reason, l1), allocated]

    def _fitting(
        self, splats: Splats, size: int, budget: int, options: Options, ended: bool
    ) -> tuple[Splats, np.ndarray, int]:
        """(model of a choice whose file has at most ``budget`` bytes, its rows, the bytes).

        Prices are estimates. What a file has too much, or has room for, changes the budget of the next attempt, until
        it is full. Raises ``DataError`` where nothing fits.
        """
        known = prices(self.kind, splats)
        known = known.scaled((size - known.fixed) / (known.of(splats) - known.fixed))
        wanted, low, high, best = float(budget), known.fixed, np.inf, None
        after, step = 0, 1.2
        for _ in range(ATTEMPTS):
            chosen, before, after = options.chosen(known, wanted), after, 0
            if len(chosen.kept):
                model = as_chosen(splats, options, chosen)
                after = self.kind.size(model if ended else self.kind.foreseen(model))
            if after > budget:
                high = wanted
            else:
                low = wanted
                best = (model, chosen.kept, after) if len(chosen.kept) else best
            if best and (best[2] >= FULL * budget or len(best[1]) == splats.n_splats):
                return best
            step = 2 * step if after == before else 1.2  # where the excess is less than what the next part to go takes
            guess = wanted + (budget - after) * (step if after > budget else 1)
            wanted = guess if low < guess < high else (low + min(high, 2 * wanted)) / 2
        if best:
            return best
        raise self._nothing_fits(budget)

    def _nothing_fits(self, budget: int, least: str = "") -> DataError:
        problem = f"no primitive fits into {budget} bytes of {self.kind.name}"
        return DataError("--target", problem, f"use a larger size{least}")


def one_gaussian() -> Splats:
    """The least that a file may hold: one primitive in its mean colour."""
    place, colour = np.zeros((1, 3)), np.zeros((1, 1, 3))
    return Splats(place, place, np.array([[0.0, 0, 0, 1]]), np.zeros(1), colour)


def with_rows(splats: Splats, groups: Sequence[RowGroup]) -> Splats:
    """The model with rows of zeros for all primitives, of groups that no primitive is in."""
    n, rows = splats.n_splats, {}
    for group in groups:
        if not len(getattr(splats, group.index)):
            rows |= {name: np.zeros((n, *shape)) for name, shape in group.arrays.items()} | {group.index: np.arange(n)}
    return replace(splats, **rows)


def as_chosen(splats: Splats, options: Options, chosen: Chosen) -> Splats:
    """The model with what was chosen; what is left of a colour is fitted to the pictures as they were.

    Shifts stay with their primitives.
    """
    degrees = splats.sh_degrees
    degrees[chosen.kept] = chosen.degrees
    whole = replace(splats.uniform_sh(), sh_coeffs=options.bands.fitted(degrees)).select(chosen.kept)
    left: dict[str, np.ndarray] = {}
    for group, places in chosen.rows.items():
        index = getattr(whole, group.index)
        stay = np.isin(index, places)
        if group == CURVATURES:  # of those that go the average brightness stays
            flatter = index[~stay]
            average = mean_brightness(whole.brightness_curvatures[~stay], whole.log_scales[flatter])
            whole.sh_coeffs[flatter, 0] += average[:, None] / C0
        left |= {name: getattr(whole, name)[stay] for name in (group.index, *group.names)}
    return replace(whole, **left).with_sh_degrees(chosen.degrees)


def take(optimizer: SplatOptimizer, model: Splats, kept: np.ndarray) -> None:
    """Make a model with what was chosen that of an optimizer; what stays keeps its moments.

    Args:
        model: of K primitives.
        kept: [K] the row of the optimizer that each of them is.
    """
    optimizer.keep(kept)
    optimizer.set_sh_degrees(model.sh_degrees)
    optimizer.assign("sh_dc", model.sh_coeffs[:, 0])
    for name, values in bands_of(model).items():
        optimizer.assign(name, values.reshape(len(values), -1))
    if optimizer.n_dog != model.n_dog:
        optimizer.set_dog(model.dog_index, model.dog_logit_opacities, model.dog_log_scales)
    for group in OWN_AXES:
        index = getattr(model, group.index)
        if len(optimizer.index_of(group)) not in (0, len(index)):  # 0: they are still to come
            optimizer.set_rows(group, index, {name: getattr(model, name) for name in group.names})
