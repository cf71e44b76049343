"""From raw parameters to planes: images against the float64 twin, constant cost in kernels and memory."""

import gc
from dataclasses import replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, upload
from mi_dogsplat.engine.rasterize import LastFrame, RasterOptions, rasterize
from mi_dogsplat.scene.splats import Splats
from splat_scenes import (
    SMOOTH_OPTIONS,
    attached,
    image_of,
    kernels,
    make_camera,
    make_splats,
    options,
    plane_of,
    random_splats,
    rasterized,
    rounded,
    select,
    tilted_camera,
)

BACKGROUND = (0.1, 0.4, 0.8)


def mean_errors(splats: Splats, camera, antialiased=False, negative_transmittance=True) -> dict[str, float]:
    frame = rasterized(splats, camera, depth=True, antialiased=antialiased,
                       negative_transmittance=negative_transmittance)
    assert frame.depth is not None
    image, T, depth = reference.render(splats, camera, BACKGROUND, antialiased=antialiased,
                                       negative_transmittance=negative_transmittance)
    return {"image": float(np.abs(image_of(frame, camera, BACKGROUND) - image).mean()),
            "T": float(np.abs(plane_of(frame.T, camera) - T).mean()),
            "depth": float(np.abs(plane_of(frame.depth, camera) - depth).mean())}


def assert_same(*args, **others):
    errors = mean_errors(*args, **others)
    assert max(errors.values()) < 2e-5, errors


@pytest.mark.parametrize("width, height", [(1, 1), (1, 40), (37, 23), (64, 48), (130, 70)])
@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_images_of_any_size_equal_the_twin(width, height, dog_share):
    camera = tilted_camera(width, height, cx=0.4 * width, cy=0.7 * height)
    for seed in (0, 1):
        assert_same(rounded(random_splats(60, seed=seed, dog_share=dog_share)), camera)


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("negative_transmittance", [False, True])
def test_both_modes_of_negative_weights_and_of_antialiasing_equal_the_twin(antialiased, negative_transmittance):
    for seed in (2, 3, 4):
        splats = rounded(random_splats(60, seed=seed))
        assert_same(splats, tilted_camera(), antialiased=antialiased,
                    negative_transmittance=negative_transmittance)


@pytest.mark.parametrize("n", [0, 1, 2])
@pytest.mark.parametrize("dog", [False, True])
def test_no_one_and_two_primitives_equal_the_twin(n, dog):
    means = np.array([[0, 0, 2], [0.2, 0.1, 1.5]])[:n]
    splats = rounded(make_splats(means, 0.2, 0.7, (0.2, 0.5, 0.9), dog=range(n) if dog else ()))
    for camera in (make_camera(), make_camera(1, 1), tilted_camera(37, 23)):
        assert_same(splats, camera)


def test_one_splat_of_a_model_is_not_seen_as_a_scalar():
    """The one row of a DoG model's arrays, and of a plain model's, is a row."""
    splats = rounded(random_splats(20, seed=7)).select([int(random_splats(20, seed=7).dog_index[0])])
    assert splats.n_splats == splats.n_dog == 1
    assert_same(splats, tilted_camera())


def test_everything_behind_the_camera_gives_the_background():
    splats = random_splats(30)
    splats.means = splats.means * [1, 1, -1]
    frame = rasterized(rounded(splats), make_camera(), depth=True)
    assert frame.depth is not None
    np.testing.assert_allclose(image_of(frame, make_camera(), BACKGROUND),
                               np.broadcast_to(BACKGROUND, (48, 64, 3)), rtol=1e-6)
    assert (plane_of(frame.T, make_camera()) == 1).all() and not plane_of(frame.depth, make_camera()).any()


@pytest.mark.parametrize("name", [*RAW, *RAW_DOG])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_not_a_number_hides_its_primitive_and_spoils_no_other(name, value):
    splats, camera = rounded(random_splats(30, seed=9)), tilted_camera()
    i = int(splats.dog_index[0])
    without = reference.render(splats.select(np.arange(30) != i), camera)[0]
    getattr(splats, name)[0 if name.startswith("dog_") else i] = value
    image = image_of(rasterized(splats, camera), camera)
    if value == np.inf and "logit" in name:
        without = reference.render(splats, camera)[0]  # an opacity of exactly 1: nothing is broken
    if name.startswith("dog_"):  # what is left of it is its primary Gaussian, or nothing
        assert np.isfinite(image).all()
    else:
        assert np.abs(image - without).mean() < 2e-5


