"""What planes cut off, as whole primitives: the nearest ones, in numbers, in space and in pictures."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cut_models import flattened, with_cuts, with_second_cuts
from mi_dogsplat import reference
from mi_dogsplat.scene.across import across_views
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.scene.whole import nearest_whole, whole
from places import points_in
from scipy.optimize import least_squares, minimize
from sloped_models import with_slopes
from splat_scenes import axis_rotation, image_of, make_camera, make_splats, random_splats, rasterized, rounded

PLACES = np.linspace(-9, 9, 4001)
C0 = 0.28209479177387814


def with_both(splats: Any, every: int = 2) -> Splats:
    return with_second_cuts(with_cuts(splats, every), every)


GIVEN = {"cuts": with_cuts, "second cuts": with_second_cuts, "both": with_both}
by_planes = pytest.mark.parametrize("given", GIVEN.values(), ids=GIVEN)


def left(length: float, offset: float = 4.0) -> np.ndarray:
    """What a cut leaves of a Gaussian along its normal, at ``PLACES``."""
    return np.exp(-0.5 * PLACES**2 - np.logaddexp(0, -offset - length * PLACES)) * (1 + np.exp(-4))


def gaussian(m: float, r: float, a: float) -> np.ndarray:
    return a * np.exp(-0.5 * ((PLACES - m) / r) ** 2)


def covariances(splats: Splats) -> np.ndarray:
    axes = reference.rotations(splats.quats.astype(np.float64)) * np.exp(splats.log_scales.astype(np.float64))[:, None]
    return axes @ axes.swapaxes(1, 2)


@pytest.mark.parametrize("length", [0.2, 1.0, 3.3, 7.0, 30.0, 300.0])
def test_no_other_gaussian_is_nearer(length):
    """Oracle: a search without a table, from elsewhere."""
    found = [values.item() for values in nearest_whole(np.array([length]), np.array([4.0]))]
    best = minimize(lambda p: ((gaussian(*p) - left(length)) ** 2).sum(), (0.2, 0.8, 0.9), method="Nelder-Mead",
                    options={"xatol": 1e-6, "fatol": 1e-12})  # fmt: skip
    np.testing.assert_allclose(found, best.x, atol=2e-3)
    error = ((gaussian(*found) - left(length)) ** 2).sum()
    assert error < 0.15 * ((gaussian(0, 1, 1) - left(length)) ** 2).sum()


@pytest.mark.parametrize("offset", [-20.0, -9.0, -3.0, 0.0, 2.0, 8.0, 30.0])
@pytest.mark.parametrize("length", [0.05, 0.4, 2.0, 12.0, 90.0, 1000.0])
def test_wherever_the_plane_lies_hardly_any_gaussian_is_nearer(length, offset):
    """Slivers too, as a second plane may leave them. Oracle: searches from several starts, in parts of all squares."""
    f = left(length, offset)

    def lost(p: np.ndarray) -> float:
        G = gaussian(p[0], np.exp(p[1]), 1)
        return float(1 - (G @ f) ** 2 / (G @ G) / (f @ f))

    m, r, a = (values.item() for values in nearest_whole(np.array([length]), np.array([offset])))
    starts = (PLACES[f.argmax()], 0), (PLACES[f.argmax()], -2), (0.3, -0.3)
    best = min(minimize(lost, start, method="Nelder-Mead").fun for start in starts)
    error = ((gaussian(m, r, a) - f) ** 2).sum() / (f @ f)
    assert error < best + 1e-4 and best < 0.12


@pytest.mark.parametrize("planes", [1, 2])
def test_a_normal_of_zero_leaves_its_primitive_as_it_is(planes):
    splats = rounded(random_splats(20))
    cut = replace(splats, cut_index=np.arange(20), cut_normals=np.zeros((20, 3)))
    if planes == 2:
        cut = replace(cut, second_cut_index=cut.cut_index, second_cut_normals=cut.cut_normals)
    same = whole(cut)
    np.testing.assert_allclose(covariances(same), covariances(splats), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(same.means, splats.means, atol=1e-6)
    np.testing.assert_allclose(same.opacities, splats.opacities, rtol=1e-5)
    assert whole(splats) is splats


def test_a_cut_along_an_axis_by_hand():
    splats = make_splats([[1, 2, 3]], [[0.1, 0.2, 0.4]], 0.5)
    cut = replace(rounded(splats), cut_index=[0], cut_normals=[[0, -7, 0]])
    m, r, a = (values.item() for values in nearest_whole(np.array([7.0]), np.array([4.0])))
    found = whole(cut)
    assert found.n_cuts == 0 and 0.3 < m < 0.35 and 0.7 < r < 0.72
    np.testing.assert_allclose(found.means, [[1, 2 - 0.2 * m, 3]], rtol=1e-6)
    np.testing.assert_allclose(covariances(found)[0], np.diag([0.01, (0.2 * r) ** 2, 0.16]), atol=1e-7)
    np.testing.assert_allclose(found.opacities, 0.5 * a, rtol=1e-6)


def test_a_second_plane_alone_is_as_good_as_the_first():
    first = with_cuts(with_slopes(random_splats(40)))
    rows = {"second_cut_index": first.cut_index, "second_cut_normals": first.cut_normals}
    found, expected = whole(replace(first.without_cuts(), **rows)), whole(first)
    assert found.n_cuts == found.n_second_cuts == 0
    for name, values in vars(expected).items():
        np.testing.assert_array_equal(getattr(found, name), values, err_msg=name)


FLAT = 1e-3  # so that all views see what lies in a plane, and nothing of what is across it
LINE = np.linspace(-5, 5, 81)
PLANE = np.stack(np.meshgrid(LINE, LINE, indexing="ij"), -1).reshape(-1, 2)


def nearest_of_all(f: np.ndarray, start: np.ndarray) -> float:
    """The least sum of squares that a Gaussian in the plane has to ``f``: centre, shape and height at once."""

    def away(p: np.ndarray) -> np.ndarray:
        d = PLANE - p[:2]
        return p[5] * np.exp(-0.5 * ((p[2] * d[:, 0] + p[3] * d[:, 1]) ** 2 + (p[4] * d[:, 1]) ** 2)) - f

    starts = start, (*PLANE[f.argmax()], 1.5, 0, 1.5, f.max())
    return min((least_squares(away, each, method="lm").fun ** 2).sum() for each in starts)


def test_two_planes_one_after_the_other_come_near_to_the_best_for_both_at_once():
    """A search for all numbers of the Gaussian finds a nearer one, by 3 % in squares on average.

    It is twice as near where the planes face each other and leave a slab; there both are much nearer than without cuts.
    """
    n, flat = 40, np.zeros((80, 1))
    splats = rounded(make_splats(np.zeros((n, 3)), [[1, 1, FLAT]] * n, 0.5))
    normals = np.hstack([np.random.default_rng(0).normal(0, 6, (2 * n, 2)), flat]).reshape(n, 2, 3)
    rows = {"cut_normals": normals[:, 0], "second_cut_normals": normals[:, 1]}
    found = whole(replace(splats, cut_index=np.arange(n), second_cut_index=np.arange(n), **rows))
    shapes, squares = np.linalg.inv(covariances(found))[:, :2, :2], []
    for i in range(n):
        plain = np.exp(-0.5 * (PLANE**2).sum(1))
        f = plain * np.prod((1 + np.exp(-4)) / (1 + np.exp(-4 - PLANE @ normals[i, :, :2].T)), axis=1)
        d, height = PLANE - found.means[i, :2], found.opacities[i] / 0.5
        one_by_one = height * np.exp(-0.5 * np.einsum("pa,ab,pb->p", d, shapes[i], d))
        upper = np.linalg.cholesky(shapes[i]).T
        best = nearest_of_all(f, np.array([*found.means[i, :2], upper[0, 0], upper[0, 1], upper[1, 1], height]))
        squares.append([((one_by_one - f) ** 2).sum(), best, ((plain - f) ** 2).sum()])
    ours, best, without = np.array(squares).T
    np.testing.assert_allclose(covariances(found)[:, 2], [[0, 0, FLAT**2]] * n, atol=1e-8)  # beside both planes
    assert (ours > 0.999 * best).all() and np.median(ours / best) < 1.03 and (ours / best).max() < 2
    assert (ours / without).max() < 0.12 and np.median(ours / without) < 0.1


@by_planes
def test_the_others_keep_every_bit(given):
    splats = given(with_slopes(random_splats(40)))
    found, others = whole(splats).select(np.arange(1, 40, 2)), splats.without_cuts().select(np.arange(1, 40, 2))
    for name, values in vars(others).items():
        np.testing.assert_array_equal(getattr(found, name), values)


@by_planes
@pytest.mark.parametrize("linear", [np.diag([-1.3, 1.3, 1.3]), 0.6 * axis_rotation([1, -2, 0.7], 2.1)[0]])
def test_a_map_may_come_before_or_after(linear, given):
    """One that keeps angles, and with them the views. Up to a rounding of all but equal axes, what is whole does not
    depend on the axes it is told in."""
    matrix = affine(linear)
    splats = given(with_slopes(random_splats(40, dog_share=0, degree=0)))
    one, other = whole(transformed(splats, matrix)), transformed(whole(splats), matrix)
    np.testing.assert_allclose(one.means, other.means, atol=1e-5)
    np.testing.assert_allclose(covariances(one), covariances(other), atol=1e-5)
    np.testing.assert_allclose(one.opacities, other.opacities, rtol=1e-5)
    np.testing.assert_allclose(one.sh_coeffs, other.sh_coeffs, atol=1e-4)


def color_at(splats: Splats, points: np.ndarray) -> np.ndarray:
    """[N, P, 3] colours at points [N, P, 3] of primitives that all have slopes and SH degree 0."""
    axes = reference.rotations(splats.quats.astype(np.float64))
    w = np.einsum("nka,npk->npa", axes, points - splats.means.astype(np.float64)[:, None])
    w /= np.exp(splats.log_scales.astype(np.float64))[:, None]
    return 0.5 + C0 * splats.sh_coeffs[:, :1] + np.einsum("npa,nac->npc", w, splats.color_slopes.astype(np.float64))


@by_planes
def test_each_place_of_a_flat_primitive_keeps_its_colour(given):
    splats = flattened(given(with_slopes(random_splats(30, degree=0), every=1), every=1))
    points = points_in(splats)
    np.testing.assert_allclose(color_at(whole(splats), points), color_at(splats, points), atol=5e-3)
    assert np.abs(whole(splats).sh_coeffs - splats.sh_coeffs).max() > 0.1


def views_of(scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of views from all sides [V, 3], in standard deviations of a primitive with these scales, and the parts
    [V] that its pictures have of all of its pixels."""
    v = np.random.default_rng(3).normal(size=(400_000, 3))
    v = v / np.linalg.norm(v, axis=1, keepdims=True) / scales
    areas = np.linalg.norm(v, axis=1)
    return v / areas[:, None], areas / areas.sum()


