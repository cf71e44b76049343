"""Stage 2 against its float64 twin: nothing is missing, hardly anything is listed in vain."""

import drjit as dr
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.footprints import SLACK
from mi_dogsplat.engine.geometry import SMOOTH, Blocks, Cutoffs, Grid
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.screen_kernels import LOW_PASS
from mi_dogsplat.engine.tiles import TileLists, tiles
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.row_groups import PLANES
from mi_dogsplat.scene.splats import Splats
from splat_scenes import make_camera, make_splats, random_splats, rounded, tilted_camera
from tile_lists import lanes_of_isects

HARD = Cutoffs()


def grid_of(camera: Camera) -> Grid:
    return Grid.of(camera.width, camera.height, Blocks.of_backend())


def engine_tiles(splats: Splats, camera: Camera, cutoffs=HARD) -> TileLists:
    return tiles(project(upload(splats), DeviceCamera.upload(camera), sh_degree=splats.sh_degree),
                 grid_of(camera), cutoffs)


def engine_lists(splats: Splats, camera: Camera, cutoffs=HARD) -> list[np.ndarray]:
    lists = engine_tiles(splats, camera, cutoffs)
    begin, end, splat = (np.array(v) for v in (lists.begin, lists.end, lists.splat_from_isect))
    return [splat[b:e] for b, e in zip(begin, end, strict=True)]


def reference_lists(splats: Splats, camera: Camera) -> list[np.ndarray]:
    blocks = grid_of(camera).blocks
    return reference.tiles(reference.project(splats, camera), camera.width, camera.height,
                           blocks.tile_width, blocks.tile_height)


def _smallest_in_box(conic, x0, y0, x1, y1) -> np.ndarray:
    """Minimum of d^T conic d over boxes that are given relative to the centre: inside, or on one of four sides."""
    a, b, c = conic
    q = [np.where((x0 <= 0) & (0 <= x1) & (y0 <= 0) & (0 <= y1), 0.0, np.inf)]
    for x in (x0, x1):
        y = np.clip(-b * x / c, y0, y1)
        q.append(a * x * x + 2 * b * x * y + c * y * y)
    for y in (y0, y1):
        x = np.clip(-b * y / a, x0, x1)
        q.append(a * x * x + 2 * b * x * y + c * y * y)
    return np.min(q, axis=0)


def met_boxes(splats: Splats, camera: Camera, left, top, width: int, height: int, min_alpha=1 / 255) -> np.ndarray:
    """[N, boxes] whether a primitive's level set (either one) meets the rectangle spanned by a box's pixel centres.

    Each plane that may cut one off may make it 1 + e^-4 times as opaque.
    """
    p = reference.project(splats, camera)
    min_alpha /= (1 + np.exp(-4)) ** sum(len(getattr(splats, plane.index)) > 0 for plane in PLANES)
    met = np.zeros((splats.n_splats, len(left)), bool)
    for i in np.flatnonzero(p.visible).tolist():
        x0, y0 = left + 0.5 - p.means2d[i, 0], top + 0.5 - p.means2d[i, 1]
        for opacity, conic in ((p.opacities[i], p.conics[i]), (p.pseudo_opacities[i], p.pseudo_conics[i])):
            if opacity >= min_alpha:
                q = _smallest_in_box(conic, x0, y0, x0 + width - 1, y0 + height - 1)
                met[i] |= q <= 2 * np.log(opacity / min_alpha)
    return met


def minimal_lists(splats: Splats, camera: Camera, min_alpha=1 / 255) -> list[set[int]]:
    """Per tile the primitives that meet it."""
    grid, b = grid_of(camera), grid_of(camera).blocks
    tile_y, tile_x = np.divmod(np.arange(grid.n_tiles), grid.tiles_x)
    met = met_boxes(splats, camera, tile_x * b.tile_width, tile_y * b.tile_height, b.tile_width, b.tile_height,
                    min_alpha)
    return [set(np.flatnonzero(column).tolist()) for column in met.T]


def assert_lanes_complete_and_tight(splats: Splats, camera: Camera):
    """Each lane is told of the primitives that meet its block of pixels, and of few others."""
    lists, grid, b = engine_tiles(splats, camera), grid_of(camera), grid_of(camera).blocks
    found = lanes_of_isects(lists, grid)
    tile = np.repeat(np.arange(grid.n_tiles), lists.end.numpy() - lists.begin.numpy())
    tile_y, tile_x = np.divmod(np.arange(grid.n_tiles), grid.tiles_x)
    lane_y, lane_x = np.divmod(np.arange(b.lanes_per_tile), b.lanes_x)
    left = tile_x[:, None] * b.tile_width + lane_x * b.stride_x
    top = tile_y[:, None] * b.tile_height + lane_y * b.stride_y
    met = met_boxes(splats, camera, left.ravel(), top.ravel(), b.width, b.height)
    met = met.reshape(-1, grid.n_tiles, b.lanes_per_tile)[lists.splat_from_isect.numpy(), tile]
    assert not (met & ~found).any()
    assert 0 < found.sum() <= 1.03 * met.sum(), f"{found.sum()} of lanes, {met.sum()} would do"


