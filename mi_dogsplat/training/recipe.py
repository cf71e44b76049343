"""A whole training as rules, which are numbers without tensors, and the strategies that they make."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from ..formats.sizes import FileKind
from ..scene.row_groups import RowGroup
from ..scores.score import Score
from ..support.wording import in_words
from .given_rows import GIVEN
from .images.tone_curve import SrgbLog, ToneCurve
from .milestones import scaled_milestone
from .optimizer.learning_rates import Refinement
from .optimizer.preconditioning import Preconditioning
from .quantisation.room import Room
from .strategy.compaction import Compaction
from .strategy.cut_activation import CutRule
from .strategy.densify import Densification
from .strategy.dog_control import DogActivation, DogControl, DogRule
from .strategy.prune import Pruning
from .strategy.quantise import Quantisation
from .strategy.row_activation import RowActivation, RowControl, RowRule
from .strategy.scheduler import PruningRule
from .strategy.sh_ramp import ShRamp
from .strategy.shift_activation import ShiftRule
from .strategy.sieve import Sieve
from .strategy.slope_activation import SlopeRule
from .strategy.strategy import Strategy

ACTIVATION = 18_000  # step at which primitives become DoG and are given slopes, cuts and so on, where growth is usual
GROWTH_GAIN = 2.0  # of the step sizes in a growth that is shorter than usual
SETTLED = 500  # steps after which Adam knows the size of gradients that are new
PRECONDITIONING = Preconditioning(start=ACTIVATION + SETTLED)


@dataclass(frozen=True)
class Recipe:
    """A whole training: densify, prune to a target, make the rest DoG. Steps count in a schedule of its own length.

    Raises ``ValueError`` for pruning without a score.
    """

    densification: Densification = Densification()
    pruning: PruningRule | None = None
    score: Score | None = None  # who goes; needed by pruning
    dog: DogRule | None = None
    reference_steps: int = 30_000  # length of the schedule that all milestones are written for
    position_steps: int = 30_000  # over which the step size of positions falls
    sh_every: int = 1000  # steps between raises of the SH degree; 0: all degrees from the start
    refinement: Refinement | None = None  # larger step sizes from some step on
    first_step: int = 0  # of the schedule, where training starts: later for a model that exists
    also: tuple[Strategy[Any], ...] = ()  # of your own, between the control of density and pruning
    quantisation: Quantisation | None = None  # of the last part, for a file that is no PLY
    curve: ToneCurve = SrgbLog()  # through which the loss sees linear images
    start_share: float | None = None  # of the target, a count, that training starts with at most: for one that grows
    slopes: SlopeRule | None = None  # colours that vary over their primitive
    curvatures: SlopeRule | None = None  # and a brightness that curves
    cuts: CutRule | None = None  # primitives that a plane cuts off
    second_cuts: CutRule | None = None  # and that a second one does
    shifts: ShiftRule | None = None  # places that depend on the view
    preconditioning: Preconditioning | None = None  # steps in which the numbers of a primitive move together

    def __post_init__(self) -> None:
        if self.pruning and not self.score:
            raise ValueError("Recipe: pruning needs a score")

    def start_limit(self, target: float | str) -> int | None:
        """Primitives that training to a target starts with at most, as far as the recipe says.

        Raises ``ValueError`` for one that grows, and a target that is no number of primitives.
        """
        if self.start_share is None:
            return None
        if isinstance(target, str) or target < 1:
            raise ValueError(f"Recipe.start_limit: this recipe grows to a number of primitives, not to {target}")
        return max(1, int(self.start_share * target))

    def scaled(self, steps: int) -> Recipe:
        """The recipe for a run of ``steps`` steps: every milestone at the same part of the run."""
        factor = steps / self.reference_steps
        milestones = {
            name: scaled_milestone(getattr(self, name), factor) for name in ("position_steps", "sh_every", "first_step")
        }
        return replace(
            self,
            densification=self.densification.scaled(factor),
            pruning=self.pruning and self.pruning.scaled(factor),
            dog=self.dog and self.dog.scaled(factor),
            **{name: rule.scaled(factor) for name, rule in self.row_rules.items()},
            refinement=self.refinement and self.refinement.scaled(factor),
            preconditioning=self.preconditioning and self.preconditioning.scaled(factor),
            also=tuple(strategy.scaled(factor) for strategy in self.also),
            reference_steps=steps,
            **milestones,
        )

    def preconditioned(self) -> Recipe:
        """The recipe with preconditioned steps once what it gives to primitives has settled, and not while it prunes.

        One that has such steps stays as it is. One that neither prunes nor gives has them from step 18,500 on, and
        earlier by as much as its growth ends earlier.
        """
        if self.preconditioning:
            return self
        grown = Densification().stop
        usual = ACTIVATION + (self.densification.stop or grown) - grown
        begins = [rule.start for rule in (self.dog, *self.row_rules.values()) if rule]
        begins += [self.pruning.stop] if self.pruning else []
        return replace(self, preconditioning=replace(PRECONDITIONING, start=max([usual, *begins]) + SETTLED))

    @property
    def row_rules(self) -> dict[str, RowRule]:
        """Rules of rows that it gives to primitives, beside DoG, by their names in ``GIVEN``."""
        return {name: getattr(self, name) for name in GIVEN if getattr(self, name)}

    @property
    def given_groups(self) -> tuple[RowGroup, ...]:
        """Of these rows."""
        return tuple(GIVEN[name].group for name in self.row_rules)

    @property
    def given(self) -> str:
        """What it gives to primitives that PLY alone holds, beside DoG: ``slopes and cuts``, or nothing."""
        return in_words([name.replace("_", " ") for name in self.row_rules])

    def for_format(self, name: str) -> Recipe:
        """The recipe of a model that ends in a file of that format: only PLY holds DoG, and numbers as they are.

        Raises ``ValueError`` for a recipe that gives slopes, curvatures, cuts or shifts, and another format.
        """
        if name != "ply" and (rows := self.given):
            raise ValueError(f"Recipe.for_format: this recipe gives {rows} to primitives, which {name} does not hold")
        return self if name == "ply" else replace(self, dog=None, quantisation=Quantisation(name))

    def as_set(self, preconditioned: bool, format: str, growth: float | None) -> Recipe:
        """The recipe as the settings of a run of these names change it. Raises ``ValueError`` where they cannot."""
        recipe = (self.preconditioned() if preconditioned else self).for_format(format)
        return recipe if growth is None else recipe.growing(growth)

    def growing(self, share: float, gain: float = GROWTH_GAIN) -> Recipe:
        """The recipe with densification that ends after that share of the steps, which are ``gain`` times as large.

        What follows keeps its distance from the end of densification, so refinement is as much longer as growth is
        shorter. Larger steps make larger gradients, so the threshold of density control grows with their root, and
        the number of primitives stays about the same (docs/experiments/growth.md). Of a recipe that has such a growth
        already both are those of the new one.

        Raises ``ValueError`` for a share that leaves no growth, or no steps behind the last milestone.
        """
        density, stop = self.densification, round(share * self.reference_steps)
        if stop <= density.start:
            raise ValueError(f"Recipe.growing: a share of {share:g} leaves no step to grow")
        steps = density.stop - stop
        refinement = self.refinement or Refinement(density.stop, gain=1.0, end_gain=1.0, means_gain=1.0)
        threshold = density.gradient_threshold * math.sqrt(gain / refinement.growth_gain)
        sooner = replace(
            self,
            densification=replace(density, stop=stop, gradient_threshold=threshold),
            refinement=replace(refinement.earlier(steps), growth_gain=gain),
            preconditioning=self.preconditioning and self.preconditioning.earlier(steps),
            **self._earlier(steps),
        )
        if sooner.last_milestone >= self.reference_steps:
            raise ValueError(f"Recipe.growing: a share of {share:g} leaves no step after the last milestone")
        return sooner

    @property
    def last_milestone(self) -> int:
        """Step at which the last part of the recipe begins, or the window of pruning closes."""
        rules = [self.refinement, self.preconditioning, self.dog, *self.row_rules.values()]
        closed = self.pruning.stop if self.pruning else self.densification.stop
        return max([closed, *(rule.start for rule in rules if rule)])

    def from_pruning(self) -> Recipe:
        """What is left of the recipe for a model that exists: from the first check on, without densification.

        Raises ``ValueError`` for a recipe that does not prune.
        """
        if not self.pruning:
            raise ValueError("Recipe.from_pruning: this recipe does not prune")
        start = self.pruning.start
        return replace(
            self,
            densification=replace(self.densification, start=0, stop=0),
            reference_steps=self.reference_steps - start,
            sh_every=0,
            first_step=start,
            **self._earlier(start),
        )

    def _earlier(self, steps: int) -> dict[str, Any]:
        """Pruning and what is no step size and follows on it, by their fields, that many steps earlier."""
        return {
            "pruning": self.pruning and self.pruning.earlier(steps),
            "dog": self.dog and self.dog.earlier(steps),
            "also": tuple(strategy.earlier(steps) for strategy in self.also),
            **{name: rule.earlier(steps) for name, rule in self.row_rules.items()},
        }

    def strategies(self, sieve: Sieve, size: tuple[int, FileKind] | None = None) -> list[Strategy[Any]]:
        """The parts of the training, in the order in which they act.

        Args:
            sieve: what leaves without being pruned.
            size: bytes of the file to end with, and what kind of file; None: a number of primitives.

        Raises ``ValueError`` where two of them have one name.
        """
        parts: list[Strategy[Any]] = [DogControl(self.dog)] if self.dog and self.dog.control else []
        parts += [RowControl(GIVEN[name], rule) for name, rule in self.row_rules.items()]
        parts += [sieve, self.densification, ShRamp(self.sh_every), *self.also]
        if self.pruning and size:
            parts += [Compaction(self.pruning, *size, given=self.given_groups)]
        elif self.pruning and self.score:
            parts += [Pruning(self.pruning, self.score)]
        parts += [DogActivation(self.dog)] if self.dog else []
        parts += [RowActivation(GIVEN[name], rule) for name, rule in self.row_rules.items()]
        if self.quantisation:
            room = Room(*size) if size and size[1].name == self.quantisation.format else None
            parts += [replace(self.quantisation, room=room)]
        names = [part.name for part in parts]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f'Recipe: two strategies have the name "{twice[0]}"')
        return parts
