"""Bands of tile rows: the same bits as without, in less memory."""

from bisect import bisect_left
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from device_peak import device_peak
from mi_dogsplat.engine import bands as module
from mi_dogsplat.engine.arrays import detached
from mi_dogsplat.engine.bands import LISTED, MOST_ISECTS, WALKED, BandedView, bands_of
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks, Grid
from mi_dogsplat.engine.isects import count_isects
from mi_dogsplat.engine.options import Settings
from mi_dogsplat.engine.parameters import device_array, upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.engine.tables import CentredKernel, varying_columns
from mi_dogsplat.engine.view import prepare, prepare_both
from mi_dogsplat.engine.walks.aovs import WALKED as AOVS
from mi_dogsplat.engine.walks.aovs import composite_aovs
from mi_dogsplat.engine.walks.composite import composite_over
from mi_dogsplat.engine.walks.fisher import COLUMNS as FISHER
from mi_dogsplat.engine.walks.fisher import composite_fisher, patch_blocks
from mi_dogsplat.engine.walks.score import Sums, composite_score
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.engine.walks.weights import composite_weights
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from read_together import read
from splat_scenes import attached, make_camera, make_splats, options, random_splats, rounded, tilted_camera

pytestmark = pytest.mark.skipif(
    not (mi.variant() or "").startswith("llvm"),
    reason="on CUDA a view is in one piece, as its isects have no sums of their own; use llvm_ad_rgb",
)
COUNTS = (2, 5)  # of bands
SHARES = {"plain": (0,), "DoG": (0.5,), "slopes": (0.5, 0.5), "cuts": (0, 0, 0.5), "second cuts": (0, 0, 0, 0.5),
          "all of them": (0.5, 0.5, 0.5, 0.5)}  # fmt: skip
"""Of DoG primitives, and of those with slopes, cuts and second cuts."""
SIZES = ((150, 117), (97, 200), (33, 81))


def per_row(splats: Splats, camera: Camera) -> np.ndarray:
    """Isects in each tile row."""
    grid = Grid.of(camera.width, camera.height, Blocks.of_backend())
    projection = project(upload(splats), DeviceCamera.upload(camera), sh_degree=0)
    return count_isects(projection, grid, options(splats).cutoffs).per_row(grid.tiles_y)


def memory_for(count: int, rows: np.ndarray) -> float:
    """Bytes with which a view has that many bands."""
    total = int(rows.sum())
    fewer = bisect_left(range(total), -(count - 1), key=lambda most: -len(bands_of(rows, most)))  # with more isects
    most = fewer - 1
    assert len(bands_of(rows, most)) == count
    return LISTED * total + WALKED * (most + 0.5)


def assert_same(got: list[np.ndarray], expected: list[np.ndarray]) -> None:
    """Bits, where a tile's lanes add in turn; else two runs differ by the order of additions."""
    rtol, atol = (0, 0) if lanes_add_in_turn(mi.variant()) else (1e-3, 1e-5)
    for a, b in zip(got, expected, strict=True):
        assert np.abs(b).max() > 0
        np.testing.assert_allclose(a, b, rtol=rtol, atol=atol)


def passes(splats: Splats, camera: Camera, probed=False, stop=False, **chosen) -> tuple[Any, list, list]:
    """(view, planes, gradients) of a forward and a backward pass."""
    params, n_pixels = attached(splats), camera.width * camera.height
    probe = [dr.zeros(mi.Float, splats.n_splats) for _ in range(2)] if probed else None
    stop_depth = dr.opaque(mi.Float, 3.0, n_pixels) if stop else None
    dr.enable_grad(probe)
    frame = rasterize(params, DeviceCamera.upload(camera), options(splats, **chosen), probe, stop_depth=stop_depth)
    planes = [*frame.colors, frame.T, *([frame.depth] if frame.depth is not None else []), *(frame.normal or [])]
    for k, plane in enumerate(planes):
        dr.set_grad(plane, device_array(np.random.default_rng(k).normal(size=n_pixels)))
    dr.enqueue(dr.ADMode.Backward, planes)
    dr.traverse(dr.ADMode.Backward)
    leaves = [value for value in [*params.values(), *(probe or [])] if dr.grad_enabled(value)]
    return frame.view, read(map(dr.detach, planes)), read(map(dr.grad, leaves))


@pytest.mark.parametrize("rows", [[3, 4, 5, 0, 0, 9, 1], [0], [7], [0, 0, 30, 0], [1] * 40])
@pytest.mark.parametrize("most", [0, 1, 6, 9, 100])
def test_bands_have_all_rows_in_order_and_are_as_few_as_fit(rows, most):
    bands = bands_of(np.array(rows), most)
    assert [row for band in bands for row in band.rows] == list(range(len(rows)))
    sums = [sum(rows[row] for row in band.rows) for band in bands]
    assert [band.isects_above for band in bands] == [sum(sums[:k]) for k in range(len(bands))]
    for k, (band, count) in enumerate(zip(bands, sums, strict=True)):
        assert count <= most or sum(rows[row] > 0 for row in band.rows) == 1
        assert k == len(bands) - 1 or count + rows[band.rows.stop] > most


