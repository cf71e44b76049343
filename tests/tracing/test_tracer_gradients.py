"""Derivatives of what rays gather, against finite differences of the float64 twin."""

from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np
import pytest
from every_pair import every_pair
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.parameters import RAW, RAW_OF_GROUPS
from mi_dogsplat.reference import rays as twin
from mi_dogsplat.reference.forward import raw_indices
from mi_dogsplat.reference.rays import RayMeetings
from mi_dogsplat.scene.row_groups import CURVATURES, SLOPES
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.tracing.options import TraceOptions
from mi_dogsplat.tracing.rays import FEW
from mi_dogsplat.tracing.tracer import SplatTracer
from ray_sets import RaySet, random_rays
from read_together import read_gradients
from splat_scenes import attached, random_splats, rounded

STEP = 1e-5
Choices = list[tuple[str, dict[str, bool]]]  # what is asked of rays, and with which options
NAMES = RAW + RAW_OF_GROUPS
COLORS = "sh_coeffs", *SLOPES.names, *CURVATURES.names
SHARES = {"colours of one value": (0, 0, 0, 0), "slopes": (0.6, 0, 0, 0), "curvatures": (0, 0, 0, 0.6),
          "slopes and curvatures": (0.6, 0, 0, 0.6), "cut off": (0, 0.6, 0, 0),
          "slopes, and cut off": (0.6, 0.6, 0, 0), "curvatures, and cut off": (0, 0.6, 0, 0.6),
          "cut off by the second plane": (0, 0, 0.6, 0), "shifts": (0, 0, 0, 0, 0.6),
          "all of it": (0.6, 0.8, 0.6, 0.6), "all of it, and shifts": (0.6, 0.8, 0.6, 0.6, 0.6)}  # fmt: skip
"""Of primitives with slopes, of those that each plane cuts off, of those with curvatures, and with shifts."""
pytestmark = pytest.mark.usefixtures("all_cores")  # adjoints of many rays meet in one place


def model(shares: str) -> Splats:
    splats = rounded(random_splats(9, 21, 1, 0.5, *SHARES[shares]))
    twice = np.intersect1d(splats.cut_index, splats.second_cut_index)
    assert (len(twice) > 1 and np.isin(twice, splats.dog_index).any()) == shares.startswith("all of it")
    both = np.intersect1d(splats.slope_index, splats.curvature_index)
    assert (1 < len(both) < splats.is_varied.sum()) == shares.startswith(("slopes and curvatures", "all of it"))
    return splats


@pytest.fixture(scope="module", params=SHARES)
def splats(request) -> Splats:
    return model(request.param)


@pytest.fixture(scope="module")
def rays() -> RaySet:
    return random_rays(60, seed=22)


def adjoints(n: int) -> np.ndarray:
    """[4, P] of the colours and of the transmittance."""
    return np.random.default_rng(23).normal(size=(4, n)).astype(np.float32)


def twin_loss(meetings: RayMeetings, kind: str, **options) -> float:
    δ = adjoints(len(meetings.alphas))
    if kind == "transmittance":
        return float((δ[3] * twin.transmittance(meetings, smooth=True, **options)).sum())
    colors, T = twin.gather(meetings, smooth=True, **options)
    return float((δ[:3] * colors.T).sum() + (δ[3] * T).sum())


def in_float64(splats: Any) -> tuple[dict[str, np.ndarray], Any]:
    """(raw parameters that there are, the model that has these arrays)"""
    raw = {name: np.array(getattr(splats, name), np.float64) for name in NAMES if getattr(splats, name).size}
    return raw, SimpleNamespace(**raw, **raw_indices(splats))


def differences(splats: Any, rays: RaySet, choices: Choices) -> dict[str, np.ndarray]:
    """Central ones of the losses of all choices, [choices, ...], by every entry of the raw parameters.

    What rays meet takes most of the time, and is the same for all choices.
    """
    raw, changed = in_float64(splats)
    result = {}
    for name, values in raw.items():
        result[name] = np.zeros((len(choices), *values.shape))
        for index in np.ndindex(values.shape):
            kept, losses = values[index], []
            for sign in (1, -1):
                values[index] = kept + sign * STEP
                meetings = rays.meet(changed, smooth=True)
                losses.append(np.array([twin_loss(meetings, kind, **options) for kind, options in choices]))
            values[index] = kept
            result[name][(slice(None), *index)] = (losses[0] - losses[1]) / (2 * STEP)
    return result


def loss(params: dict, degree: int, rays: RaySet, kind: str, **options) -> Any:
    """The same of the tracer, attached to the AD graph."""
    δ = adjoints(len(rays.maxt))
    tracer = SplatTracer(params, TraceOptions(degree, **options))
    if kind == "transmittance":
        return dr.sum(tracer.transmittance(rays.ray) * δ[3])
    colors, T = tracer.gather(rays.ray)
    return dr.sum(sum(c * d for c, d in zip(colors, δ[:3], strict=True)) + T * δ[3])


def assert_those_of_the_twin(splats: Splats, rays: RaySet, choices: Choices) -> None:
    """Of gradients by every parameter, to 2e-3 of the largest."""
    expected = differences(splats, rays, choices)
    wrong = []
    for k, (kind, options) in enumerate(choices):
        params = attached(splats)
        dr.backward(loss(params, splats.sh_degree, rays, kind, cutoffs=SMOOTH, **options))
        found_by_name = read_gradients(params, expected)
        for name, of_choices in expected.items():
            values = of_choices[k]
            found = found_by_name[name].reshape(values.shape)
            error = np.abs(found - values).max() / max(np.abs(values).max(), 1e-3)
            wrong += [f"{kind}, {options}, {name}: {error:.1e}"] if error > 2e-3 else []
            assert kind == "transmittance" and name in COLORS or np.abs(values).max() > 1e-3, name
    assert not wrong, wrong


