"""A trainer's passes over one of its views, for whoever times or counts them."""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.arrays import backward
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.training.train import Trainer


def passes(trainer: Trainer) -> dict[str, Callable[[], None]]:
    """Forward, forward and backward pass of a rasterisation, and a whole training step."""
    camera, options = trainer.photographs.cameras[0], trainer.options
    rng = np.random.default_rng(0)
    adjoint = [mi.Float(rng.normal(size=camera.width * camera.height).astype(np.float32)) for _ in range(3)]
    dr.make_opaque(adjoint)

    def forward() -> None:
        params = {name: dr.detach(value) for name, value in trainer.optimizer.params.items()}
        dr.eval(rasterize(params, camera, options).colors)

    def both() -> None:
        params = trainer.optimizer.params
        backward(rasterize(params, camera, options).colors, adjoint)
        dr.eval([dr.grad(value) for value in params.values()])
        for value in params.values():
            dr.clear_grad(value)

    def step() -> None:
        trainer.step()
        dr.eval(trainer.optimizer.params)

    return {"forward": forward, "forward + backward": both, "training step": step}
