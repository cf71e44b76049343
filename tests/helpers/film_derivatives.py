"""What ``mi.render`` says about the parameters of the shape ``splats`` of a scene: gradients, and a descent on them."""

from collections.abc import Iterable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from read_together import read_gradients


def film_gradients(scene: Any, names: Iterable[str], adjoint: np.ndarray) -> dict[str, np.ndarray]:
    """Of the sum of ``adjoint`` [H, W, 3] times the image, in the shapes of the parameters."""
    params: Any = mi.traverse(scene)
    names = tuple(names)
    for name in names:
        dr.enable_grad(params[f"splats.{name}"])
        params.set_dirty(f"splats.{name}")
    params.update()
    dr.backward(dr.sum(mi.render(scene, params) * mi.TensorXf(adjoint.astype(np.float32))))
    return read_gradients(params, names, "splats.")


def errors_of_adam(scene: Any, names: Iterable[str], target: Any, steps: int = 60, step_size: float = 0.02
                   ) -> list[float]:
    """Mean squared error to the image ``target`` at each step on these parameters."""
    params: Any = mi.traverse(scene)
    adam: Any = mi.ad.Adam(lr=step_size, params={f"splats.{name}": params[f"splats.{name}"] for name in names})
    params.update(adam)
    errors = []
    for _ in range(steps):
        loss = dr.mean(dr.square(mi.render(scene, params) - target), axis=None)
        dr.backward(loss)
        adam.step()
        params.update(adam)
        errors.append(float(dr.detach(loss).array[0]))
    return errors