@pytest.mark.parametrize("shares", SHARES)
def test_gradients_are_those_of_the_twin(shares, rays):
    """Of every kind of primitives, and of both ways to blend with and without negative transmittance."""
    turned = shares == "slopes"
    ways = {"transmittance": not turned, "gather": turned}
    choices = [(kind, {"negative_transmittance": negative}) for kind, negative in ways.items()]
    assert_those_of_the_twin(model(shares), rays, choices)


@pytest.mark.parametrize("shares", ["colours of one value", "slopes, and cut off", "curvatures", "shifts", "all of it"])
def test_gradients_of_thin_discs_are_those_of_the_twin(shares, rays):
    splats = model(shares)
    splats.log_scales[:, 1] = np.log(1e-4)
    assert_those_of_the_twin(splats, rays, [("transmittance", {}), ("gather", {})])


@every_pair(shares=SHARES, n=[60, FEW + 10], kind=["transmittance", "gather"])
def test_forward_mode_is_the_transpose_of_reverse_mode(shares, kind, n):
    splats = model(shares)
    rays = random_rays(n, seed=24)
    params = attached(splats)
    dr.backward(loss(params, splats.sh_degree, rays, kind))
    rng, inner = np.random.default_rng(25), 0.0
    names = [name for name in NAMES if name in params]
    tangents = {name: rng.normal(size=dr.width(params[name])) for name in names}
    inner = sum(float((values * tangents[name]).sum()) for name, values in read_gradients(params, names).items())
    params = attached(splats)
    value = loss(params, splats.sh_degree, rays, kind)
    for name in names:
        dr.set_grad(params[name], type(params[name])(tangents[name].astype(np.float32)))
    dr.enqueue(dr.ADMode.Forward, [params[name] for name in names])
    dr.traverse(dr.ADMode.Forward)
    np.testing.assert_allclose(float(dr.grad(value)[0]), inner, rtol=2e-3)
    assert abs(inner) > 0.1


def test_with_the_cutoffs_opacities_and_colours_have_the_gradients_of_finite_differences(splats, rays):
    """Where no alpha and no transmittance crosses a cutoff, which steps this small avoid."""
    rng = np.random.default_rng(26)
    for name in ("logit_opacities", *(name for name in COLORS if getattr(splats, name).size)):
        params = attached(splats)
        dr.backward(loss(params, splats.sh_degree, rays, "gather"))
        direction = rng.normal(size=dr.width(params[name]))
        found = float((dr.grad(params[name]).numpy() * direction).sum())
        values, step, losses = np.array(getattr(splats, name), np.float64), 1e-6, []
        for sign in (1, -1):
            raw, changed = in_float64(splats)
            raw[name] += sign * step * direction.reshape(values.shape)
            δ, (colors, T) = adjoints(len(rays.maxt)), twin.gather(rays.meet(changed))
            losses.append(float((δ[:3] * colors.T).sum() + (δ[3] * T).sum()))
        np.testing.assert_allclose(found, (losses[0] - losses[1]) / (2 * step), rtol=5e-3)


def test_a_primitive_that_no_ray_meets_has_no_gradient(rays):
    beside = rounded(random_splats(9, seed=21, degree=1))
    beside.means[2] += 100
    params = attached(beside)
    dr.backward(loss(params, 1, rays, "gather"))
    for values in read_gradients(params, ("means", "logit_opacities", "sh_coeffs")).values():
        rows = values.reshape(9, -1)
        assert not rows[2].any() and rows.any()


@pytest.mark.parametrize(("kind", "shares"), [("transmittance", "slopes"), ("gather", "colours of one value")])
def test_what_takes_no_light_away_changes_none_in_reverse_and_in_forward_mode(kind, shares, rays):
    """Without negative transmittance, of a model with many negative α; by its opacities."""
    splats, options = rounded(random_splats(9, 22, 1, 0.5, *SHARES[shares])), {"negative_transmittance": False}
    assert (rays.meet(splats).alphas < -0.01).sum() > 20
    names = "logit_opacities", "dog_logit_opacities"
    raw, changed = in_float64(splats)
    expected = {name: np.zeros(raw[name].shape) for name in names}
    for name in names:
        for k, kept in enumerate(raw[name]):
            for sign in (1, -1):
                raw[name][k] = kept + sign * STEP
                loss_there = twin_loss(rays.meet(changed, smooth=True), kind, **options)
                expected[name][k] += sign * loss_there / (2 * STEP)
            raw[name][k] = kept
    params = attached(splats)
    dr.backward(loss(params, 1, rays, kind, cutoffs=SMOOTH, **options))
    for name in names:
        limit = 2e-3 * np.abs(expected[name]).max()
        np.testing.assert_allclose(dr.grad(params[name]).numpy(), expected[name], atol=limit)
    params = attached(splats)
    value = loss(params, 1, rays, kind, cutoffs=SMOOTH, **options)
    tangents = {name: np.random.default_rng(27).normal(size=expected[name].shape) for name in names}
    for name in names:
        dr.set_grad(params[name], type(params[name])(tangents[name].astype(np.float32)))
    dr.enqueue(dr.ADMode.Forward, [params[name] for name in names])
    dr.traverse(dr.ADMode.Forward)
    inner = sum(float(tangents[name] @ expected[name]) for name in names)
    assert float(dr.grad(value)[0]) == pytest.approx(inner, rel=5e-3) and abs(inner) > 0.05