def assert_complete_and_tight(splats: Splats, camera: Camera):
    ours, minimal = engine_lists(splats, camera), minimal_lists(splats, camera)
    for got, least in zip(ours, minimal, strict=True):
        assert len(set(got.tolist())) == len(got)
        assert least <= set(got.tolist())
    total, least = sum(map(len, ours)), sum(map(len, minimal))
    assert least > 0
    assert total <= 1.02 * least, f"{total} isects, {least} would do"
    assert_lanes_complete_and_tight(splats, camera)


CUT_SHARES = [(0, 0), (0.5, 0), (0, 0.5), (0.5, 0.5)]  # by the first plane and by the second
SIZES = [(64, 48), (1, 1), (1, 40), (37, 23), (130, 70)]


@pytest.mark.parametrize("dog_share", [0, 0.5])
@pytest.mark.parametrize("width, height", SIZES)
@pytest.mark.parametrize("cut_shares", CUT_SHARES)
def test_lists_hold_all_that_is_seen_in_depth_order(width, height, dog_share, cut_shares):
    splats = rounded(random_splats(120, 1, 3, dog_share, 0, *cut_shares))
    camera = tilted_camera(width, height, cx=0.4 * width, cy=0.7 * height)
    ours, twin = engine_lists(splats, camera), reference_lists(splats, camera)
    assert any(len(indices) for indices in twin)
    for got, expected in zip(ours, twin, strict=True):
        np.testing.assert_array_equal(got[np.isin(got, expected)], expected)


@pytest.mark.parametrize("dog_share", [0, 0.5, 1])
@pytest.mark.parametrize("cut_shares", CUT_SHARES)
def test_lists_are_at_most_two_percent_longer_than_the_level_sets_ask_for(dog_share, cut_shares):
    splats = random_splats(500, 8, 0, dog_share, 0, *cut_shares)
    assert_complete_and_tight(rounded(splats), tilted_camera(400, 300, f=380.0))


def test_lists_of_needles_in_any_direction_are_complete_and_tight():
    splats = random_splats(300, seed=3, degree=0, dog_share=0.3)
    splats.log_scales = np.log([0.6, 1e-4, 1e-4]) + np.zeros((300, 3))
    assert_complete_and_tight(rounded(splats), tilted_camera(400, 300, f=380.0))


def test_a_speck_is_listed_where_it_reaches_a_pixel_centre_whichever_tile_border_it_lies_on():
    camera = make_camera(64, 64, f=64.0)
    px = np.linspace(14, 18, 41)  # around the border at 16
    x, y = (g.ravel() for g in np.meshgrid(px, px))
    splats = rounded(make_splats(np.stack([(x - 32) / 32, (y - 32) / 35.2, 0 * x + 2], -1), 1e-4, 0.9))
    ours, twin = engine_lists(splats, camera), reference_lists(splats, camera)
    for got, expected in zip(ours, twin, strict=True):
        assert set(expected.tolist()) <= set(got.tolist())
    assert_complete_and_tight(splats, camera)


@pytest.mark.parametrize("axis, short", [(0, 0), (1, 0), (1, SLACK)])
def test_a_speck_that_only_just_reaches_a_pixel_beyond_a_tile_border_is_listed_there(axis, short):
    """By less than float32 rounds its centre by: a primitive is rather listed in vain than missing. Where it is almost
    ``SLACK`` short of it, rounding may list the row of tiles and no tile in it."""
    camera, rng = make_camera(256, 256, f=256.0), np.random.default_rng(0)
    border, side, _ = (g.ravel() for g in np.meshgrid(16 * np.arange(1, 16), [-1, 1], np.arange(30)))
    reach = np.sqrt(2 * (LOW_PASS + (1e-4 * (256, 281.6)[axis] / 2) ** 2) * np.log(0.9 * 255)) + short
    across = border + side * (reach - 0.5 - rng.uniform(0, 4e-6, len(border)))
    along = rng.integers(0, 256, len(border)) + 0.5
    pixels = np.stack([across, along][:: 1 - 2 * axis], -1)
    means = (pixels - 128) / [camera.fx, camera.fy] * 2
    splats = rounded(make_splats(np.column_stack([means, np.full(len(means), 2.0)]), 1e-4, 0.9))
    for got, least in zip(engine_lists(splats, camera), minimal_lists(splats, camera), strict=True):
        assert least <= set(got.tolist())


