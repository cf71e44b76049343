"""Sums over footprint images against brute force: whole footprint images in float64, matrices of Fourier transforms."""

from typing import Any

import numpy as np
import pytest
from every_pair import every_pair
from mi_dogsplat import reference
from mi_dogsplat.engine.arrays import detached
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import SMOOTH, Cutoffs
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import device_array, upload
from mi_dogsplat.engine.view import prepare_both
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.engine.walks.score import Sums, composite_score
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from splat_scenes import make_camera, make_splats, random_splats, rounded, tilted_camera

WHITE, BLACK, COLORED = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.2, 0.7, 0.4)
SHARES = {"plain": (0,), "DoG": (0.5,), "slopes": (0.5, 0.5), "cuts": (0, 0, 0.5), "second cuts": (0, 0, 0, 0.5),
          "all of them": (0.5, 0.5, 0.5, 0.5)}  # fmt: skip
"""Of DoG primitives, and of those with slopes, cuts and second cuts."""
EVERYTHING = Sums(gradient=True, probes=2)
SIZES = [(45, 37), (32, 16), (1, 1), (1, 33), (17, 2)]


def engine(
    splats: Splats,
    camera: Camera,
    sums: Sums,
    background=BLACK,
    planes=(),
    cutoffs=Cutoffs(),
    negative_transmittance=True,
    antialiased=False,
) -> np.ndarray:
    """[N, columns] of a view; planes are [H, W]."""
    options = RasterOptions(
        splats.sh_degree, antialiased, negative_transmittance=negative_transmittance, cutoffs=cutoffs
    )
    pictured, view = prepare_both(upload(splats), DeviceCamera.upload(camera), options, sums.blocks)
    blended = composite(pictured)
    image = [plane + blended.T * level for plane, level in zip(blended.features, background, strict=True)]
    columns = composite_score(view, sums, image, [detached(device_array(plane)) for plane in planes])
    return np.stack([column.numpy() for column in columns], 1)


def noise(camera: Camera, count: int) -> np.ndarray:
    return np.random.default_rng(5).normal(size=(count, camera.height, camera.width))


def assert_equal(got: np.ndarray, expected: np.ndarray, scale: Any = None, rtol=1e-3):
    """Relative to ``scale`` (default: the expected values themselves); what has no footprint is exactly 0."""
    scale = np.abs(expected) if scale is None else scale
    assert scale.max() > 1e-4
    assert not got[scale == 0].any()
    error = np.abs(got - expected) / np.where(scale > 0, scale, 1)
    assert error.max() < rtol, f"primitive {error.argmax()}: {got[error.argmax()]} for {expected[error.argmax()]}"


def assert_as_brute_force(splats: Splats, camera: Camera, background=BLACK, **options):
    planes = noise(camera, 2)
    got = engine(splats, camera, EVERYTHING, background, planes, **options)
    J = reference_score.footprints(splats, camera, background, **options)  # [N, H, W]
    assert_equal(got[:, 0], (J**2).sum((1, 2)))
    assert_equal(got[:, 1], reference_score.gradient_energy(J), scale=(J**2).sum((1, 2)))
    for k in range(2):
        assert_equal(got[:, 2 + k], (planes[k] * J).sum((1, 2)), scale=np.abs(planes[k] * J).sum((1, 2)))


# Footprints J


@pytest.mark.parametrize(
    ("shares", "background"), [*((each, COLORED) for each in SHARES), ("all of them", BLACK), ("all of them", WHITE)]
)
def test_sums_over_footprints_equal_brute_force(shares, background):
    assert_as_brute_force(rounded(random_splats(50, 1, 1, *SHARES[shares])), tilted_camera(45, 37), background)


@pytest.mark.parametrize("width, height", SIZES)
def test_sums_over_images_of_any_size_equal_brute_force(width, height):
    camera = tilted_camera(width, height, cx=0.4 * width, cy=0.7 * height)
    assert_as_brute_force(rounded(random_splats(40, seed=2, degree=0)), camera, COLORED)


