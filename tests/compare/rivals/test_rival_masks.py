"""Learned masks of MaskGaussian and LP-3DGS: their derivatives against brute force in float64, and when they act."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.rivals import mask_gaussian
from mi_dogsplat.compare.rivals.lp_3dgs import masked_logits
from mi_dogsplat.compare.rivals.mask_gaussian import ABSENT, by_share
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import rasterize
from splat_scenes import SMOOTH_OPTIONS, options, random_splats, rounded, tilted_camera


def masked_images(splats, camera, shares: np.ndarray, background: float, smooth: bool = False) -> np.ndarray:
    """C = Σ c m α T + T b, T <- T (1 - m α) for masks [N], [H, W, 3]; walks do not end."""
    projection = reference.project(splats, camera)
    x, y = reference.pixel_centres(0, 0, camera.width, camera.height)
    image, T = np.zeros((len(x), 3)), np.ones(len(x))
    for i in reference.depth_order(projection):
        alpha = np.minimum(0.99, reference.kernels(projection, i, x, y)[0])
        alpha = np.where((alpha < 1 / 255) & (not smooth), 0, alpha) * shares[i]
        image += (alpha * T)[:, None] * projection.colors[i]
        T = T * (1 - alpha)
    return (image + background * T[:, None]).reshape(camera.height, camera.width, 3)


@pytest.mark.parametrize("background", [0.0, 1.0])
def test_maskgaussian_has_the_derivative_of_a_loss_by_every_mask_drawn_or_not(background):
    splats, camera = rounded(random_splats(15, seed=7, degree=0, dog_share=0)), tilted_camera(45, 37)
    rng = np.random.default_rng(2)
    drawn, adjoint = (rng.uniform(size=15) < 0.5) * 1.0, rng.normal(size=(37, 45, 3))
    assert 4 < drawn.sum() < 11
    expected = np.zeros(15)
    for i in range(15):  # affine in each m: the difference of 1 and 0 is the derivative
        with_it, without = (np.where(np.arange(15) == i, value, drawn) for value in (1.0, 0.0))
        difference = masked_images(splats, camera, with_it, background) - masked_images(
            splats, camera, without, background
        )
        expected[i] = np.sum(adjoint * difference)
    params, on_device = upload(splats), DeviceCamera.upload(camera)
    seen = params | {"logit_opacities": dr.select(mi.Float(drawn) > 0, params["logit_opacities"], ABSENT)}
    frame = rasterize(seen, on_device, options(splats))
    image = [dr.detach(plane + background * frame.T, preserve_type=False) for plane in frame.colors]
    np.testing.assert_allclose(
        np.stack([plane.numpy() for plane in image], -1).reshape(37, 45, 3),
        masked_images(splats, camera, drawn, background),
        atol=1e-4,
    )
    Float: Any = dr.detached_t(mi.Float)
    planes = [Float(np.ascontiguousarray(adjoint[..., c].ravel(), np.float32)) for c in range(3)]
    got = by_share(params, on_device, options(splats), Float(drawn), image, planes).numpy()
    assert np.abs(expected[drawn == 0]).max() > 0.1  # those that are not drawn learn as well
    np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-3)


def test_lp_3dgs_masks_multiply_opacities_and_so_alphas():
    splats, camera = rounded(random_splats(15, seed=7, degree=0, dog_share=0)), tilted_camera(45, 37)
    splats.logit_opacities[:] = np.minimum(splats.logit_opacities, 3)  # below the limit of .99
    mask = np.random.default_rng(2).uniform(0.3, 1, 15)
    params = upload(splats)
    logits = masked_logits(params["logit_opacities"], mi.Float(np.log(mask / (1 - mask))))
    expected = mask / (1 + np.exp(-splats.logit_opacities.astype(np.float64)))
    np.testing.assert_allclose(1 / (1 + np.exp(-logits.numpy().astype(np.float64))), expected, rtol=1e-5)
    frame = rasterize(
        params | {"logit_opacities": logits}, DeviceCamera.upload(camera), options(splats, **SMOOTH_OPTIONS)
    )
    got = np.stack([plane.numpy() for plane in frame.colors], -1).reshape(37, 45, 3)
    np.testing.assert_allclose(got, masked_images(splats, camera, mask, 0.0, smooth=True), atol=1e-4)


def test_lp_3dgs_masks_have_finite_gradients_at_opacities_that_float32_rounds_to_0_and_1():
    logits, mask_logits = (mi.Float([-60.0, -5.0, 0.0, 5.0, 60.0]) for _ in range(2))
    dr.enable_grad(logits, mask_logits)
    result = masked_logits(logits, mask_logits)
    dr.backward(dr.sum(result))
    sigmoid = 1 / (1 + np.exp(-np.array([-60.0, -5.0, 0.0, 5.0, 60.0])))
    # d logit(s²)/da for two equal factors s: (1 - s) / (1 - s²) = 1 / (1 + s)
    np.testing.assert_allclose(dr.grad(logits).numpy(), 1 / (1 + sigmoid), rtol=1e-5)
    np.testing.assert_allclose(dr.grad(mask_logits).numpy(), 1 / (1 + sigmoid), rtol=1e-5)


def test_masks_are_there_from_the_first_step_and_sweep_at_every_refinement(trainer_of):
    recipe = METHODS["mask_gaussian"].recipe
    assert METHODS["mask_gaussian"].whole and not METHODS["mask_gaussian"].from_the_start
    trainer = trainer_of(recipe, 3000, target=20)
    trainer.step()
    logits = trainer.optimizer.numpy(mask_gaussian.MASK)
    step = 10 * mask_gaussian.RATE  # a tenth of the recipe's steps
    np.testing.assert_allclose(np.abs(logits - (10 - 1)), step, rtol=1e-3)
    part = next(s for s in trainer.strategies if s.name == "maskgaussian")
    # refinements of a tenth of the recipe's steps are 48 apart, the sweeps after them 100
    sweeps = {96: True, 100: False, 1488: True, 1500: True, 1550: False, 1600: True, 2500: True}
    for step, swept in sweeps.items():
        trainer.step_count = step
        trainer.optimizer.assign(mask_gaussian.MASK, np.where(np.arange(trainer.optimizer.n) < 1, -60.0, 9.0))
        assert bool(part.after_step(trainer, None)) == swept, step
