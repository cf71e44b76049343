"""Primitives that are lit less, against their colours in float64."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.dimmed import dimmed
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.scene.sh_basis import sh_basis
from mi_dogsplat.scene.splats import Splats
from own_axes_models import CURVED, SLOPED, Kind
from row_kinds import of_each
from splat_scenes import random_splats, rounded, to_linear, to_srgb


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
@pytest.mark.parametrize("mixed", [False, True], ids=["one degree", "degrees of their own"])
def test_dimming_multiplies_radiance_in_every_direction(linear, mixed):
    splats = rounded(random_splats(12, degree=3, seed=2))
    splats.sh_coeffs[:, 1:] *= 0.3
    factor = np.random.default_rng(3).uniform(0.05, 1, (12, 3)).astype(np.float32)
    if mixed:
        splats = splats.with_sh_degrees(np.arange(12) % 4)
    after = dimmed(upload(splats), [mi.Float(column) for column in factor.T], linear)
    d = np.random.default_rng(4).normal(size=(3, 50))
    x, y, z = d / np.linalg.norm(d, axis=0)
    basis = np.stack(np.broadcast_arrays(*sh_basis(x, y, z, 3)))  # [16, 50]

    def colors(of: Splats) -> np.ndarray:
        return np.maximum(np.einsum("nkc,kd->ndc", of.uniform_sh().sh_coeffs.astype(float), basis) + 0.5, 0)

    got = Splats(**{**vars(splats), **host(after, splats)})
    before, seen = colors(splats), colors(got)
    expected = before * factor[:, None] if linear else to_srgb(to_linear(before) * factor[:, None])
    dark = (expected < 0.0405) & (not linear)
    np.testing.assert_allclose(seen[~dark], expected[~dark], atol=2e-5)
    assert dark.mean() < 0.3 and (np.abs(seen - expected)[dark] < 0.0145).all()


def host(params: dict, like: Splats) -> dict[str, np.ndarray]:
    """Colours as a model has them, without the padding of rows."""
    found = {"sh_coeffs": params["sh_coeffs"].numpy().reshape(like.sh_coeffs.shape)}
    for degree in (1, 2, 3):
        name = f"sh{degree}_coeffs"
        if name in params:
            m, k, _ = (rows := getattr(like, name)).shape
            found[name] = params[name].numpy().reshape(m, -1, 3)[:, :k] if rows.size else rows
    return found


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
def test_all_of_the_light_leaves_the_bits_and_none_of_it_black(linear):
    splats = rounded(random_splats(12, degree=2, seed=2))
    params = upload(splats)
    same, black = (dimmed(params, [mi.Float(factor)] * 3, linear) for factor in (1, 0))
    np.testing.assert_array_equal(same["sh_coeffs"].numpy(), params["sh_coeffs"].numpy())
    coefficients = black["sh_coeffs"].numpy().reshape(12, -1, 3)
    assert (coefficients[:, 0] * sh_basis(0, 0, 1, 0)[0] + 0.5 <= 1e-6).all() and (coefficients[:, 1:] == 0).all()


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
@of_each(SLOPED, CURVED)
def test_what_varies_is_dimmed_all_over_its_primitive(kind: Kind, linear):
    """So slopes scale as colours do, and curvatures in grey light: ½ wᵀ Q w is linear in the numbers of a row."""
    splats = rounded(kind.drawn(0.5, 12, seed=2, degree=0))
    channels, reach = (3, 0.2) if kind is SLOPED else (1, 0.02)
    factor = np.random.default_rng(3).uniform(0.05, 1, (12, channels)).astype(np.float32)
    light = [mi.Float(column) for column in (factor * np.ones(3, np.float32)).T]
    after = dimmed(upload(splats), light, linear)
    w = np.random.default_rng(4).uniform(-reach, reach, (50, kind.group.row_size // channels))

    def colors(sh: np.ndarray, rows: np.ndarray) -> np.ndarray:
        base = sh.reshape(12, 3)[kind.index(splats)] * sh_basis(0, 0, 1, 0)[0] + 0.5
        return base[:, None] + np.einsum("pa,sac->spc", w, rows.reshape(-1, w.shape[1], channels))

    before = colors(splats.sh_coeffs.astype(float), kind.values(splats).astype(float))
    seen = colors(after["sh_coeffs"].numpy(), after[kind.name].numpy())
    k = factor[kind.index(splats)][:, None]
    expected = before * k if linear else to_srgb(to_linear(np.maximum(before, 0)) * k)
    bright = linear | ((expected > 0.0405) & (before > 0.0405))
    assert bright.mean() > 0.5
    np.testing.assert_allclose(seen[bright], expected[bright], atol=2e-5)


def test_coloured_light_dims_curvatures_as_it_dims_their_mean_over_channels():
    splats = rounded(random_splats(12, degree=0, seed=2, curvature_share=0.5))
    factor = np.random.default_rng(3).uniform(0.05, 1, (12, 3)).astype(np.float32)
    found = dimmed(upload(splats), [mi.Float(k) for k in factor.T], True)["brightness_curvatures"].numpy()
    expected = splats.brightness_curvatures * factor[splats.curvature_index].mean(1)[:, None]
    np.testing.assert_allclose(found.reshape(-1, 6), expected, rtol=1e-6)


def test_derivatives_go_to_the_colours_and_not_to_the_factor():
    params, factor = upload(rounded(random_splats(5, degree=1))), dr.linspace(mi.Float, 0.2, 1, 5)
    dr.enable_grad(params["sh_coeffs"], factor)
    dr.backward(dr.sum(dimmed(params, [factor] * 3, True)["sh_coeffs"]))
    expected = np.repeat(np.linspace(0.2, 1, 5), 12)
    np.testing.assert_allclose(dr.grad(params["sh_coeffs"]).numpy(), expected, rtol=1e-6)
    assert not dr.grad(factor).numpy().any()
