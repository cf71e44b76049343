"""What integrators make of primitives with slopes, curvatures, cuts and shifts: pictures, derivatives and masks."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from film_derivatives import errors_of_adam, film_gradients
from mi_dogsplat import Splats, reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, upload
from mi_dogsplat.plugin import splat_integrator
from mi_dogsplat.plugin.camera_masks import SplatMasks
from own_axes_models import (
    ADJOINT,
    AND_SHIFTS,
    CAMERA,
    CURVED,
    KINDS,
    PLANE_KINDS,
    SHIFTED,
    SLOPED,
    Kind,
    picture,
    traversed,
)
from row_kinds import of_each
from splat_scenes import assert_gradients_equal, image_of, options, rasterized, scene_of, to_linear

ALL = *KINDS, SHIFTED
EACH_KIND_AND_ALL = pytest.mark.parametrize(
    "kinds", [*((kind,) for kind in ALL), ALL], ids=[*(kind.word for kind in ALL), "all on one primitive"]
)


def names_of(kinds: Sequence[Kind]) -> list[str]:
    return [name for kind in kinds for name in kind.group.names]


def having(kinds: Sequence[Kind], n=12, seed=1) -> Splats:
    """A random model of which each second primitive has all of these."""
    splats = kinds[0].random(n, seed)
    for kind in kinds[1:]:
        splats = kind.having(splats)
    return splats


@AND_SHIFTS
def test_pictures_are_those_of_the_engine(kind: Kind):
    assert np.isin(kind.model.dog_index, kind.index(kind.model)).any()
    ours = picture(kind.model, srgb_primitives=False)
    np.testing.assert_allclose(ours, image_of(rasterized(kind.model, CAMERA), CAMERA), atol=1e-5)
    assert np.abs(ours - picture(kind.without(kind.model), srgb_primitives=False)).max() > 0.05


@AND_SHIFTS
def test_dogpath_shows_them_to_the_camera_as_dogsplat_does(kind: Kind):
    np.testing.assert_array_equal(picture(kind.model, type="dogpath"), picture(kind.model))


@EACH_KIND_AND_ALL
def test_gradients_through_the_film_equal_differences(monkeypatch, kinds: Sequence[Kind]):
    """Without cutoffs: no alpha appears at once where a parameter moves."""
    monkeypatch.setattr(splat_integrator, "RasterOptions", partial(RasterOptions, cutoffs=SMOOTH))
    of_kinds = dict.fromkeys(names_of(kinds), 1e-2)
    names = {**of_kinds, "sh_coeffs": 1e-2, "means": 1e-3, "log_scales": 1e-3, "quats": 1e-3}
    model = having(kinds)
    gradients = film_gradients(scene_of(model, CAMERA), names, ADJOINT)
    rng = np.random.default_rng(1)
    along = {name: rng.choice([-1.0, 1.0], gradient.shape) for name, gradient in gradients.items()}

    def loss(name: str, distance: float) -> float:
        changed = Splats(**vars(model))
        setattr(changed, name, (getattr(model, name) + distance * along[name]).astype(np.float32))
        return float((picture(changed).astype(float) * ADJOINT).sum())

    for name, step in names.items():
        expected = (loss(name, step) - loss(name, -step)) / (2 * step)
        scale = float(np.abs(gradients[name]).max())
        assert scale > 0.01
        assert (gradients[name] * along[name]).sum() == pytest.approx(expected, abs=0.01 * scale, rel=0.01), name

    scene, params = traversed(model)
    for name in names:
        dr.enable_grad(params[f"splats.{name}"])
        dr.set_grad(params[f"splats.{name}"], mi.TensorXf(along[name].astype(np.float32)))
    params.update()
    change = scene.integrator().render_forward(scene, params).numpy()
    expected = sum((gradients[name] * along[name]).sum() for name in names)
    assert (change * ADJOINT).sum() == pytest.approx(expected, rel=2e-3)


@EACH_KIND_AND_ALL
def test_gradients_with_cutoffs_equal_differences_in_float64(kinds: Sequence[Kind]):
    splats, adjoint = having(kinds, 10, seed=4), ADJOINT.astype(np.float32)
    got = film_gradients(scene_of(splats, CAMERA), (*RAW, *RAW_DOG, *names_of(kinds)), ADJOINT)
    image, step = reference.render(splats, CAMERA)[0], 1e-6
    curve = (to_linear(image + step) - to_linear(image - step)) / (2 * step)
    assert_gradients_equal(got, reference.loss_gradients(splats, CAMERA, adjoint * curve, smooth=False, eps=1e-7))


@AND_SHIFTS
def test_adam_finds_them(kind: Kind):
    """From zeros, as training starts.

    That is no saddle for cuts either: at n = 0 the derivative of log g by n is w / (1 + e⁴), weak, but of opposite
    signs on the two sides of a primitive. Normals are longer than slopes, so Adam takes longer steps to them.
    """
    target = mi.render(scene_of(kind.model, CAMERA))
    start = replace(kind.model, **{kind.name: 0 * kind.values(kind.model)})
    errors = errors_of_adam(scene_of(start, CAMERA), [kind.name], target, step_size=kind.step)
    assert errors[-1] < 0.1 * errors[0]


@of_each(SLOPED, CURVED)
@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
def test_holdouts_are_black_and_cover_as_much_as_those_of_one_colour(kind: Kind, linear):
    model = kind.model
    params, camera, seen = upload(model), DeviceCamera.upload(CAMERA), options(model)
    holdout = np.arange(12) % 3 == 0
    masks = SplatMasks(mi.Bool(np.zeros(12, bool)), mi.Bool(holdout), True)
    shown = masks.shown(params, linear)
    values = shown[kind.name].numpy().reshape(-1, *kind.shape)
    of_holdouts = holdout[kind.index(model)]
    assert of_holdouts.any() and not values[of_holdouts].any()
    np.testing.assert_array_equal(values[~of_holdouts], kind.values(model)[~of_holdouts])
    without = masks.shown(upload(kind.without(model)), linear)
    np.testing.assert_array_equal(masks.hole(shown, camera, seen, None), masks.hole(without, camera, seen, None))


@of_each(*PLANE_KINDS, SHIFTED)
def test_holdouts_that_are_cut_off_or_seen_elsewhere_cover_what_pictures_show(kind: Kind):
    model, camera = kind.model, DeviceCamera.upload(CAMERA)
    everything = mi.Bool(np.ones(12, bool))
    masks = SplatMasks(mi.Bool(np.zeros(12, bool)), everything, True)
    hole, of_whole = (masks.hole(masks.shown(upload(splats), True), camera, options(splats), None).numpy()
                      for splats in (model, kind.without(model)))
    np.testing.assert_allclose(hole, 1 - rasterized(model, CAMERA).T.numpy(), atol=1e-5)
    assert np.abs(hole - of_whole).max() > 0.05
