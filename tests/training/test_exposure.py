"""Exposure and white balance of single photographs: maps, their gradients, their steps, what they take up."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.training import exposure as exposure_module
from mi_dogsplat.training.exposure import Exposure
from photographs import SHAPE, changed, image_of, planes_of, trained


def test_the_identity_changes_nothing_and_a_map_is_applied_as_a_matrix():
    image = np.random.default_rng(0).uniform(size=(*SHAPE, 3)).astype(np.float32)
    exposure = Exposure(2, 100)
    assert np.array_equal(image_of(exposure.applied(planes_of(image), 1)), image)
    matrix = np.random.default_rng(1).normal(size=(2, 3, 4)).astype(np.float32)
    matrix[0] = 2 * np.eye(3, 4) - matrix[1]  # their mean is the identity
    exposure.restore(exposure.state() | {"values": matrix.reshape(2, 12)})
    expected = image @ matrix[1, :, :3].T + matrix[1, :, 3]
    assert image_of(exposure.applied(planes_of(image), 1)) == pytest.approx(expected, abs=1e-5)


def test_gradients_through_a_map_are_those_of_finite_differences(monkeypatch):
    """Of the loss Σ weight · exposed, in float64: linear, so that differences are exact."""
    rng = np.random.default_rng(0)
    image, weight = rng.uniform(size=(2, *SHAPE, 3))
    matrix = rng.normal(size=(2, 3, 4))
    matrix[1] = 2 * np.eye(3, 4) - matrix[0]
    exposure = Exposure(2, 100)
    exposure.restore({"values": matrix.reshape(2, 12).astype(np.float32), "t": np.zeros(2)})
    taken = []
    monkeypatch.setattr(Exposure, "_adam", lambda self, view, gradient, step: taken.append(gradient.numpy()))
    through = image_of(exposure.backward(planes_of(image.astype(np.float32)), planes_of(weight), 0, 0))

    def loss(image, matrix):
        return float((weight * (image @ matrix[0, :, :3].T + matrix[0, :, 3])).sum())

    for k in range(12):
        bumped = matrix.copy()
        bumped[0].reshape(12)[k] += 1e-3
        assert taken[0][k] == pytest.approx((loss(image, bumped) - loss(image, matrix)) / 1e-3, rel=1e-4)
    for index in [(0, 0, 0), (5, 7, 1), (30, 40, 2)]:
        bumped = image.copy()
        bumped[index] += 1e-3
        assert through[index] == pytest.approx((loss(bumped, matrix) - loss(image, matrix)) / 1e-3, rel=1e-4)


def test_the_step_of_a_map_is_adams_with_a_pull_to_the_identity_and_other_views_rest():
    """Oracle: Kingma and Ba 2015, Alg. 1, with the rate of the 3DGS release; Loshchilov and Hutter 2019, Alg. 2."""
    rng = np.random.default_rng(0)
    exposure, expected, m, v = Exposure(2, 100), np.eye(3, 4).ravel(), np.zeros(12), np.zeros(12)
    Float: Any = dr.detached_t(mi.Float)
    for t in range(1, 6):
        g = rng.normal(size=12)
        exposure._adam(1, Float(g.astype(np.float32)), step=10 * t)
        m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g
        rate = 0.01 * 0.1 ** (10 * t / 100)
        from_mean = (expected - np.eye(3, 4).ravel()) / 2  # of two maps, one of which is the identity
        expected -= rate * ((m / (1 - 0.9**t)) / (np.sqrt(v / (1 - 0.999**t)) + 1e-15) + 20 * from_mean)
    values = exposure.state()["values"]
    assert values[1] == pytest.approx(expected, rel=1e-4) and np.array_equal(values[0], np.eye(3, 4).ravel())


def test_the_mean_of_the_maps_is_the_identity_whatever_adam_does_and_after_a_restore():
    rng, exposure = np.random.default_rng(0), Exposure(5, 100)
    Float: Any = dr.detached_t(mi.Float)
    for step in range(60):
        exposure._adam(step % 5, Float(rng.normal(1, 1, 12).astype(np.float32)), step)
    again = Exposure(5, 100)
    again.restore(exposure.state())
    for maps in (exposure.numpy(), again.numpy()):
        assert maps.mean(axis=0) == pytest.approx(np.eye(3, 4), abs=1e-5)
        assert np.abs(maps - np.eye(3, 4)).max() > 1e-3
    assert exposure.state()["values"].mean(axis=0)[0] < 0.97  # which X alone are not


def test_exposure_takes_up_what_cameras_did_to_single_images(data, monkeypatch):
    monkeypatch.setattr(exposure_module, "RATE", 0.02)
    gains = np.linspace(0.6, 1.4, 8)
    shifted = changed(load_dataset(data), lambda k, image: np.clip(gains[k] * image, 0, 1))
    without, with_maps = (trained(shifted, steps=300, exposure=on, seed=1) for on in (False, True))
    assert with_maps.training_l1() < 0.8 * without.training_l1()
    maps = with_maps.photographs.exposure
    assert maps is not None
    brightness = maps.numpy()[:, range(3), range(3)].mean(axis=1)
    assert np.corrcoef(brightness, gains[: len(brightness)])[0, 1] > 0.9
