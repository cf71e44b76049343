"""Adam on a few random primitives, with random gradients."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
from launches import KernelWatch
from mi_dogsplat.scene.row_groups import BESIDE_DOG
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer

RATES = LearningRates(extent=2.0, total_steps=1000)


def random_model(
    n: int, degree: int = 1, dog_index=(), seed: int = 0, rows: Mapping[str, Sequence[int]] | None = None
) -> Splats:
    """``rows``: who has slopes, by ``slope_index``, curvatures, cuts, second ones and shifts."""
    rng, m = np.random.default_rng(seed), len(dog_index)
    model = Splats(
        rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.normal(size=(n, 4)), rng.normal(size=n),
        rng.normal(size=(n, (degree + 1) ** 2, 3)),
        np.array(dog_index, np.uint32), rng.normal(size=m), rng.normal(size=(m, 3)),
    )  # fmt: skip
    arrays: dict[str, np.ndarray] = {}
    for group in BESIDE_DOG:
        arrays[group.index] = index = np.array((rows or {}).get(group.index, ()), np.uint32)
        arrays |= {name: rng.normal(size=(len(index), *shape)) for name, shape in group.arrays.items()}
    return replace(model, **arrays)


def translucent_model(n: int) -> Splats:
    """Plain and smaller, of SH degree 0."""
    rng = np.random.default_rng(n)
    return Splats(
        rng.normal(size=(n, 3)), rng.normal(size=(n, 3)) - 2, rng.normal(size=(n, 4)), rng.normal(size=n),
        rng.normal(size=(n, 1, 3)),
    )  # fmt: skip


def set_gradients(optimizer: SplatOptimizer, rng: np.random.Generator) -> dict[str, np.ndarray]:
    gradients = {}
    for name, value in optimizer.adam.items():
        gradients[name] = rng.normal(size=dr.width(value)).astype(np.float32)
        dr.set_grad(value, mi.Float(gradients[name]))
    return gradients


def run(optimizer: SplatOptimizer, steps: int, seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    for step in range(steps):
        optimizer.schedule(step)
        set_gradients(optimizer, rng)
        optimizer.step()


def alike(optimizer: SplatOptimizer, first: int) -> None:
    """Three steps with one gradient for all numbers."""
    for step in range(first, first + 3):
        optimizer.schedule(step)
        for value in optimizer.adam.values():
            dr.set_grad(value, dr.opaque(mi.Float, 0.1, dr.width(value)))
        optimizer.step()


def assert_nothing_is_compiled(round_of: Callable[[int, int], None]) -> None:
    """``round_of`` n primitives and a first step launches no kernel but those of its first call."""
    with KernelWatch() as kernels:
        round_of(40, 0)
        kernels.forget()
        for n, first in ((60, 10), (33, 200), (75, 900), (74, 1200)):
            round_of(n, first)
    assert kernels.launched > 20
    assert not kernels.new


def moments(optimizer: SplatOptimizer, name: str) -> tuple[np.ndarray, np.ndarray]:
    """First and second moment, [rows, row size]."""
    state = optimizer.state()
    m, v = (state[f"{name}.{key}"].reshape(-1, optimizer.row_size[name]) for key in "mv")
    return m, v


def assert_same(a: Splats, b: Splats):
    for name in a.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def state_from_file(optimizer: SplatOptimizer, folder: Path) -> dict[str, np.ndarray]:
    """Its state, as a checkpoint gives it back."""
    np.savez(folder / "state.npz", **optimizer.state())  # pyright: ignore[reportArgumentType]
    with np.load(folder / "state.npz") as saved:
        return dict(saved)


def assert_same_state(a: SplatOptimizer, b: SplatOptimizer):
    """Every bit, moments and numbers of steps too."""
    first, second = a.state(), b.state()
    assert first.keys() == second.keys()
    for name, value in first.items():
        np.testing.assert_array_equal(value, second[name], err_msg=name)
    assert_same(a.to_splats(), b.to_splats())
