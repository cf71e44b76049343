"""What a camera does to rendered colours: the kernels against float64, and float64 against finite differences."""

from typing import Any

import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.reference import image_formation as reference
from mi_dogsplat.scene.appearance import N_NUMBERS, photographed, radii_squared
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.training.images.image_formation import N_SUMS, PIXELS, ImageSize, formed, formed_gradients

SIZE = 13, 7  # no multiple of PIXELS
CAMERA = Camera(np.eye(4), 10.0, 10.0, 6.0, 3.0, *SIZE)


def example(seed: int):
    """(image with values below 0 and above 1 too, adjoint, numbers)."""
    rng = np.random.default_rng(seed)
    image, adjoint = rng.uniform(-0.1, 1.2, (7, 13, 3)), rng.normal(size=(7, 13, 3))
    return image, adjoint, rng.normal(size=N_NUMBERS) * np.repeat([0.7, 0.3], [3, 2])


def planes_of(image: np.ndarray) -> list:
    kind: Any = array_types().Float
    return [kind(np.ascontiguousarray(image[..., c], np.float32).ravel()) for c in range(3)]


def image_of(planes: list) -> np.ndarray:
    return np.stack([plane.numpy() for plane in planes], -1).reshape(7, 13, 3)


@pytest.mark.parametrize("seed", range(3))
def test_the_kernels_are_the_chain_in_float64_and_its_gradient(seed):
    image, adjoint, numbers = example(seed)
    assert image.shape[0] * image.shape[1] % PIXELS
    r_sq, frame, on_device = radii_squared(CAMERA), ImageSize.of(*SIZE), array_types().Float(numbers.astype(np.float32))
    got = image_of(formed(planes_of(image), on_device, frame))
    np.testing.assert_allclose(got, reference.formed(image, r_sq, numbers), atol=1e-5, rtol=1e-5)
    by_planes, rows = formed_gradients(planes_of(image), on_device, frame, planes_of(adjoint))
    by_image, by_numbers = reference.formed_gradients(image, r_sq, numbers, adjoint)
    np.testing.assert_allclose(image_of(by_planes), by_image, rtol=1e-3, atol=1e-4)
    sums = rows.numpy().reshape(N_SUMS, -1).sum(1)
    np.testing.assert_allclose(sums[:N_NUMBERS], by_numbers, rtol=1e-3, atol=1e-4)
    by_ones = reference.formed_gradients(image, r_sq, numbers, np.ones_like(image))[1]
    assert sums[N_NUMBERS] == pytest.approx(by_ones[:3].sum(), rel=1e-4)


def test_sizes_take_turns():
    """A recording of one size must not be replayed for another."""
    numbers = array_types().Float(np.full(N_NUMBERS, 0.1, np.float32))
    for size in ((13, 7), (5, 4), (13, 7), (40, 30)):
        image = np.random.default_rng(0).uniform(size=(size[1], size[0], 3))
        camera = Camera(np.eye(4), 10.0, 10.0, 2.0, 2.0, *size)
        frame, planes = ImageSize.of(*size), planes_of(image)
        by_planes, rows = formed_gradients(planes, numbers, frame, planes)
        by_image, by_numbers = reference.formed_gradients(image, radii_squared(camera), np.full(N_NUMBERS, 0.1), image)
        got = np.stack([plane.numpy() for plane in by_planes], -1).reshape(image.shape)
        np.testing.assert_allclose(got, by_image, rtol=1e-3, atol=1e-4)
        np.testing.assert_allclose(rows.numpy().reshape(N_SUMS, -1).sum(1)[:N_NUMBERS], by_numbers, rtol=1e-3)
        assert [len(plane) for plane in formed(planes, numbers, frame)] == 3 * [size[0] * size[1]]


def test_pictures_on_the_host_are_the_chain_too():
    image, _, numbers = example(0)
    r_sq = radii_squared(CAMERA)
    np.testing.assert_allclose(photographed(image, r_sq, numbers), reference.formed(image, r_sq, numbers), atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_gradients_in_float64_are_those_of_finite_differences(seed):
    image, adjoint, numbers = example(seed)
    r_sq = radii_squared(CAMERA)
    by_image, by_numbers = reference.formed_gradients(image, r_sq, numbers, adjoint)

    def loss(image, numbers):
        return (adjoint * reference.formed(image, r_sq, numbers)).sum()

    step, differences = 1e-6, np.zeros(N_NUMBERS)
    for k in range(N_NUMBERS):
        bump = step * np.eye(N_NUMBERS)[k]
        differences[k] = (loss(image, numbers + bump) - loss(image, numbers - bump)) / (2 * step)
    np.testing.assert_allclose(by_numbers, differences, rtol=1e-3, atol=1e-3)
    for index in [(0, 0, 0), (3, 6, 1), (6, 12, 2), (2, 9, 0)]:
        bump = np.zeros_like(image)
        bump[index] = step
        difference = (loss(image + bump, numbers) - loss(image - bump, numbers)) / (2 * step)
        assert by_image[index] == pytest.approx(difference, rel=1e-4)


def test_zeros_are_the_identity():
    image, *_ = example(0)
    np.testing.assert_allclose(reference.formed(image, radii_squared(CAMERA), np.zeros(N_NUMBERS)), image, atol=1e-6)


def test_an_exposure_of_one_ev_doubles_the_light_and_vignetting_is_of_the_corner():
    grey = np.full((7, 13, 3), 0.4)
    numbers = np.zeros(N_NUMBERS)
    numbers[:3] = 1
    doubled = reference.formed(grey, radii_squared(CAMERA), numbers)
    assert reference.decoded(doubled) == pytest.approx(2 * reference.decoded(grey))
    vignetted = reference.formed(grey, np.ones((7, 13)), -np.eye(N_NUMBERS)[3])
    assert reference.decoded(vignetted) == pytest.approx(0.5 * reference.decoded(grey))