@pytest.mark.parametrize(
    ("scales", "near"),
    [((1, 1, 1), 2e-3), ((1, 1, 1e-4), 2e-3), ((1, 1e-4, 1e-4), 3e-3), ((1, 0.25, 1), 0.02), ((1, 0.5, 0.1), 0.02)],
)
def test_how_much_of_an_axis_views_from_all_sides_have_across(scales, near):
    """Oracle: views by chance, each with the area of its picture. Exact for a ball, a disc and a rod."""
    found, (u, parts) = across_views(np.log(np.array([scales], np.float32)))[0], views_of(np.array(scales))
    np.testing.assert_allclose(found, 1 - parts @ u**2, atol=near)
    assert found.sum() == pytest.approx(2)


def test_scales_of_any_size_have_parts_that_are_finite():
    log_scales = np.array([[-100, -100, -100], [90, 90, 90], [-95, 0, 90], [60, -100, -100]], np.float32)
    np.testing.assert_allclose(across_views(log_scales), [[2 / 3] * 3, [2 / 3] * 3, [0, 1, 1], [1, 0.5, 0.5]])


@pytest.mark.parametrize("scales", [(1, 1, 1), (1, 1e-4, 1e-4)])
def test_the_centre_in_a_picture_keeps_its_colour_on_average_over_the_views(scales):
    """There a ray met the primitive before at the place with the same image in the plane through the old centre."""
    slopes, normal = np.random.default_rng(1).normal(size=(3, 3)), np.array([2.0, -5, 3])
    splats = rounded(make_splats([0, 0, 0], scales, 0.5))
    splats = replace(splats, slope_index=[0], color_slopes=slopes[None], cut_index=[0], cut_normals=normal[None])
    found, (u, parts) = whole(splats), views_of(np.array(scales))
    w = found.means[0] / np.array(scales)  # of the new centre
    seen = w - (u @ w)[:, None] * u
    expected = parts @ seen @ slopes
    np.testing.assert_allclose(C0 * (found.sh_coeffs - splats.sh_coeffs)[0, 0], expected, atol=2e-3)
    assert np.abs(expected).max() > 0.1


