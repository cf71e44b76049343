"""Training: photographs in, primitives out. Densify (Kerbl et al. 2023, Sec. 5), prune, make the rest DoG.

A ``Trainer`` holds the state; ``step()`` does one and returns nothing that waits for the device. Who runs to the end is
``history.py``; who prints, draws or writes files is ``run.py``.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..datasets import Dataset
from ..datasets.dataset import View, camera_extent
from ..engine.project import DeviceCamera
from ..engine.rasterize import Frame, RasterOptions, rasterize
from ..measure.metrics import flip, psnr
from ..render.picture import Picture, background_color, over_background, render_picture
from .config import TrainConfig
from .footprint import budget
from .initialize import initial_splats
from .learning_rates import LearningRates
from .optimizer import SplatOptimizer
from .photographs import READ_AHEAD, Photographs
from .presets import RECIPES, Recipe
from .strategy.densify import Densification, DensifyStats, refine
from .strategy.dog_control import activate, degenerate
from .strategy.prune import Pruning
from .strategy.sieve import leaving, sieve
from .trainer_state import restore, state_of


class Trainer:
    """State of a run: parameters, optimizer moments, statistics, schedules, the order of views.

    ``recipe`` takes the place of that of ``config.preset``; it is scaled to ``config.steps``. Raises ``DataError``
    for a model that cannot be pruned.
    """

    def __init__(self, config: TrainConfig, dataset: Dataset, recipe: Recipe | None = None):
        self.config, self.dataset = config, dataset
        recipe = recipe or RECIPES[config.preset]
        self.recipe = (recipe if config.model is None else recipe.from_pruning()).scaled(config.steps)
        self.background = background_color(config.background, dataset.has_alpha)
        self.extent = camera_extent(dataset.train)
        self.positions = np.array([view.camera.position for view in dataset.train])  # [V, 3]
        splats = initial_splats(config, dataset)
        self.sh_degree = splats.sh_degree
        self.memory = budget(config.memory, dataset, self.sh_degree, config.data_on_disk)
        if self.memory:
            self.memory.require(config.data, splats.n_splats)
        self.rng = np.random.default_rng(config.seed)
        self.cameras = [DeviceCamera.upload(v.camera, config.near_clip) for v in dataset.train]
        self.photographs = Photographs(config, dataset, self.background)
        rates = LearningRates(self.extent, self.recipe.position_steps, refinement=self.recipe.refinement)
        self.optimizer = SplatOptimizer(splats, rates)
        self.densification = replace(
            self.recipe.densification, max_primitives=config.max_primitives, max_world_scale=config.max_world_scale
        )
        self.stats = DensifyStats(self.optimizer.n)
        self.pruning = Pruning(self.recipe.pruning, config.target) if self.recipe.pruning else None
        self.dog_activated = False
        self.step_count = 0
        self.seconds = 0.0
        self.order: list[int] = []
        self._forget_losses()

    def _forget_losses(self):
        Float: Any = dr.detached_t(mi.Float)
        self.l1_sum, self.loss_sum, self.summed = dr.opaque(Float, 0), dr.opaque(Float, 0), 0

    @property
    def active_sh_degree(self) -> int:
        """0 at the start, one more every 1000 steps of the full schedule; a model that exists has all of its own."""
        every = self.recipe.sh_every
        return min(self.sh_degree, self.step_count // every) if every else self.sh_degree

    @property
    def options(self) -> RasterOptions:
        return RasterOptions(sh_degree=self.active_sh_degree, antialiased=self.config.antialiased)

    def _render(self, params: dict, view: int, probe: list | None = None) -> tuple[list, Frame]:
        """Planes of a training view over the background, and the frame they come from."""
        frame = rasterize(params, self.cameras[view], self.options, probe)
        return self.photographs.over_background(frame), frame

    def trained_params(self) -> dict:
        """What a training step renders: the parameters, for a method that learns a mask seen through it."""
        return self.optimizer.params

    def regularise(self, view: int, gradient: list) -> None:
        """Add to the gradients of the parameters before Adam's step. Nothing here; a method may have more to say.

        Args:
            view: that was rendered.
            gradient: of the loss by its planes.
        """

    def step(self) -> dict[str, Any]:
        """One training view: render, loss, backward, Adam, density control.

        Returns fields of a row of the history: none, or ``event`` and what belongs to it (``Pruning.check``, and
        ``psnr_before`` an activation of the DoG).
        """
        if not self.order:
            self.order = self.rng.permutation(len(self.photographs)).tolist()
        view = self.order.pop()
        camera = self.cameras[view]
        self.optimizer.schedule(self.step_count + self.recipe.first_step)

        n = self.optimizer.n
        densifying = self.densification.collects(self.step_count)
        probe = [dr.zeros(mi.Float, n) for _ in range(2)] if densifying else None
        if probe:
            dr.enable_grad(probe)
        self.photographs.choose_background(self.rng)
        planes, frame = self._render(self.trained_params(), view, probe)
        l1, loss, gradient = self.photographs.compare(planes, view, self.step_count, self.order[: -1 - READ_AHEAD : -1])
        for plane, δ in zip(planes, gradient, strict=True):
            dr.set_grad(plane, mi.Float(δ))
        dr.enqueue(dr.ADMode.Backward, planes)
        dr.traverse(dr.ADMode.Backward)
        if self.memory and frame.lists:
            self.memory.pairs = max(self.memory.pairs, dr.width(frame.lists.splat_from_isect))
        if probe and frame.projection:
            gradients = dr.grad(probe[0]), dr.grad(probe[1])
            self.stats.add(*gradients, frame.projection, camera.width, camera.height)
        self.regularise(view, gradient)
        self.optimizer.step(unused=() if self.active_sh_degree else ("sh_rest",))
        if self.recipe.dog:
            degenerate(self.recipe.dog, self.optimizer)
        self.l1_sum += l1
        self.loss_sum += loss
        self.summed += 1
        dr.schedule(self.l1_sum, self.loss_sum)

        self.step_count += 1
        return self._compact(self._control_density())

    def _control_density(self) -> list[str]:
        """Drop what is broken and densify where that is due; returns what happened."""
        refines = self.densification.refines(self.step_count)
        prunes = self.pruning is not None and self.pruning.due(self.step_count)
        events = self._drop_broken() if refines or prunes or self.logs() else []
        if refines:
            rule, full = self.densification, ""
            if self.memory:
                rule, full = self.memory.bounded(rule, self.optimizer.n)
            counts = self.refine(rule)
            self.stats = DensifyStats(self.optimizer.n)
            if self.memory:
                self.memory.give_back(self.optimizer.n)
            if any(counts.values()):
                events.append("densify " + " ".join(f"{verb}={count}" for verb, count in counts.items()))
            if full and self.optimizer.n >= (rule.max_primitives or 0):
                events.append(full)
        if self.densification.resets_opacity(self.step_count):
            self.densification.reset_opacity(self.optimizer)
            events.append("reset opacity")
        degree = self.active_sh_degree
        if degree and self.step_count == degree * self.recipe.sh_every:
            events.append(f"sh degree {degree}")
        return events

    def refine(self, rule: Densification) -> dict[str, int]:
        """Densify; returns how many were cloned, split and removed."""
        return refine(rule, self.optimizer, self.stats, self.step_count, self.rng, self.extent)

    def logs(self) -> bool:
        """Whether there is a row with ``l1`` after this step, as before files are written."""
        return self.step_count % self.config.log_every == 0 or self.step_count == self.config.steps

    def _drop_broken(self) -> list[str]:
        try:
            kept, events = sieve(self.optimizer, self.extent, self.positions, self.config.near_zone)
        except FloatingPointError as error:
            raise FloatingPointError(f"step {self.step_count}: {error}") from None
        if events:
            self.stats.keep(kept)
        return events

    def _compact(self, events: list[str]) -> dict[str, Any]:
        """Prune and make DoG where that is due; returns the fields of ``step``, with ``events`` from before."""
        fields, dog = {}, self.recipe.dog
        if self.pruning and self.pruning.due(self.step_count):
            fields = self.pruning.check(self.step_count, self.optimizer, self.training_l1, self._scores)
            self.stats = DensifyStats(self.optimizer.n)
            events = [*events, fields["event"]]
        if dog and not self.dog_activated and self.step_count >= dog.start:
            self.dog_activated = True
            if self.dataset.test:
                start = time.perf_counter()
                if errors := self.test_errors():
                    fields |= {"psnr_before": errors["test_psnr"]}
                self.seconds -= time.perf_counter() - start
            events = [*events, f"dog activated {activate(dog, self.optimizer)} primitives"]
        return fields | {"event": "; ".join(events)} if events else {}

    def training_l1(self) -> float:
        """Mean L1 over all training views, images clamped to [0, 1]."""
        params = {name: dr.detach(value) for name, value in self.optimizer.params.items()}
        Float: Any = dr.detached_t(mi.Float)
        total = dr.opaque(Float, 0)
        self.photographs.color = None
        for view in range(len(self.photographs)):
            total += self.photographs.l1(self._render(params, view)[0], view)
            dr.eval(total)
        return float(total[0]) / len(self.photographs)

    def _scores(self) -> np.ndarray:
        """[N] importance of each primitive by the rule of the recipe."""
        assert self.recipe.score is not None  # a recipe that prunes has one
        seed = self.config.seed + self.step_count
        return self.recipe.score(self.optimizer.params, self.cameras, self.options, self.background, seed)

    def begin(self) -> dict[str, Any]:
        """What is due before the first step, as for a model that exists; returns fields of a row, as ``step`` does."""
        return self._compact(self._drop_broken())

    def take_losses(self) -> dict[str, float]:
        """``l1`` and ``loss``, means over the steps since they were taken before."""
        l1, loss = float(self.l1_sum[0]) / self.summed, float(self.loss_sum[0]) / self.summed
        self._forget_losses()
        return {"l1": l1, "loss": loss}

    def sound(self) -> bool:
        """Whether nothing has to leave, so that taking the ``state`` changes nothing. Waits for the device."""
        return not leaving(self.optimizer, self.extent, self.positions, self.config.near_zone).any()

    def state(self) -> dict[str, np.ndarray]:
        """Everything that ``restore`` needs to go on as if nothing had happened.

        Every value is finite: what is broken is dropped first, which after a row with ``l1`` is nothing.
        """
        self._drop_broken()
        return state_of(self)

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Take over a ``state()``. Raises ``ValueError`` or ``KeyError`` if it is of another kind of run.

        It may be that of another recipe at the end of its densification: what the state does not tell about
        pruning and DoG is still to come.
        """
        restore(self, state)

    def test_errors(self, with_flip: bool = False) -> dict[str, float]:
        """Means over the test views: ``test_psnr``, and ``test_flip``, which takes longer."""
        errors: dict[str, list[float]] = {"test_psnr": []}
        masks = self.photographs.mask_folder
        for view in self.dataset.test:
            mask = masks.of(view) if masks else None
            if mask is not None and not mask.any():
                continue
            image, truth = self.picture(view).color, over_background(view.image, self.background)
            errors["test_psnr"].append(psnr(image, truth, mask))
            if with_flip:
                errors.setdefault("test_flip", []).append(flip(image, truth, mask)[0])
        return {name: float(np.mean(values)) for name, values in errors.items() if values}

    def picture(self, view: View, depth: bool = False) -> Picture:
        """The current model seen from a view."""
        options = replace(self.options, depth=depth)
        return render_picture(self.optimizer.params, view.camera, options, self.background, self.config.near_clip)
