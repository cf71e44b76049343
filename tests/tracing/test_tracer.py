"""What rays gather, against the float64 twin and closed forms."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from launches import KernelWatch
from mi_dogsplat.engine.arrays import while_loop
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.reference import rays as twin
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.tracing.options import TraceOptions
from mi_dogsplat.tracing.rays import FEW
from mi_dogsplat.tracing.tracer import SplatTracer
from mi_dogsplat.tracing.visits import BUFFER
from ray_sets import RaySet, decided, gathered, random_rays, ray_set, traced_as_the_twin, tracer_of
from same_numbers import assert_same_numbers
from splat_scenes import axis_rotation, make_splats, random_splats, rounded


@pytest.fixture(scope="module")
def mixture() -> Splats:
    return rounded(random_splats(200, seed=1))


@pytest.fixture(scope="module")
def rays() -> RaySet:
    return random_rays(250, seed=2)


@pytest.mark.parametrize("negative_transmittance", [True, False])
def test_colours_and_transmittance_are_those_of_the_twin(mixture, rays, negative_transmittance):
    options = {"negative_transmittance": negative_transmittance}
    assert decided(mixture, rays, **options).mean() > 0.9
    alphas = rays.meet(mixture).alphas
    assert (alphas < 0).any() and (alphas > 0).sum(1).max() > BUFFER
    traced_as_the_twin(mixture, rays, **options)


def test_without_cutoffs_too(mixture, rays):
    tracer = tracer_of(mixture, cutoffs=SMOOTH)
    meetings = rays.meet(mixture, smooth=True)
    colors, T = gathered(tracer, rays)
    expected_colors, expected_T = twin.gather(meetings, smooth=True)
    np.testing.assert_allclose(colors, expected_colors, atol=1e-4, rtol=1e-3)
    np.testing.assert_allclose(T, expected_T, atol=1e-5, rtol=1e-3)


def test_rays_without_a_direction_are_walked_to_their_end(mixture):
    """As literals above all: NaN as a whole number was a key beyond all buckets, and the process ended."""
    n = FEW + 100
    direction = mi.Vector3f(dr.full(mi.Float, np.nan, n), 0, 1)
    colors, T = tracer_of(mixture).gather(mi.Ray3f(mi.Point3f(dr.zeros(mi.Float, n)), direction))
    assert dr.width(T) == n and dr.width(colors[0]) == n
    dr.eval(colors, T)


def test_the_order_in_which_rays_are_walked_changes_no_bit(mixture):
    many = random_rays(FEW + 100, seed=3)
    few = many.select(np.arange(200))
    tracer = tracer_of(mixture)
    for whole, part in zip(gathered(tracer, many), gathered(tracer, few), strict=True):
        np.testing.assert_array_equal(whole[:200], part)
    T = tracer.transmittance(many.ray).numpy()
    np.testing.assert_array_equal(T[:200], tracer.transmittance(few.ray).numpy())


@pytest.mark.parametrize("n", [60, FEW + 60])
def test_lanes_that_are_not_active_gather_nothing(mixture, n):
    rays = random_rays(n, seed=4)
    tracer = tracer_of(mixture)
    active = np.arange(n) % 3 == 0
    colors, T = gathered(tracer, rays, mi.Bool(active))
    everywhere, T_everywhere = gathered(tracer, rays)
    np.testing.assert_array_equal(colors, np.where(active[:, None], everywhere, 0))
    np.testing.assert_array_equal(T, np.where(active, T_everywhere, 1))
    shadow = tracer.transmittance(rays.ray, mi.Bool(active)).numpy()
    np.testing.assert_array_equal(shadow[~active], 1)
    assert (shadow[active] < 1).any()
    nowhere, T_nowhere = gathered(tracer, rays, mi.Bool(np.zeros(n, bool)))
    assert not nowhere.any() and (T_nowhere == 1).all()


@pytest.mark.parametrize("towards", [[], [1.0]], ids=["no directions", "one direction"])
@pytest.mark.parametrize("n", [0, 2])
def test_no_rays_gather_nothing(mixture, n, towards):
    """As when all paths have ended."""
    tracer = tracer_of(mixture.select(np.arange(n)))
    ray = mi.Ray3f(mi.Point3f(mi.Float([])), mi.Vector3f(mi.Float(towards), 0, 0))
    colors, T = tracer.gather(ray)
    assert [len(values) for values in (*colors, T, tracer.transmittance(ray))] == [0] * 5


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_models_of_few_primitives(n):
    splats = rounded(random_splats(max(n, 1), seed=5, dog_share=0)).select(np.arange(n))
    rays = random_rays(200, seed=6, bounded=False)
    colors, T = gathered(tracer_of(splats), rays)
    if n == 0:
        assert not colors.any() and (T == 1).all() and (tracer_of(splats).transmittance(rays.ray).numpy() == 1).all()
    else:
        expected, _ = twin.gather(rays.meet(splats))
        np.testing.assert_allclose(colors[sure := decided(splats, rays)], expected[sure], atol=2e-5)


def test_primitives_that_are_not_drawn_leave_no_trace():
    splats = rounded(random_splats(20, seed=7))
    rays = random_rays(100, seed=8)
    broken = Splats(**vars(splats))
    broken.means, broken.log_scales, broken.quats = splats.means.copy(), splats.log_scales.copy(), splats.quats.copy()
    broken.logit_opacities, broken.sh_coeffs = splats.logit_opacities.copy(), splats.sh_coeffs.copy()
    broken.means[3, 1], broken.logit_opacities[4], broken.sh_coeffs[5, 2, 1] = np.nan, -8, np.inf
    broken.log_scales[6], broken.quats[7, 2], broken.log_scales[8, 1] = np.inf, np.nan, np.inf
    rest = splats.select(np.delete(np.arange(20), [3, 4, 5, 6, 7, 8]))
    for a, b in zip(gathered(tracer_of(broken), rays), gathered(tracer_of(rest), rays), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_clones_are_met_once_each():
    """At one place on the ray, more of them than a round has room for."""
    n, alpha = 3 * BUFFER + 1, 0.05
    splats = rounded(make_splats(np.tile([[0.1, 0.2, 3.0]], (n, 1)), 0.3, alpha, 0.8))
    rays = ray_set([0.1, 0.2, 0], [0, 0, 1])
    colors, T = gathered(tracer_of(splats), rays)
    np.testing.assert_allclose(T, (1 - alpha) ** n, rtol=1e-5)
    np.testing.assert_allclose(colors, 0.8 * (1 - (1 - alpha) ** n), rtol=1e-5)


def test_many_primitives_in_a_row_are_blended_in_their_order():
    n = 200
    rng = np.random.default_rng(9)
    z = rng.permutation(np.linspace(1, 9, n))
    splats = rounded(make_splats(np.stack([0 * z, 0 * z, z], 1), 0.002, 0.03, rng.uniform(0, 1, (n, 3))))
    rays = ray_set([0, 0, 0], [0, 0, 1])
    colors, T = gathered(tracer_of(splats), rays)
    expected, expected_T = twin.gather(rays.meet(splats))
    np.testing.assert_allclose(colors, expected, atol=1e-5)
    np.testing.assert_allclose(T, expected_T, rtol=1e-4)


@pytest.mark.parametrize("direction", [[0, 0, 1], [0, 0, -1], [0, 1, 0], [-1, 0, 0], [0, -1e-30, 2]])
def test_rays_along_an_axis(direction):
    splats = rounded(random_splats(40, seed=10, dog_share=0.3))
    away = np.random.default_rng(11).uniform([-1.5, -1.2, 1.5], [1.5, 1.2, 5], (60, 3))
    rays = ray_set(away - 8 * np.asarray(direction) / np.linalg.norm(direction), direction)
    colors, _ = gathered(tracer_of(splats), rays)
    sure = decided(splats, rays)
    np.testing.assert_allclose(colors[sure], twin.gather(rays.meet(splats))[0][sure], atol=1e-4)
    assert colors.any()


@pytest.mark.parametrize("thickness", [1e-2, 1e-5, 1e-9])
def test_disks_of_any_thickness(thickness):
    """A ray meets one where it meets its plane."""
    R, quat = axis_rotation([1, 2, 0.5], 0.7)
    centre, inside = np.array([0.2, -0.1, 4.0]), np.array([0.15, -0.05, 0])
    splats = rounded(make_splats([centre], [[0.3, 0.2, thickness]], 0.9, 0.5, quat))
    target = centre + R @ inside
    rays = ray_set([[0, 0, 0], [1, 0.5, 1]], [target, target - [1, 0.5, 1]])
    _, T = gathered(tracer_of(splats), rays)
    value = 0.9 * np.exp(-0.5 * ((inside[0] / 0.3) ** 2 + (inside[1] / 0.2) ** 2))
    np.testing.assert_allclose(1 - T, value, rtol=2e-3)


def test_needles_seen_from_the_side():
    width, offset = 1e-4, 0.7e-4
    splats = rounded(make_splats([[0, 0, 1.0]], [[2.0, width, width]], 0.8))
    rays = ray_set([[0, offset, 0], [0, offset, 0]], [[0, 0, 1], [0, 0, 7]])
    _, T = gathered(tracer_of(splats), rays)
    np.testing.assert_allclose(1 - T, 0.8 * np.exp(-0.5 * (offset / width) ** 2), rtol=1e-3)


def test_a_segment_has_what_is_met_within_it():
    splats = rounded(make_splats([[0, 0, 2.0], [0, 0, 4.0]], 0.5, [0.4, 0.6]))
    ends = np.array([1.9, 2.1, 3.9, 4.1, np.inf])
    _, T = gathered(tracer_of(splats), ray_set([0, 0, 0], np.tile([0, 0, 1.0], (5, 1)), ends))
    np.testing.assert_allclose(T, [1, 0.6, 0.6, 0.24, 0.24], rtol=1e-5)
    _, T = gathered(tracer_of(splats), ray_set([0, 0, 0], np.tile([0, 0, 0.5], (2, 1)), [3.9, 4.1]))
    np.testing.assert_allclose(T, [1, 0.6], rtol=1e-5)  # in units of the direction
    _, T = gathered(tracer_of(splats), ray_set([0, 0, 2.01], [[0, 0, 1], [0, 0, -1]]))
    np.testing.assert_allclose(T, [0.4, 0.6], rtol=1e-5)  # from within both


def test_primitives_with_degrees_of_their_own():
    splats = rounded(random_splats(30, seed=12))
    degrees = np.arange(30) % 4
    mixed = splats.with_sh_degrees(degrees)
    rays = random_rays(100, seed=13)
    padded = mixed.uniform_sh()
    for a, b in zip(gathered(tracer_of(mixed), rays), gathered(tracer_of(padded), rays), strict=True):
        assert_same_numbers(a, b)


def test_more_degrees_than_there_are():
    splats = rounded(random_splats(5, degree=1))
    with pytest.raises(ValueError, match="SH degree 2 needs 9 coefficients"):
        SplatTracer(upload(splats), TraceOptions(2))


def test_within_a_symbolic_loop(mixture, rays):
    tracer = tracer_of(mixture)
    expected, expected_T = gathered(tracer, rays)
    shadow = tracer.transmittance(rays.ray).numpy()

    def body(k, color, T, S):
        found, left = tracer.gather(rays.ray, k > 0)
        return k + 1, color + found, T * left, S * tracer.transmittance(rays.ray, k == 1)

    n = len(rays.maxt)
    start = dr.zeros(mi.UInt32, n), mi.Color3f(0), dr.full(mi.Float, 1, n), dr.full(mi.Float, 1, n)
    _, color, T, S = while_loop(start, lambda k, *_: k < 2, body, "bounces")
    assert_same_numbers(np.stack([c.numpy() for c in color], -1), expected)
    assert_same_numbers(T.numpy(), expected_T)
    assert_same_numbers(S.numpy(), shadow)


def test_kernels_are_compiled_once():
    """Whatever the numbers of primitives and rays, as long as the tree is as deep."""

    def run(n, rays, seed):
        splats = rounded(random_splats(n, seed))
        tracer = tracer_of(splats)
        dr.eval(tracer.gather(random_rays(rays, seed).ray), tracer.transmittance(random_rays(rays, seed).ray))

    with KernelWatch() as kernels:
        run(65, 50, 0)
        run(66, FEW + 30, 1)
        run(90, FEW + 3, 1)
        kernels.forget()
        run(100, 70, 2)
        run(120, FEW + 90, 3)
    assert kernels.launched and not kernels.new
