"""Second-order steps against Adam: one model, the same views and loss, error against run time.

``ours`` is trained up to a step of its refinement. From there it goes on with Adam, as it would have, or with
Levenberg-Marquardt (as in 3DGS-LM, Höllein et al. 2025). A step of the latter takes a batch of views and solves

    (G + λ D) δ = -g,    G = Σ_views Jᵀ W J,    D = diag G

by conjugate gradients, preconditioned by D. J is the derivative of the pictures by the raw parameters
(``curvature.py``), g the gradient of the training loss. W is the curvature of the parabola that touches the L1 part of
the loss at the residual r from above, 0.8 / (|r| + .01) per number of a picture (iteratively reweighted least squares).
The step is halved until the loss of the batch falls. After a whole step λ is halved, after another it is doubled.

    python -m benchmarks second_order DATA [--downscale K] [--max-primitives N] [--views 32 223] [--seconds S]

PSNR is that of validation views; the time that they take is left out. The state is kept in ``--out``, for calls with
the same data and the same steps.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.engine.parameters import device_array
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.picture import photograph, render_picture, seen_as
from mi_dogsplat.runs.checkpoint import load_checkpoint, save_checkpoint
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer

from ..numerics.curvature import Jacobian
from .kept import same_settings

L1_WEIGHT = 0.8  # of the training loss
RESIDUAL = 0.01  # below which W grows no more: 2.5 levels of 255
PROBES = 2  # pictures of random signs per view, for D
FLOOR = 0.1  # of D, in medians of its kind: what hardly any view sees would go far
SMALLEST = 1 / 32  # part of a step
EVERY = 500  # steps of Adam between measurements


class Clock:
    """Prints seconds since it was made and what is measured; what measuring takes is left out."""

    def __init__(self, name: str, measure: Callable[[], float | None]):
        self.name, self.measure, self.begin = name, measure, time.perf_counter()

    @property
    def seconds(self) -> float:
        return time.perf_counter() - self.begin

    def report(self, more: str = "") -> None:
        dr.sync_thread()
        now = time.perf_counter()
        print(f"{self.name:14s} {now - self.begin:7.1f} s  {self.measure():.3f} dB  {more}", flush=True)
        self.begin += time.perf_counter() - now


class Problem:
    """The training loss of a model, its gradient and its curvature, by all raw parameters as one flat vector."""

    def __init__(self, trainer: Trainer, dataset: Dataset):
        self.photographs, self.dataset, self.options = trainer.photographs, dataset, trainer.options
        self.near_clip, self.background = trainer.near_clip, trainer.background
        self.jacobian = Jacobian(trainer.model(), [], self.options, self.background)
        self.jacobian.cameras = self.photographs.cameras
        self.size = sum(self.jacobian.sizes)

    def move(self, step: np.ndarray) -> None:
        """Add a vector to the parameters."""
        jacobian = self.jacobian
        for name, part in zip(jacobian.names, np.split(step, np.cumsum(jacobian.sizes)[:-1]), strict=True):
            jacobian.params[name] = dr.detach(jacobian.params[name]) + device_array(part)
        dr.eval(jacobian.params)

    def loss(self, views: Sequence[int]) -> float:
        """Mean over views."""
        losses = [self.photographs.compare(self.jacobian.picture(view), view, 0)[1] for view in views]
        return float(np.mean([float(loss[0]) for loss in losses]))

    def linearised(self, views: Sequence[int]) -> tuple[float, np.ndarray, list[list[Any]]]:
        """Loss, its gradient, and W of each view."""
        total, gradient, weights = 0.0, np.zeros(self.size), []
        for view in views:
            planes = self.jacobian.picture(view)
            _, loss, adjoint = self.photographs.compare(planes, view, 0)
            gradient += self.jacobian.backward(view, adjoint)
            total += float(loss[0])
            truth = photograph(self.dataset.train[view], self.background).reshape(-1, 3)
            residuals = [p - device_array(np.ascontiguousarray(y)) for p, y in zip(planes, truth.T, strict=True)]
            weights.append([L1_WEIGHT / truth.size / (dr.abs(r) + RESIDUAL) for r in residuals])
            dr.eval(weights[-1])
        return total / len(views), gradient / len(views), weights

    def product(self, views: Sequence[int], weights: list[list[Any]], vector: np.ndarray) -> np.ndarray:
        """G v."""
        found = np.zeros(self.size)
        for view, W in zip(views, weights, strict=True):
            planes = self.jacobian.forward(view, vector)
            found += self.jacobian.backward(view, [w * plane for w, plane in zip(W, planes, strict=True)])
        return found / len(views)

    def diagonal(self, views: Sequence[int], weights: list[list[Any]], rng: np.random.Generator) -> np.ndarray:
        """D, estimated by random signs; see ``FLOOR``."""
        found = np.zeros(self.size)
        for view, W in zip(views, weights, strict=True):
            for _ in range(PROBES):
                signs = 2.0 * rng.integers(0, 2, (3, dr.width(W[0]))) - 1
                adjoint = [dr.sqrt(w) * device_array(row) for w, row in zip(W, signs, strict=True)]
                found += self.jacobian.backward(view, adjoint) ** 2
        for at in self.jacobian.kinds.values():
            found[at] = np.maximum(found[at], FLOOR * np.median(found[at]))
        return found / (PROBES * len(views))

    def validation_psnr(self) -> float:
        found, drawn = [], DrawnAs(near_clip=self.near_clip)
        for view in self.dataset.test:
            picture = render_picture(self.jacobian.params, view.camera, self.options, self.background, drawn)
            found.append(psnr(seen_as(picture, view), photograph(view, self.background)))
        return float(np.mean(found))


def conjugate_gradients(
    product: Callable[[np.ndarray], np.ndarray], rhs: np.ndarray, preconditioner: np.ndarray, steps: int
) -> np.ndarray:
    """What solves a positive definite system, after that many steps from zero."""
    x, r = np.zeros_like(rhs), rhs.copy()
    z = r / preconditioner
    p, rz = z.copy(), float(r @ z)
    for _ in range(steps):
        q = product(p)
        curvature = float(p @ q)
        if curvature <= 0:  # the products are float32
            break
        x += rz / curvature * p
        r -= rz / curvature * q
        z = r / preconditioner
        rz, before = float(r @ z), rz
        p = z + rz / before * p
    return x


def levenberg_marquardt(
    problem: Problem, batch: int, cg_steps: int, damping: float, seconds: float, clock: Clock
) -> None:
    """Steps for that many seconds, in batches of views at random; λ begins with ``damping``."""
    rng, order, λ = np.random.default_rng(0), [], damping
    while clock.seconds < seconds:
        if len(order) < batch:
            order = rng.permutation(len(problem.photographs)).tolist()
        views, order = order[:batch], order[batch:]
        loss, gradient, weights = problem.linearised(views)
        D = problem.diagonal(views, weights, rng)

        def damped(v: np.ndarray, views=views, weights=weights, D=D, λ=λ) -> np.ndarray:
            return problem.product(views, weights, v) + λ * D * v

        step, share = conjugate_gradients(damped, -gradient, (1 + λ) * D, cg_steps), 1.0
        problem.move(step)
        while (after := problem.loss(views)) >= loss and share > SMALLEST:
            problem.move(-share / 2 * step)
            share /= 2
        clock.report(f"loss of the batch {loss:.5f} to {after:.5f}, {share:g} of a step, λ {λ:g}")
        λ = λ / 2 if share == 1 else λ * 2


def adam(trainer: Trainer, steps: int) -> None:
    """To the end of the run."""
    clock = Clock("adam", trainer.test_psnr)
    while trainer.step_count < steps:
        trainer.step()
        if trainer.step_count % EVERY == 0:
            clock.report(f"step {trainer.step_count}")


def main(flags: list[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks second_order", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("data")
    parser.add_argument("--downscale", type=int, default=4)
    parser.add_argument("--max-primitives", type=int, default=25_000)
    parser.add_argument("--steps", type=int, default=7000, help="of the run (default: 7000)")
    parser.add_argument("--start", type=int, default=5000, help="step that all go on from (default: 5000)")
    parser.add_argument("--views", type=int, nargs="+", default=[32, 223], help="of a batch")
    parser.add_argument("--cg-steps", type=int, default=8, help="of conjugate gradients (default: 8)")
    parser.add_argument("--damping", type=float, default=1.0, help="λ of the first step (default: 1)")
    parser.add_argument("--seconds", type=float, default=300, help="of each batch size (default: 300)")
    parser.add_argument("--out", type=Path, default=Path("second_order"))
    args = parser.parse_args(flags)
    set_variant("llvm_ad_rgb")
    config = TrainConfig(
        args.data, "ours", args.steps, downscale=args.downscale, max_primitives=args.max_primitives,
        max_world_scale=float("inf"),
    )  # fmt: skip
    dataset = load_dataset(args.data, args.downscale, split="validation")
    same_settings(args.out, args, "data", ("downscale", "max_primitives", "steps", "start"))
    kept = args.out / "state.npz"
    if not kept.exists():
        trainer = Trainer(config, dataset)
        trainer.begin()
        while trainer.step_count < args.start:
            trainer.step()
        save_checkpoint(kept, trainer.state())

    def restored() -> Trainer:
        trainer = Trainer(config, dataset)
        trainer.restore(load_checkpoint(kept))
        return trainer

    trainer = restored()
    print(f"{trainer.optimizer.n} primitives, {trainer.test_psnr():.3f} dB", flush=True)
    adam(trainer, args.steps)
    for batch in args.views:
        problem = Problem(restored(), dataset)
        clock = Clock(f"lm {batch} views", problem.validation_psnr)
        levenberg_marquardt(problem, batch, args.cg_steps, args.damping, args.seconds, clock)