@pytest.mark.parametrize(  # what is chosen shares kernels: each plane and each gradient is compared all the same
    "chosen",
    [{"probed": True, "depth": True, "normal": True}, {"stop": True, "depth": True, "negative_transmittance": False}],
    ids=["probe and features", "stop depth and mode"],
)
@pytest.mark.parametrize("shares", SHARES.values(), ids=SHARES)
def test_picture_and_gradients_have_the_same_bits(shares, chosen):
    for k, size in enumerate(SIZES):
        splats, camera = rounded(random_splats(200, k, 1, *shares)), tilted_camera(*size)
        _, planes, gradients = passes(splats, camera, **chosen)
        rows = per_row(splats, camera)
        for count in COUNTS:
            memory = memory_for(count, rows)
            view, banded_planes, banded_gradients = passes(splats, camera, isect_memory=memory, **chosen)
            assert len(view.bands) == count
            for a, b in zip(banded_planes, planes, strict=True):
                np.testing.assert_array_equal(a, b)
            assert_same(banded_gradients, gradients)


def test_a_band_for_every_row_is_the_least_memory_there_is():
    splats, camera = rounded(random_splats(50, seed=4, degree=0)), tilted_camera(60, 90)
    _, planes, gradients = passes(splats, camera)
    for memory in (0.0, -1e9):
        view, banded_planes, banded_gradients = passes(splats, camera, isect_memory=memory)
        assert sum(len(band.rows) for band in view.bands) == view.grid.tiles_y
        assert len(view.bands) >= np.count_nonzero(per_row(splats, camera))
        assert_same(banded_planes + banded_gradients, planes + gradients)


def test_rows_that_nothing_touches_are_background():
    """Three primitives at the top of the picture, and none at all."""
    camera = make_camera(40, 200)
    top = rounded(make_splats([[0, -4, 3], [0.1, -4, 4], [0, -3.9, 5]], colors=0.7))
    _, planes, gradients = passes(top, camera)
    view, banded_planes, banded_gradients = passes(top, camera, isect_memory=0)
    assert len(view.bands) == len(bands_of(per_row(top, camera), 0)) and planes[3].reshape(200, 40)[100:].min() == 1
    assert_same(banded_planes + banded_gradients, planes + gradients)
    behind = rounded(make_splats([[0, 0, -3]]))
    assert passes(behind, camera, isect_memory=0)[1][3].min() == 1


AWAY = Camera(np.diag([1.0, -1, -1, 1]), 36, 36, 20, 15, 40, 30)
UP = Camera(np.eye(4), 36, 36, 20, 90, 40, 120)  # its upper rows see nothing


@pytest.mark.parametrize(("camera", "memory"), [(AWAY, 1e9), (AWAY, 1.0), (UP, 1.0)], ids=["view", "bands", "band"])
def test_what_shows_nothing_has_a_derivative_for_any_number_of_dog(camera, memory):
    """A frozen function that reads no array of that size would replay the first one."""
    for n_dog in (30, 31, 33):
        splats = random_splats(80, 1, 1)
        splats.dog_index, splats.dog_logit_opacities = np.arange(n_dog), np.zeros(n_dog)
        splats.dog_log_scales = np.full((n_dog, 3), 0.3)
        _, _, gradients = passes(rounded(splats), camera, isect_memory=memory)
        for banded, whole in zip(gradients, passes(rounded(splats), camera)[2], strict=True):
            np.testing.assert_allclose(banded, whole, rtol=1e-3, atol=1e-5)
            assert whole.any() == (camera is UP)


@pytest.mark.parametrize("shares", SHARES.values(), ids=SHARES)
def test_tangents_have_the_same_bits(shares):
    splats, camera = rounded(random_splats(100, 1, 1, *shares)), tilted_camera(90, 77)

    def tangents(**chosen) -> list[np.ndarray]:
        params = attached(splats)
        for k, value in enumerate(v for v in params.values() if dr.grad_enabled(v)):
            dr.set_grad(value, device_array(np.random.default_rng(k).normal(size=dr.width(value))))
        leaves = [value for value in params.values() if dr.grad_enabled(value)]
        frame = rasterize(params, DeviceCamera.upload(camera), options(splats, **chosen))
        dr.enqueue(dr.ADMode.Forward, leaves)
        dr.traverse(dr.ADMode.Forward)
        return read(dr.grad(plane) for plane in [*frame.colors, frame.T])

    expected, rows = tangents(), per_row(splats, camera)
    for count in COUNTS:
        for a, b in zip(tangents(isect_memory=memory_for(count, rows)), expected, strict=True):
            np.testing.assert_array_equal(a, b)