def test_equal_depths_keep_the_order_of_their_indices():
    splats = rounded(make_splats([[0, 0, 2 + i % 2] for i in range(100)], 1.0))
    expected = np.r_[0:100:2, 1:100:2]
    for got in engine_lists(splats, make_camera()):
        np.testing.assert_array_equal(got, expected)


def test_depths_of_any_size_are_in_order_across_many_rows_of_tiles():
    """Tiles of 200 primitives that nearly all cover: from nearest to farthest some 2^40 apart, many at equal depths."""
    rng = np.random.default_rng(0)
    depths = 2.0 ** np.r_[rng.uniform(-10, 30, 100), rng.integers(-10, 30, 50), np.full(50, 3.0) + 2e-7 * np.arange(50)]
    splats, camera = rounded(make_splats(depths[:, None] * [0, 0, 1], depths[:, None])), make_camera(200, 420, f=200.0)
    projection = project(upload(splats), DeviceCamera.upload(camera, near_clip=1e-6), sh_degree=0)
    lists, exact = tiles(projection, grid_of(camera), HARD), splats.means[:, 2].astype(np.float32)
    begin, end, splat = (np.array(v) for v in (lists.begin, lists.end, lists.splat_from_isect))
    assert (end - begin > 150).all()
    for b, e in zip(begin, end, strict=True):
        listed = np.sort(splat[b:e])
        np.testing.assert_array_equal(splat[b:e], listed[np.argsort(exact[listed], kind="stable")])


def test_nothing_is_listed_where_nothing_is_visible():
    for splats in (make_splats([[0, 0, -2]] * 3), make_splats([[0, 0, 2]] * 3, opacities=0.9 / 255, dog=[1]),
                   make_splats([[50, 0, 2]] * 3), make_splats([[0, 0, 2]] * 3, opacities=1e-12)):
        assert not any(map(len, engine_lists(rounded(splats), make_camera())))


def test_a_faint_primary_is_listed_for_nothing_but_a_wide_pseudo_counts():
    camera = make_camera(160, 120, f=60.0)
    splats = rounded(make_splats([[0, 0, 2]], 0.1, 0.9, dog=[0], f_a=0.9, F=6.0))
    plain = rounded(make_splats([[0, 0, 2]], 0.1, 0.9))
    wide, narrow = (sum(map(len, engine_lists(s, camera))) for s in (splats, plain))
    assert wide > 2 * narrow
    assert_complete_and_tight(splats, camera)


def test_without_cutoffs_every_tile_lists_what_float32_can_see():
    splats = rounded(random_splats(40, seed=2, degree=0))
    camera = tilted_camera(130, 70)
    least = minimal_lists(splats, camera, min_alpha=2.0**-59)
    for got, expected in zip(engine_lists(splats, camera, SMOOTH), least, strict=True):
        assert expected <= set(got.tolist())


@pytest.mark.slow
def test_more_tiles_than_one_counting_pass_has_buckets_are_sorted_too():
    camera = make_camera(4096, 1100, f=900.0)
    assert grid_of(camera).n_tiles > 1 << 14
    splats = random_splats(60, seed=5, degree=0)
    splats.means[:, 0] *= 3
    assert_complete_and_tight(rounded(splats), camera)
    depths = reference.project(rounded(splats), camera).depths
    for got in engine_lists(rounded(splats), camera):
        assert (np.diff(depths[got]) >= 0).all()


def test_lists_of_many_tiles_are_in_depth_order():
    """2200 tiles or more, and 146,000 isects: a single counting pass keeps no order of so many on CUDA."""
    camera, rng = make_camera(800, 704, f=650.0), np.random.default_rng(1)
    splats = rounded(make_splats(rng.uniform([-1.1, -0.9, 2], [1.1, 0.9, 3], (24_000, 3)), 0.0145))
    lists = engine_tiles(splats, camera)
    begin, end, splat = (np.array(v) for v in (lists.begin, lists.end, lists.splat_from_isect))
    assert len(begin) >= 2200 and len(splat) > 110_000  # and more than Dr.Jit gives 32 warps to each multiprocessor
    depths = reference.project(splats, camera).depths[splat]
    tile = np.repeat(np.arange(len(begin)), end - begin)
    nearer = np.diff(depths) < 0
    assert not nearer[np.diff(tile) == 0].any()


def test_lists_do_not_carry_derivatives():
    params = upload(rounded(random_splats(20, degree=0)))
    dr.enable_grad(params["means"])
    camera = make_camera()
    projection = project(params, DeviceCamera.upload(camera), sh_degree=0)
    lists = tiles(projection, grid_of(camera), HARD)
    assert not dr.is_diff_v(lists.begin)
    assert dr.grad_enabled(projection.x)
