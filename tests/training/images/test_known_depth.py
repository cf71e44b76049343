"""The loss of depths: its value by the formula, its gradient by differences, and what it makes of a training."""

from dataclasses import replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.depths import Depths
from mi_dogsplat.engine.rasterize import Frame, rasterize
from mi_dogsplat.training import resolve
from mi_dogsplat.training.images.known_depth import (
    LEAST_DRAWN,
    WEIGHT,
    KnownDepths,
    depth_gradient,
    inverse_depth,
)
from mi_dogsplat.training.images.photographs import Photographs
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.train import Trainer
from photographs import PIXELS, config_of, left_half, write_masks

N = 24


def loss(depth: np.ndarray, T: np.ndarray, known: np.ndarray) -> float:
    """By the formula, in float64."""
    counts = (known > 0) & (1 - T > LEAST_DRAWN)
    return WEIGHT * float(np.sum(np.abs(depth / (1 - T) / np.where(counts, known, 1) - 1)[counts])) / len(known)


def planes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """D, T and known depths: some are unknown, and one pixel is empty."""
    rng = np.random.default_rng(0)
    T, z, known = rng.uniform(0, 0.9, N), rng.uniform(1, 4, N), rng.uniform(1, 4, N)
    known[::5], T[1] = 0, 1 - LEAST_DRAWN / 2
    return z * (1 - T), T, known


def test_the_gradient_is_that_of_the_formula():
    depth, T, known = planes()
    found = depth_gradient(mi.Float(depth), mi.Float(T), inverse_depth(known.reshape(4, 6), None))
    h = 1e-6
    for k, gradient in enumerate(found):
        expected = np.zeros(N)
        for pixel in range(N):
            moved = [np.array([depth, T]) for _ in range(2)]
            for sign, values in zip((1, -1), moved, strict=True):
                values[k, pixel] += sign * h
            over, under = (loss(values[0], values[1], known) for values in moved)
            expected[pixel] = (over - under) / (2 * h)
        assert np.count_nonzero(expected) == np.count_nonzero(known) - 1
        np.testing.assert_allclose(gradient.numpy(), expected, rtol=1e-4, atol=1e-9)


def test_a_depth_that_is_right_pulls_nowhere():
    found = depth_gradient(mi.Float([2.0, 1.0]), mi.Float([0.0, 0.5]), inverse_depth(np.full((1, 2), 2.0), None))
    assert not any(plane.numpy().any() for plane in found)


@pytest.fixture
def depths(data, tmp_path) -> str:
    """A folder with the depths of the model that the pictures show, along the view axis."""
    dataset = load_dataset(data)
    for view in dataset.views:
        depth = tiny_data.picture(tiny_data.truth(), view.camera).depth
        assert depth is not None
        np.save(tmp_path / f"{view.name}.npy", depth)
    return str(tmp_path)


def gradient_of_a_step(monkeypatch, trainer: Trainer) -> dict[str, np.ndarray]:
    """What the optimizer gets; nothing moves."""
    found: dict[str, np.ndarray] = {}

    def note(self: SplatOptimizer, unused=()) -> None:
        found.update({name: dr.grad(value).numpy().copy() for name, value in self.adam.items()})

    with monkeypatch.context() as patched:
        patched.setattr(SplatOptimizer, "step", note)
        trainer.step()
    return found


def test_a_step_adds_the_gradient_of_the_loss_by_the_parameters(data, depths, monkeypatch):
    """As Dr.Jit differentiates the formula, through depth and T of the rasterizer."""
    dataset = load_dataset(data)
    dataset.train = dataset.train[:1]
    monkeypatch.setattr(resolve, "with_depth_points", lambda config, dataset: dataset)  # where the maps are not yet met
    free, led = (gradient_of_a_step(monkeypatch, Trainer(config_of(depths=of), dataset)) for of in (None, depths))
    trainer, view = Trainer(config_of(), dataset), dataset.train[0]
    params = trainer.optimizer.params
    frame = rasterize(params, trainer.photographs.cameras[0], replace(trainer.options, depth=True))
    known = np.load(f"{depths}/{view.name}.npy").ravel()
    assert frame.depth is not None
    drawn = 1 - frame.T
    counts = mi.Float((known > 0).astype(np.float32)) * dr.select(drawn > LEAST_DRAWN, 1.0, 0.0)
    off = dr.abs(frame.depth / dr.maximum(drawn, LEAST_DRAWN) / mi.Float(np.where(known > 0, known, 1)) - 1)
    dr.backward(WEIGHT * dr.mean(counts * off))
    for name in ("means", "log_scales", "logit_opacities"):
        expected = dr.grad(trainer.optimizer.adam[name]).numpy()
        scale = np.abs(expected).max()
        assert scale > 0.1 * np.abs(free[name]).max()
        np.testing.assert_allclose(led[name] - free[name], expected, rtol=1e-3, atol=1e-3 * scale, err_msg=name)


@pytest.mark.parametrize("on_disk", [False, True])
def test_what_masks_hide_has_no_depth_and_small_views_have_small_maps(data, depths, tmp_path, on_disk):
    dataset, used = load_dataset(data, on_disk=on_disk), left_half()
    (tmp_path / "masks").mkdir()
    masks = str(write_masks(tmp_path / "masks", dataset, used))
    photographs = Photographs(dataset, 0.0, masks=masks, on_disk=on_disk)
    known = KnownDepths(Depths(depths, dataset), photographs)
    name = dataset.train[2].name
    for factor in (1, 2, 1):
        photographs.shrink(factor)
        frame = Frame([], mi.Float(np.full(PIXELS // factor**2, 0.5)), mi.Float(np.ones(PIXELS // factor**2)), None)
        planes, (by_depth, _) = known.gradient(frame, 2)
        truth = np.load(f"{depths}/{name}.npy")[factor // 2 :: factor, factor // 2 :: factor]
        counts = (truth > 0) & (used[::factor, ::factor] > 0)
        expected = np.where(counts, WEIGHT / truth.size / np.where(counts, truth, 1) / 0.5, 0)
        sign = np.sign(1 / 0.5 - truth)
        assert planes == [frame.depth, frame.T] and counts.any() and not counts.all()
        np.testing.assert_allclose(by_depth.numpy().reshape(truth.shape), sign * expected, rtol=1e-5)


def test_a_view_without_a_map_is_learned_from_its_colours(data, depths):
    dataset = load_dataset(data)
    name = dataset.train[1].name
    for view in dataset.views:
        if view.name != name:
            (Path(depths) / f"{view.name}.npy").unlink()
    known = KnownDepths(Depths(depths, dataset), Photographs(dataset, 0.0))
    frame = Frame([], mi.Float(np.zeros(PIXELS)), mi.Float(np.ones(PIXELS)), None)
    assert known.gradient(frame, 0) == ([], []) and len(known.gradient(frame, 1)[0]) == 2
