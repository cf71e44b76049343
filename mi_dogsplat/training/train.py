"""Training: photographs in, primitives out. One thin loop; what happens to the primitives is up to strategies.

A ``Trainer`` holds the state; ``step()`` does one and returns nothing that waits for the device. Who runs to the end is
``runs/history.py``; who prints, draws or writes files is ``runs/run.py``; what densifies, prunes and makes DoG is in
``strategy/``, and ``strategy/strategy.py`` says how a strategy of your own joins.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..datasets import Dataset
from ..datasets.dataset import View
from ..datasets.depths import Depths
from ..engine.arrays import backward
from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.rasterize import Frame, rasterize
from ..formats.model import Model
from ..formats.sizes import FileKind
from ..render.picture import Picture, background_color, render_picture
from ..scene.appearance import Appearance
from ..scene.drawing import Drawing, DrawnAs
from ..scene.radiance import brightened
from ..scene.splats import Splats
from ..scores.score import Score
from ..scores.training_views import TrainingViews
from .accuracy import errors_of_test_views, training_l1
from .config import TrainConfig
from .events import Event
from .images.known_depth import KnownDepths
from .images.photographs import Photographs
from .loss_means import LossMeans
from .optimizer.learning_rates import LearningRates
from .optimizer.splat_optimizer import SplatOptimizer
from .recipe import Recipe
from .resolve import start_of
from .strategy.broken import broken
from .strategy.sh_ramp import ShRamp
from .strategy.strategy import Seen, Strategy
from .trainer_state import restore, state_of


class Trainer:
    """State of a run: parameters, optimizer moments, the order of views, and what each strategy remembers.

    ``recipe`` takes the place of that of ``config.preset``; it is scaled to ``config.steps``. ``strategies`` are its
    parts, ``states`` what they remember, by their names. ``model`` is the ``model_to_prune`` of the settings, where
    that has been read. Raises ``DataError`` for a model that cannot be pruned.
    """

    def __init__(
        self, config: TrainConfig, dataset: Dataset, recipe: Recipe | None = None, model: Model | None = None
    ):
        start = start_of(config, dataset, recipe, model)
        self.dataset, self.config, self.recipe = dataset, config, recipe = start.dataset, start.config, start.recipe
        self.background = background_color(config.background, dataset.has_alpha)
        self.extent, self.near_clip = start.extent, start.near_clip
        self.n_start, self.memory = start.splats.n_splats, start.memory
        self.rng = np.random.default_rng(config.seed)
        self.photographs = Photographs(
            dataset, self.background, self.near_clip, random=config.background == "random", masks=config.masks,
            appearance_steps=config.steps if config.appearance else None, on_disk=config.data_on_disk,
            keep_targets=self.memory is None or self.memory.keep_targets, curve=recipe.curve,
            batch_views=config.batch_views,
        )  # fmt: skip
        self.depths = KnownDepths(Depths(config.depths, dataset), self.photographs) if config.depths else None
        rates = LearningRates(
            self.extent, recipe.position_steps,
            refinement=recipe.refinement, preconditioning=recipe.preconditioning,
            batch_views=config.batch_views, views=len(dataset.train),
        )  # fmt: skip
        self.optimizer = SplatOptimizer(start.splats, rates, self.photographs.curve)
        self.steps, self.target = config.steps, 0.0 if config.target_bytes else float(config.target)
        self.step_count, self.seconds = 0, 0.0
        self.ended = False  # whether what is due after the last step is done
        self.order: list[int] = []  # of the views that are still to come in this turn, from its end
        self.losses = LossMeans()
        self.sieve = start.sieve
        kind = FileKind(config.format, self.drawing, in_units_of_white=True)
        size = None if config.target_bytes is None else (config.target_bytes, kind)
        self.strategies = recipe.strategies(self.sieve, size)
        self.states: dict[str, Any] = {strategy.name: strategy.new_state(self) for strategy in self.strategies}
        self.optimizer.followers += [partial(s.rearranged, state) for s, state in self._parts()]

    @property
    def drawing(self) -> Drawing:
        """How the ``model`` is to be drawn."""
        config, white = self.config, self.dataset.white
        return Drawing(config.antialiased, self.near_clip, white is not None, config.up, config.unit, white)

    def model(self) -> Splats:
        """The model on the host, of linear images in their radiance: the optimizer has it in units of white."""
        splats, white = self.optimizer.to_splats(), self.dataset.white
        return splats if white is None else brightened(splats, white)

    def _parts(self) -> list[tuple[Strategy[Any], Any]]:
        return [(strategy, self.states[strategy.name]) for strategy in self.strategies]

    @property
    def active_sh_degree(self) -> int:
        """0 at the start, one more every 1000 steps of the full schedule; a model that exists has all of its own."""
        return ShRamp(self.recipe.sh_every).degree(self.step_count, self.optimizer.sh_degree)

    @property
    def options(self) -> RasterOptions:
        """How a training view is rendered now."""
        return RasterOptions(
            sh_degree=self.active_sh_degree,
            antialiased=self.config.antialiased,
            isect_memory=self.memory.for_pairs(self.optimizer) if self.memory else None,
        )

    @property
    def training_views(self) -> TrainingViews:
        """As the loss sees them now, for scores."""
        shown = self.photographs
        return TrainingViews(shown.cameras, self.options, shown.background, shown.shown_mask, shown.curve)

    def step(self) -> list[Event]:
        """The views of a batch, then Adam with the mean of their gradients; the hooks of the strategies in between."""
        parts = self._parts()
        for strategy, state in parts:
            strategy.before_step(self, state)
        self.optimizer.schedule(self.step_count + self.recipe.first_step)
        for left in reversed(range(self.config.batch_views)):
            self._learn_from(self._next_view(), parts, last=not left)
            if left:
                dr.eval([dr.grad(value) for value in self.optimizer.adam.values()])  # else one kernel for all views
        self.optimizer.step(unused=() if self.active_sh_degree else self.optimizer.bands)

        self.step_count += 1
        return [event for strategy, state in parts for event in strategy.after_step(self, state)]

    def _next_view(self) -> int:
        if not self.order:
            self.order = self.rng.permutation(len(self.photographs)).tolist()
        return self.order.pop()

    def _learn_from(self, view: int, parts: list[tuple[Strategy[Any], Any]], last: bool) -> None:
        """Render, loss, backward: the gradient of a view, the ``last`` of its step or not, is added to the others'."""
        probe = None
        if any(strategy.collects(self, state) for strategy, state in parts):
            probe = [dr.zeros(mi.Float, self.optimizer.n) for _ in range(2)]
            dr.enable_grad(probe)
        self.photographs.choose_background(self.rng)
        params = self.optimizer.params
        for strategy, state in parts:
            params = strategy.params(self, state, params)
        camera = self.photographs.cameras[view]
        for strategy, state in parts:
            camera = strategy.camera(self, state, view, camera)
        planes, frame = self._render(params, camera, probe, depth=self.depths is not None)
        upcoming = self.order[::-1]  # views are taken from the end
        l1, loss, gradient = self.photographs.compare(planes, view, self.step_count, upcoming)
        depth_planes, by_depth = self.depths.gradient(frame, view) if self.depths else ([], [])
        backward([*planes, *depth_planes], [mi.Float(δ) for δ in (*gradient, *by_depth)])
        by_center = (dr.grad(probe[0]), dr.grad(probe[1])) if probe else None
        seen = Seen(view, camera, params, frame, planes, gradient, by_center, last)
        for strategy, state in parts:
            strategy.after_backward(self, state, seen)
        self.losses.add(l1, loss)

    def begin(self) -> list[Event]:
        """What is due before the first step, as for a model that exists."""
        return [event for strategy, state in self._parts() for event in strategy.begin(self, state)]

    def end(self) -> list[Event]:
        """What is due after the last step."""
        self.ended = True
        return [event for strategy, state in self._parts() for event in strategy.end(self, state)]

    def render(self, params: dict, view: int) -> tuple[list, Frame]:
        """Planes of a training view over the background, and the frame they come from."""
        return self._render(params, self.photographs.cameras[view])

    def _render(
        self, params: dict, camera: DeviceCamera, probe: list | None = None, depth: bool = False
    ) -> tuple[list, Frame]:
        frame = rasterize(params, camera, replace(self.options, depth=depth), probe)
        return self.photographs.over_background(frame), frame

    def logs(self) -> bool:
        """Whether there is a row with ``l1`` after this step, as before files are written."""
        return self.step_count % self.config.log_every == 0 or self.step_count == self.config.steps

    def due(self) -> bool:
        """Whether primitives are counted after this step: a row is logged, or a strategy is due."""
        return self.logs() or any(strategy.due(self, state) for strategy, state in self._parts())

    def sound(self) -> bool:
        """Whether nothing is broken, so that taking the ``state`` changes nothing. Waits for the device."""
        return not broken(self.optimizer, self.extent).any()

    def importance(self, score: Score) -> np.ndarray:
        """[N] what a score says of the primitives as they are."""
        return score(self.optimizer.params, self.training_views, self.config.seed + self.step_count)

    def scores(self, score: Score) -> np.ndarray:
        """[N] the same, as all strategies have it."""
        found = partial(self.importance, score)
        for strategy, state in reversed(self._parts()):
            found = partial(strategy.scores, self, state, found)
        return found()

    def training_l1(self) -> float:
        """Mean L1 over all training views, as the loss sees them."""
        return training_l1(self)

    def test_psnr(self) -> float | None:
        """Mean over the test views, None without any; the clock of the run stands still meanwhile."""
        if not self.dataset.test:
            return None
        start = time.perf_counter()
        errors = self.test_errors()
        self.seconds -= time.perf_counter() - start
        return errors.get("test_psnr")

    def test_errors(self, with_flip: bool = False) -> dict[str, float]:
        """Means over the test views: ``test_psnr``, and ``test_flip``, which takes longer."""
        return errors_of_test_views(self, with_flip)

    def picture(self, view: View, depth: bool = False) -> Picture:
        """The current model seen from a view."""
        white, options = self.dataset.white, replace(self.options, depth=depth)
        drawn = DrawnAs(self.config.antialiased, self.near_clip, linear=white is not None)  # in units of white
        found = render_picture(self.optimizer.params, view.camera, options, self.background, drawn)
        return found if white is None or found.radiance is None else found.in_units_of(white)

    def appearance(self) -> Appearance | None:
        """What is learned of the cameras so far; None where nothing is."""
        learned = self.photographs.appearance
        return learned.stored([view.name for view in self.dataset.train]) if learned else None

    def state(self) -> dict[str, np.ndarray]:
        """Everything that ``restore`` needs to go on as if nothing had happened (``trainer_state.py``)."""
        return state_of(self)

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take over a ``state()``. Raises ``ValueError`` or ``KeyError`` if it is of another kind of run."""
        restore(self, state)
