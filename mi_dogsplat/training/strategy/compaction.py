"""Compaction to a file of a given size: bytes are divided between primitives, their bands of colour and DoG rows.

In the window in which a count is pruned to, and by the same rule (``scheduler.py``), in bytes: of what the file has
more than it may have, rounds take away their parts. Each round measures all options (``options.py``) and the size of
the file as it is, which scales the prices. Bands that go do not come back. Half-way between the window and the end of
the run, when DoG rows are there and bands have settled, the bytes are divided once more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...engine.geometry import Cutoffs
from ...formats.sizes import encoded, prices
from ...scene.row_groups import DOG
from ...scene.splats import Splats
from ...support.errors import DataError
from ..events import Allocated, Event, NotPruned, Pruned, Refined
from ..optimizer import SplatOptimizer
from ..sh_rows import bands_of
from .options import Chosen, Options
from .scheduler import Progress, PruningRule, PruningScheduler
from .strategy import Strategy, Training

ATTEMPTS = 12  # to meet a size


@dataclass
class Compacted(Progress):
    """How far it has come; the counts of ``Progress`` are bytes."""

    settled: bool = False  # whether the bytes were divided once more


@dataclass(frozen=True)
class Compaction(Strategy[Compacted]):
    """The window of a run that ends with a file of ``size`` bytes, in a format of ``formats/sizes.py``."""

    rule: PruningRule
    size: int
    format: str

    def new_state(self, t: Training) -> Compacted:
        return Compacted()

    def due(self, t: Training, state: Compacted) -> bool:
        """Whether there is a check after this step."""
        return PruningScheduler(self.rule, state).checks(t.step_count) or self._settles(t, state)

    def begin(self, t: Training, state: Compacted) -> list[Event]:
        return self.after_step(t, state)

    def after_step(self, t: Training, state: Compacted) -> list[Event]:
        """Where a check is due, measure, decide, and divide the bytes anew if that is the decision."""
        if not self.due(t, state):
            return []
        splats = t.optimizer.to_splats()
        size = len(encoded(self.format, splats))
        if self._settles(t, state):
            state.settled = True
            return self._divide(t, splats, size, self.size, "the rest of the run refines") if size > self.size else []
        scheduler = PruningScheduler(self.rule, state)
        if size <= self.size and not state.begun:
            state.finished = True
            return [NotPruned(f"the file has {size} bytes, the target is {self.size}")]
        if not state.begun:
            scheduler.begin(size, self.size)
        measured = t.training_l1()
        decision = scheduler.decide(t.step_count, size, measured)
        if not decision.prune:
            return [Refined(decision.reason, measured)]
        return self._divide(t, splats, size, decision.keep, decision.reason, measured)

    def _settles(self, t: Training, state: Compacted) -> bool:
        return state.finished and not state.settled and 2 * t.step_count >= t.steps + self.rule.stop

    def _divide(
        self, t: Training, splats: Splats, size: int, budget: int, reason: str, l1: float | None = None
    ) -> list[Event]:
        l1 = t.training_l1() if l1 is None else l1
        model, kept, after = self._fitting(splats, size, budget, Options.of(t, splats))
        take(t.optimizer, model, kept)
        degrees = tuple(np.bincount(model.sh_degrees, minlength=4).tolist())
        allocated = Allocated(after, budget, degrees, model.n_dog)
        return [Pruned(splats.n_splats, model.n_splats, reason, l1), allocated]

    def end(self, t: Training, state: Compacted) -> list[Event]:
        """Leave out what can never be seen and, where the file is too large, what the model can do without best."""
        t.optimizer.keep(np.flatnonzero(t.optimizer.to_splats().opacities >= Cutoffs().alpha))
        splats = t.optimizer.to_splats()
        size = len(encoded(self.format, splats))
        return self._divide(t, splats, size, self.size, "the file has its size") if size > self.size else []

    def _fitting(self, splats: Splats, size: int, budget: int, options: Options) -> tuple[Splats, np.ndarray, int]:
        """(model of a choice whose file has at most ``budget`` bytes, its rows, the bytes); ``size``: of all of it now.

        Prices are estimates: what a file has too much comes off the next attempt, and a little more each time, but no
        more than a half of what the primitives may take.
        Raises ``DataError`` where nothing fits.
        """
        known = prices(self.format, splats)
        known = known.scaled((size - known.fixed) / (known.of(splats) - known.fixed))
        wanted = float(budget)
        for attempt in range(ATTEMPTS):
            chosen = options.chosen(known, wanted)
            if not len(chosen.kept):
                break
            model = as_chosen(splats, options, chosen)
            after = len(encoded(self.format, model))
            if after <= budget:
                return model, chosen.kept, after
            wanted = max(wanted - (after - budget) * (1 + attempt / 4), (wanted + known.fixed) / 2)
        raise DataError("--target", f"no primitive fits into {budget} bytes of {self.format}", "use a larger size")


def as_chosen(splats: Splats, options: Options, chosen: Chosen) -> Splats:
    """The model with what was chosen; what is left of a colour is fitted to the pictures as they were."""
    degrees = splats.sh_degrees
    degrees[chosen.kept] = chosen.degrees
    whole = replace(splats.uniform_sh(), sh_coeffs=options.bands.fitted(degrees)).select(chosen.kept)
    rows = np.isin(whole.dog_index, chosen.dog)
    dog = {name: getattr(whole, name)[rows] for name in (DOG.index, *DOG.names)}
    return replace(whole, **dog).with_sh_degrees(chosen.degrees)


def take(optimizer: SplatOptimizer, model: Splats, kept: np.ndarray) -> None:
    """Make ``model``, of the rows ``kept`` with what was chosen, that of an optimizer; what stays keeps its moments."""
    optimizer.keep(kept)
    optimizer.set_sh_degrees(model.sh_degrees)
    optimizer.assign("sh_dc", model.sh_coeffs[:, 0])
    for name, values in bands_of(model).items():
        optimizer.assign(name, values.reshape(len(values), -1))
    if optimizer.n_dog != model.n_dog:
        optimizer.set_dog(model.dog_index, model.dog_logit_opacities, model.dog_log_scales)
