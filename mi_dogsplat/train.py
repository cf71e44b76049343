"""Training: photographs in, primitives out (the 3DGS recipe, Kerbl et al. 2023, Sec. 5).

A ``Trainer`` holds the state; ``step()`` does one and returns nothing that waits for the device; ``rows()``
runs to the end and yields the rows of ``history.jsonl``. Who prints, draws or writes files is somebody else
(``run.py``).
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .config import TrainConfig
from .datasets import Dataset
from .datasets.dataset import View, camera_extent
from .densify import Densification, DensifyStats, refine
from .initialize import random_splats, splats_from_points
from .loss import PhotometricLoss
from .optimizer import LearningRates, SplatOptimizer
from .project import DeviceCamera
from .rasterize import RasterOptions, rasterize
from .render import Picture, render_picture
from .splats import Splats

SH_EVERY = 1000  # steps of the 30,000-step schedule between raises of the SH degree


def background_color(background: str, has_alpha: bool) -> float:
    """Grey level behind the splats, 0 or 1, for ``TrainConfig.background``."""
    return {"black": 0.0, "white": 1.0, "auto": 1.0 if has_alpha else 0.0}[background]


def over_background(image: np.ndarray, background: float) -> np.ndarray:
    """[H, W, 3] of an image with or without premultiplied alpha."""
    return image if image.shape[-1] == 3 else image[..., :3] + (1 - image[..., 3:]) * background


def initial_splats(config: TrainConfig, dataset: Dataset) -> Splats:
    """From the points of the data set, else random in the region that the cameras see."""
    if len(dataset.points):
        splats = splats_from_points(dataset.points, dataset.point_colors, config.sh_degree)
        limit = config.max_primitives
        if limit is not None and splats.n_splats > limit:
            keep = np.random.default_rng(config.seed).permutation(splats.n_splats)[:limit]
            splats = splats.select(np.sort(keep))
        return splats
    count = min(config.initial_primitives, config.max_primitives or config.initial_primitives)
    rng = np.random.default_rng(config.seed)
    return random_splats([view.camera for view in dataset.train], count, rng, config.sh_degree)


class Trainer:
    """State of a run: parameters, optimizer moments, densification statistics, the order of views."""

    def __init__(self, config: TrainConfig, dataset: Dataset):
        self.config, self.dataset = config, dataset
        self.background = background_color(config.background, dataset.has_alpha)
        self.extent = camera_extent(dataset.train)
        self.rng = np.random.default_rng(config.seed)
        self.loss = PhotometricLoss()
        self.cameras = [DeviceCamera.upload(v.camera, config.near_clip) for v in dataset.train]
        self.targets = [self.loss.target(over_background(v.image, self.background)) for v in dataset.train]
        self.optimizer = SplatOptimizer(
            initial_splats(config, dataset), LearningRates(extent=self.extent, total_steps=config.steps)
        )
        self.densification = Densification(
            max_primitives=config.max_primitives, max_world_scale=config.max_world_scale
        ).scaled(config.steps)
        self.stats = DensifyStats(self.optimizer.n)
        self.step_count = 0
        self.seconds = 0.0
        self.order: list[int] = []
        self._forget_losses()

    def _forget_losses(self):
        Float: Any = dr.detached_t(mi.Float)
        self.l1_sum, self.loss_sum, self.summed = dr.opaque(Float, 0), dr.opaque(Float, 0), 0

    @property
    def active_sh_degree(self) -> int:
        """0 at the start, one more every 1000 steps of the full schedule."""
        return min(self.config.sh_degree, self.step_count // self.config.milestone(SH_EVERY))

    @property
    def options(self) -> RasterOptions:
        return RasterOptions(sh_degree=self.active_sh_degree, antialiased=self.config.antialiased)

    def step(self) -> str | None:
        """One training view: render, loss, backward, Adam, density control. Returns an event, or None."""
        if not self.order:
            self.order = self.rng.permutation(len(self.targets)).tolist()
        view = self.order.pop()
        camera = self.cameras[view]
        self.optimizer.schedule(self.step_count)

        n = self.optimizer.n
        densifying = self.densification.collects(self.step_count)
        probe = [dr.zeros(mi.Float, n) for _ in range(2)] if densifying else None
        if probe:
            dr.enable_grad(probe)
        frame = rasterize(self.optimizer.params, camera, self.options, probe)
        planes = frame.colors
        if self.background:
            planes = [dr.fma(frame.T, self.background, c) for c in planes]
        l1, _, loss, gradient = self.loss.value_and_gradient(planes, self.targets[view])
        for plane, δ in zip(planes, gradient, strict=True):
            dr.set_grad(plane, mi.Float(δ))
        dr.enqueue(dr.ADMode.Backward, planes)
        dr.traverse(dr.ADMode.Backward)
        if probe and frame.projection:
            gradients = dr.grad(probe[0]), dr.grad(probe[1])
            self.stats.add(*gradients, frame.projection, camera.width, camera.height)
        self.optimizer.step()
        self.l1_sum += l1
        self.loss_sum += loss
        self.summed += 1
        dr.schedule(self.l1_sum, self.loss_sum)

        self.step_count += 1
        return self._control_density()

    def _control_density(self) -> str | None:
        events = []
        if self.densification.refines(self.step_count):
            counts = refine(
                self.densification, self.optimizer, self.stats, self.step_count, self.rng, self.extent
            )
            self.stats = DensifyStats(self.optimizer.n)
            if any(counts.values()):
                events.append("densify " + " ".join(f"{verb}={count}" for verb, count in counts.items()))
        if self.densification.resets_opacity(self.step_count):
            self.densification.reset_opacity(self.optimizer)
            events.append("reset opacity")
        degree = self.active_sh_degree
        if degree and self.step_count == degree * self.config.milestone(SH_EVERY):
            events.append(f"sh degree {degree}")
        return "; ".join(events) or None

    def rows(self) -> Iterator[dict]:
        """Run to the end; yields rows of the history. ``seconds`` leaves out measurements on test views."""
        config = self.config
        test_every = (config.test_every or max(1, config.steps // 8)) if self.dataset.test else 0
        tick = time.perf_counter()
        while self.step_count < config.steps:
            event = self.step()
            last = self.step_count == config.steps
            log = self.step_count % config.log_every == 0 or last
            test = test_every > 0 and self.step_count % test_every == 0
            if not (event or log or test):
                continue
            row: dict = {"step": self.step_count}
            if log:
                l1, loss = float(self.l1_sum[0]) / self.summed, float(self.loss_sum[0]) / self.summed
                self._forget_losses()
                row |= {"l1": l1, "loss": loss}
            dr.sync_thread()
            now = time.perf_counter()
            self.seconds += now - tick
            row |= {"seconds": self.seconds, "n": self.optimizer.n, "n_dog": self.optimizer.n_dog}
            if event:
                row["event"] = event
            if test:
                row["test_psnr"] = float(np.mean([self._psnr(view) for view in self.dataset.test]))
            tick = time.perf_counter()
            yield row

    def state(self) -> dict[str, np.ndarray]:
        """Everything that ``restore`` needs to go on as if nothing had happened; take it after a row with ``l1``."""
        state = {f"optimizer.{name}": value for name, value in self.optimizer.state().items()}
        state |= {f"stats.{name}": value for name, value in self.stats.state().items()}
        rng = np.array(json.dumps(self.rng.bit_generator.state))
        progress = {"step": np.array(self.step_count), "seconds": np.array(self.seconds)}
        return state | progress | {"order": np.array(self.order, np.int64), "rng": rng}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Take over a ``state()``. Raises ``ValueError`` or ``KeyError`` if it is of another kind of run."""

        def part(prefix: str) -> dict[str, np.ndarray]:
            return {name[len(prefix) :]: value for name, value in state.items() if name.startswith(prefix)}

        self.optimizer.restore(part("optimizer."))
        self.stats = DensifyStats(self.optimizer.n)
        self.stats.restore(part("stats."))
        self.step_count, self.seconds = int(state["step"]), float(state["seconds"])
        self.order = state["order"].tolist()
        self.rng.bit_generator.state = json.loads(str(state["rng"]))
        self._forget_losses()

    def _psnr(self, view: View) -> float:
        error = self.picture(view).color - over_background(view.image, self.background)
        return float(-10 * np.log10(np.mean(np.square(error)) + 1e-12))

    def picture(self, view: View, depth: bool = False) -> Picture:
        """The current model seen from a view."""
        options = replace(self.options, depth=depth)
        return render_picture(
            self.optimizer.params, view.camera, options, self.background, self.config.near_clip
        )