@pytest.mark.parametrize("options", [{"antialiased": True}, {"negative_transmittance": False}])
def test_sums_of_the_other_modes_equal_brute_force(options):
    splats = rounded(random_splats(50, seed=3, degree=0, dog_share=0.7))
    assert_as_brute_force(splats, tilted_camera(45, 37), COLORED, **options)


@pytest.mark.parametrize("dog", [(), (0,)])
def test_a_single_primitive_is_enough(dog):
    splats = rounded(make_splats([0.1, 0, 2], 0.3, 0.7, (0.3, 0.6, 0.9), dog=dog))
    assert_as_brute_force(splats, make_camera(40, 30), WHITE)


def test_opaque_layers_end_the_footprints_of_what_is_hidden():
    rng, n = np.random.default_rng(0), 30
    means = np.column_stack([rng.uniform(-0.2, 0.2, (n, 2)), np.linspace(1.5, 4, n)])
    splats = rounded(make_splats(means, 0.3, 0.97, rng.uniform(size=(n, 3))))
    assert_as_brute_force(splats, make_camera(40, 30), WHITE)
    got = engine(splats, make_camera(40, 30), Sums())[:, 0]
    assert got[-1] < 1e-2 * got[0]


def test_a_kernel_above_99_percent_keeps_its_derivative():
    """One flat primitive that covers the image, in front of white: J is its opacity times the change of the sum."""
    splats = rounded(make_splats([0, 0, 2], 1e4, 0.9999, (0.25, 0.5, 0.75)))
    got = engine(splats, make_camera(20, 10), Sums(), WHITE)
    np.testing.assert_allclose(got, 200 * (0.9999 * (1.5 - 3)) ** 2, rtol=1e-4)


def test_the_weight_of_a_pixel_is_squared():
    splats, camera = rounded(random_splats(50, seed=4, degree=0)), tilted_camera(45, 37)
    weight = np.random.default_rng(1).uniform(0, 2, (37, 45))
    J = reference_score.footprints(splats, camera, WHITE)
    assert_equal(engine(splats, camera, Sums(weighted=True), WHITE, [weight])[:, 0], ((weight * J) ** 2).sum((1, 2)))


def test_what_is_outside_or_too_faint_counts_nothing():
    splats = rounded(
        make_splats(
            [[0, 0, -2], [0, 0, 2], [50, 0, 2], [0, 0, 3], [0, 0, 2.5]], 0.2, [0.5, 0.9 / 255, 0.5, 0.5, 0.5], dog=[4]
        )
    )
    splats.means[3] = np.nan
    got = engine(splats, make_camera(), EVERYTHING, WHITE, noise(make_camera(), 2))
    assert got[4].all() and not got[:4].any()


# Removal: D


@every_pair(
    varying=[(), (0.6,), (0, 0.6), (0, 0.6, 0.6)], background=[BLACK, COLORED], negative_transmittance=[True, False]
)
def test_sums_over_removals_equal_real_removals_without_cutoffs(varying, background, negative_transmittance):
    """Without cutoffs no walk ends: the change of the image is exact. ``varying``: shares with slopes, cuts, second."""
    splats, camera = rounded(random_splats(30, 6, 1, 0.5, *varying)), tilted_camera(30, 22)
    planes = noise(camera, 3)
    got = engine(
        splats, camera, Sums(removal=True, gradient=True, probes=1), background, planes, SMOOTH, negative_transmittance
    )
    D = reference_score.removals(
        splats, camera, background, smooth=True, negative_transmittance=negative_transmittance
    )  # [N, H, W, 3]
    D = np.moveaxis(D, -1, 1)
    for column, expected in zip(
        got.T,
        ((D**2).sum((1, 2, 3)), reference_score.gradient_energy(D).sum(1), (planes * D).sum((1, 2, 3))),
        strict=True,
    ):
        # a difference of two images is zero where it is below their last bit
        assert_equal(column, expected, scale=np.maximum(np.abs(expected), 1e-6 * np.abs(expected).max()))