def test_a_lower_sh_degree_than_stored_equals_the_twin():
    splats, camera = rounded(random_splats(60, seed=5)), tilted_camera()
    for degree in (0, 1, 2):
        frame = rasterize(upload(splats), DeviceCamera.upload(camera), RasterOptions(sh_degree=degree))
        expected, _, _ = reference.render(splats, camera, sh_degree=degree)
        assert np.abs(image_of(frame, camera) - expected).mean() < 2e-5


def step(splats: Splats, camera, **others) -> dict:
    """Forward and backward pass; returns the gradients, evaluated."""
    params = attached(splats)
    frame = rasterize(params, DeviceCamera.upload(camera), options(splats, **others))
    dr.backward(dr.sum(frame.colors[0] + 2 * frame.colors[1] - frame.colors[2] + 0.1 * frame.T))
    gradients = {name: dr.grad(value) for name, value in params.items() if dr.grad_enabled(value)}
    dr.eval(gradients)
    return gradients


def test_a_higher_sh_degree_than_stored_is_refused():
    """It would read the coefficients of the next primitive, and behind the last one."""
    camera = DeviceCamera.upload(tilted_camera())
    params = upload(rounded(random_splats(5, degree=1)))
    with pytest.raises(ValueError, match="SH degree 2 needs 9 coefficients per channel, sh_coeffs has 4"):
        rasterize(params, camera, RasterOptions(sh_degree=2))


@pytest.mark.parametrize("cutoffs", [{}, SMOOTH_OPTIONS], ids=["hard", "smooth"])
@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_no_kernel_is_compiled_after_the_first_steps_whatever_the_number_of_primitives(cutoffs, dog_share):
    """But for N = 1 and M = 1, left out here: Dr.Jit turns the one row into a scalar, which is another kernel."""
    model = random_splats(1000, seed=1, dog_share=dog_share)
    known = kernels(lambda: [step(select(model, n), tilted_camera(), **cutoffs) for n in (100, 101)])
    assert known
    for n in (100, 137, 500, 3, 1000):
        new = kernels(lambda n=n: step(select(model, n), tilted_camera(), **cutoffs)) - known
        assert not new, f"N = {n}: {len(new)} new kernels"


def test_another_camera_needs_no_new_kernel():
    splats = rounded(random_splats(50, seed=1))
    known = kernels(lambda: [step(splats, tilted_camera(cx=cx)) for cx in (32, 30)])
    new = kernels(lambda: [step(splats, tilted_camera(f=f, cx=cx)) for f, cx in ((40, 3), (80, 70), (300, 32))])
    assert new <= known


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc to see the resident size")
def test_memory_does_not_grow_over_300_steps():
    """Neither what Dr.Jit holds at its peak nor the process; N changes, as in training."""
    model = random_splats(400, seed=1)
    resident, peaks = [], []
    for _ in range(16):
        dr.detail.malloc_clear_statistics()
        for n in (200, 300, 400, 250) * 5:
            step(select(model, n), tilted_camera())
        dr.sync_thread()
        gc.collect()
        peaks.append(dr.detail.malloc_watermark(dr.backend_v(mi.Float)))
        dr.flush_malloc_cache()
        resident.append(resident_bytes())
    assert max(peaks[-4:]) <= 1.02 * max(peaks[:4]), peaks
    growth = (min(resident[-4:]) - max(resident[:4])) / 2**20
    assert growth < 3, f"grew by {growth:.1f} MiB in 240 steps: {[r >> 20 for r in resident]} MiB"


def test_the_stages_of_a_pass_are_recalled_for_the_very_same_inputs_alone():
    params, camera = upload(rounded(random_splats(20, degree=0))), DeviceCamera.upload(tilted_camera())
    last, chosen = LastFrame(), RasterOptions(sh_degree=0)
    view = rasterize(params, camera, chosen, last=last).view

    def recalled(params=params, camera=camera, chosen=chosen) -> bool:
        return rasterize(params, camera, chosen, last=last, recall=True).view is view

    assert recalled() and recalled(camera=DeviceCamera.upload(tilted_camera()))
    assert not recalled(camera=DeviceCamera.upload(tilted_camera(cx=31.0)))
    assert not recalled(chosen=replace(chosen, isect_memory=1e9))
    assert not recalled(params=params | {"means": params["means"] * 2})
    rasterize(params, DeviceCamera.upload(tilted_camera(cx=31.0)), chosen, last=last)
    assert not recalled()