def score_of(params: dict, camera: DeviceCamera, chosen) -> tuple[Any, list]:
    sums = Sums(removal=True, gradient=True, probes=2)
    pictured, view = prepare_both(params, camera, chosen, sums.blocks)
    noise = np.random.default_rng(0).normal(size=(6, camera.width * camera.height))
    planes = [detached(device_array(plane)) for plane in noise]
    return view, read(composite_score(view, sums, composite_over(pictured, 0.3), planes))


def fisher_of(params: dict, camera: DeviceCamera, chosen) -> tuple[Any, list]:
    pictured, view = prepare_both(params, camera, chosen, patch_blocks())
    return view, read(composite_fisher(view, composite_over(pictured, 0.3)))


def weights_of(params: dict, camera: DeviceCamera, chosen) -> tuple[Any, list]:
    view = prepare(params, camera, chosen)
    plane = np.random.default_rng(0).uniform(size=camera.width * camera.height)
    columns, largest = composite_weights(view, detached(device_array(plane)))
    return view, read([*columns, largest])


def aovs_of(params: dict, camera: DeviceCamera, chosen) -> tuple[Any, list]:
    view = prepare(params, camera, chosen)
    depths = detached(project(params, camera, sh_degree=0).depth)
    return view, read(composite_aovs(view, AOVS, depths))


@pytest.mark.parametrize("shares", [SHARES["DoG"], SHARES["all of them"]], ids=["DoG", "all of them"])
@pytest.mark.parametrize("walk", [score_of, fisher_of, weights_of, aovs_of])
def test_every_other_walk_has_the_same_bits(walk: Callable, shares):
    splats, camera = rounded(random_splats(150, 2, 1, *shares)), tilted_camera(101, 93)
    params, device_camera, rows = upload(splats), DeviceCamera.upload(camera), per_row(splats, camera)
    _, expected = walk(params, device_camera, options(splats))
    for count in COUNTS:
        view, got = walk(params, device_camera, options(splats, isect_memory=memory_for(count, rows)))
        assert isinstance(view, BandedView) and len(view.bands) >= count
        assert len(view.lists) == len(view.bands)  # however often it was walked
        assert_same(got, expected)


def test_what_fits_has_no_bands():
    splats, camera = rounded(random_splats(50, degree=0)), tilted_camera()
    total = int(per_row(splats, camera).sum())
    enough = (LISTED + WALKED) * total
    assert not isinstance(passes(splats, camera, isect_memory=enough)[0], BandedView)
    assert isinstance(passes(splats, camera, isect_memory=enough - 1)[0], BandedView)


def test_more_isects_than_arrays_have_room_for_have_bands_whatever_the_memory(monkeypatch):
    """Sums of 2^27 isects would be arrays of 2^32 numbers, which Dr.Jit does not make."""
    splats, camera = rounded(random_splats(60, 3, 0)), tilted_camera(60, 90)
    _, planes, gradients = passes(splats, camera)
    most = int(per_row(splats, camera).sum()) // 2
    monkeypatch.setattr(module, "MOST_ISECTS", most)
    for memory in (None, 1e12):
        view, banded_planes, banded_gradients = passes(splats, camera, isect_memory=memory)
        assert isinstance(view, BandedView) and len(view.bands) > 1
        assert_same(banded_planes + banded_gradients, planes + gradients)


def test_sums_of_the_most_isects_of_a_band_are_fewer_than_arrays_have_room_for():
    features = 7  # colours, depth and normal
    varying = varying_columns(Settings(features, slopes=True, curvatures=True, cuts=2))
    for columns in (len(CentredKernel._fields) + features + varying, FISHER):
        assert MOST_ISECTS * 2 ** (columns - 1).bit_length() < 2**32


@pytest.mark.slow
def test_the_memory_of_a_view_follows_the_bands_and_not_its_isects():
    """Peak of what Dr.Jit has allocated, above what it held before; it rounds sizes up to powers of two."""
    camera, n = make_camera(64, 512, f=100.0), 4000
    rng = np.random.default_rng(0)
    pixels, depth = rng.uniform([0, 0], [64, 512], (n, 2)), rng.uniform(2, 4, n)
    rays = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    splats = rounded(make_splats(np.column_stack([rays * depth[:, None], depth]), scales=0.8, opacities=0.05))
    rows = per_row(splats, camera)
    total = int(rows.sum())
    assert total > 10 * n

    whole = device_peak(lambda: passes(splats, camera))
    banded = device_peak(lambda: passes(splats, camera, isect_memory=memory_for(8, rows)))
    assert whole > 100 * total  # bytes
    assert banded < whole / 2, (whole, banded, total)