def test_a_pseudo_gaussian_goes_along():
    """One that is the primary's shape stays so, and another is as much narrower along the normal."""
    splats = make_splats([[0, 0, 0]] * 2, [[0.1, 0.2, 0.3]] * 2, 0.5, dog=[0, 1], F=1)
    splats.dog_log_scales[1] = np.log([0.5, 0.7, 1.2])
    cut = replace(rounded(splats), cut_index=[0, 1], cut_normals=[[3, -7, 2], [0, 9, 0]])
    found = whole(cut)
    np.testing.assert_allclose(found.dog_scales[0], 1, rtol=1e-5)
    pseudo = replace(found, log_scales=found.log_scales + found.dog_log_scales)
    r = nearest_whole(np.array([9.0]), np.array([4.0]))[1].item()
    expected = np.diag((np.array([0.5, 0.7 * r, 1.2]) * [0.1, 0.2, 0.3]) ** 2)
    np.testing.assert_allclose(covariances(pseudo)[1], expected, atol=1e-6)
    np.testing.assert_array_equal(found.dog_logit_opacities, cut.dog_logit_opacities)


@pytest.mark.parametrize(("normal", "near"), [((3, -7, 0), 1e-5), ((1, 0.2, 0), 1e-5), ((3, -7, 2), 0.02)])
@pytest.mark.parametrize("F", [(0.5, 0.7, 1.2), (40, 0.3, 1), (0.05, 900, 0.4)])
def test_hardly_any_other_pseudo_gaussian_with_these_axes_is_nearer(normal, near, F):
    """Oracle: a search, in the mean of squares in space. What is long and thin does not get as wide as it is long."""
    splats = make_splats([[0, 0, 0]], [[0.29, 0.3, 0.31]], 0.5, dog=[0])  # nearly all of a normal counts
    splats.dog_log_scales[0] = np.log(F)
    cut = replace(rounded(splats), cut_index=[0], cut_normals=[normal])
    found, (r,) = whole(cut), nearest_whole(np.array([np.linalg.norm(normal)]), np.array([4.0]))[1]
    n = np.array(normal) / np.linalg.norm(normal)
    pseudo = np.diag([0.29, 0.3, 0.31]) @ (np.eye(3) + (r - 1) * np.outer(n, n)) @ np.diag(F)
    along = (reference.rotations(found.quats.astype(np.float64))[0].T @ pseudo) / found.scales[0, :, None]
    precision = np.linalg.inv(along @ along.T)

    def lost(log_F: np.ndarray) -> float:
        both = precision + np.diag(np.exp(-2 * log_F))
        return float(1 - 8 * np.sqrt(np.linalg.det(precision)) * np.exp(-log_F.sum()) / np.linalg.det(both))

    own = found.dog_log_scales[0].astype(np.float64)
    best = minimize(lost, own, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 9999})
    assert lost(own) < best.fun + near
    if normal[2] == 0:
        np.testing.assert_allclose(own.sum(), np.log(F).sum(), atol=1e-4)