@pytest.mark.parametrize("width, height", SIZES)
def test_sums_over_removals_equal_real_removals(width, height):
    """Few enough primitives that no walk ends early."""
    camera = tilted_camera(width, height, cx=0.4 * width, cy=0.7 * height)
    splats = rounded(random_splats(15, seed=7, degree=0))
    D = reference_score.removals(splats, camera, WHITE)
    got = engine(splats, camera, Sums(removal=True, gradient=True), WHITE)
    assert_equal(got[:, 0], (D**2).sum((1, 2, 3)))
    assert_equal(got[:, 1], reference_score.gradient_energy(np.moveaxis(D, -1, 1)).sum(1), scale=(D**2).sum((1, 2, 3)))


# Differences between neighbours, across blocks and tiles


def test_the_energy_of_differences_is_that_of_pixels_inside_the_image():
    F = np.random.default_rng(0).normal(size=(3, 7, 10))
    inside = (np.diff(F, axis=1) ** 2).sum((1, 2)) + (np.diff(F, axis=2) ** 2).sum((1, 2))
    np.testing.assert_allclose(reference_score.gradient_energy(F), inside, rtol=1e-12)


@pytest.mark.parametrize("removal", [False, True])
def test_a_speck_anywhere_around_the_border_of_a_tile_has_its_whole_gradient(removal):
    """Among others where it reaches only the first column or row of the next tile; behind it, a wall."""
    camera, px = make_camera(34, 34, f=34.0), np.linspace(13.6, 18.4, 6)
    for y in px:  # a row at a time, so that not all hide each other
        specks = np.stack([(px - 17) / 17, 0 * px + (y - 17) / 18.7, 0 * px + 2], -1)
        splats = make_splats(
            np.vstack([specks, [[0, 0, 5]]]), [[1e-4]] * 6 + [[50]], 0.3, [[0.9, 0.1, 0.4]] * 6 + [[0.2, 0.5, 0.3]]
        )
        assert_whole_gradient(rounded(splats), camera, removal)


def test_pixels_of_the_next_block_count_when_all_own_pixels_have_ended():
    """A stripe of 100 layers, opaque in the columns 0 to 3 and below 1/255 in column 4; behind it, a wall."""
    z = 2 + np.arange(100) * 1e-4
    stripe = np.stack([0 * z - 4 / 12 * z, 0 * z, z], -1)  # centred on the border of the columns 1 and 2
    width = np.sqrt(0.7**2 - reference.LOW_PASS) * 2 / 12
    scales = [[width, 50, 1e-4]] * 100 + [[50, 50, 1e-4]]
    colors = [[0.9, 0.1, 0.4]] * 100 + [[0.2, 0.5, 0.3]]
    splats, camera = (
        rounded(make_splats(np.vstack([stripe, [[0, 0, 5]]]), scales, 0.9, colors)),
        make_camera(12, 6, 12.0),
    )
    wall = reference_score.footprints(splats, camera, WHITE)[-1]
    assert not wall[:, :4].any() and wall[:, 4].all()
    assert_whole_gradient(splats, camera, removal=False)


def assert_whole_gradient(splats: Splats, camera: Camera, removal: bool):
    got = engine(splats, camera, Sums(removal, gradient=True), WHITE)
    if removal:
        F = np.moveaxis(reference_score.removals(splats, camera, WHITE), -1, 1)
    else:
        F = reference_score.footprints(splats, camera, WHITE)[:, None]
    # rounding of what lies behind: 1e-7 of the image (walks/score.py), which for squares is 2e-7 |F|
    scale = (F**2 + 2e-7 / 1e-3 * np.abs(F)).sum((1, 2, 3))
    assert_equal(got[:, 1], reference_score.gradient_energy(F).sum(1), scale=scale)