@by_planes
@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_pictures_are_much_nearer_than_without_the_cuts(dog_share, given):
    splats, camera = given(random_splats(40, degree=0, dog_share=dog_share), every=1), make_camera(96, 72, 90.0)
    truth, found, left_out = (image_of(rasterized(s, camera), camera) for s in (splats, whole(splats),
                                                                                splats.without_cuts()))  # fmt: skip
    assert ((found - truth) ** 2).mean() < 0.3 * ((left_out - truth) ** 2).mean()


@by_planes
def test_what_a_normal_has_along_the_thinnest_axis_hardly_moves_a_primitive_and_its_colours(given):
    """Hardly any picture shows that. Pictures from all sides, of thin primitives whose colours vary much."""
    splats = random_splats(40, seed=1, degree=0)
    splats.log_scales[:, 2] += np.log(0.1)
    splats, camera = given(with_slopes(splats, every=1), every=1), make_camera(64, 48, 60.0)
    splats.color_slopes *= 3
    splats.cut_normals[:, 2] *= 4
    splats.second_cut_normals[:, 2] *= 4
    squares = np.zeros(2)
    for k in range(6):
        turn = axis_rotation([1, 2, -1], k)[0] @ axis_rotation([0, 1, 1], 2 * k)[0]
        matrix = affine(turn, [0, 0, 3] - turn @ [0, 0, 3])  # about the middle of the model
        views = [image_of(rasterized(transformed(s, matrix), camera), camera)
                 for s in (splats, whole(splats), splats.without_cuts())]  # fmt: skip
        squares += [((views[0] - other) ** 2).mean() for other in views[1:]]
    assert squares[0] < 0.4 * squares[1]  # found: .14 to .26; .56 to .67 with normals as they are
