"""Stage 3 against its float64 twin: blending of lists, and what strains float32 and the shared exponentials."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import SMOOTH, Blocks, Cutoffs, Grid
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.tiles import TileLists
from mi_dogsplat.engine.view import arrange
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from splat_scenes import constant_layers, make_camera, make_splats, random_splats, rounded, tilted_camera

HARD = Cutoffs()


def engine(splats: Splats, camera: Camera, features=None, cutoffs=HARD, negative_transmittance=True,
           lists=None) -> tuple[np.ndarray, np.ndarray]:
    """Blended features [H, W, C] and T [H, W]."""
    projection = project(upload(splats), DeviceCamera.upload(camera), sh_degree=splats.sh_degree)
    grid = Grid.of(camera.width, camera.height, Blocks.of_backend())
    rows = projection.colors if features is None else [mi.Float(f.astype(np.float32)) for f in features.T]
    chosen = RasterOptions(cutoffs=cutoffs, negative_transmittance=negative_transmittance)
    view = arrange(projection, rows, grid, chosen)
    blended = composite(replace(view, lists=lists) if lists else view)
    shape = camera.height, camera.width
    return np.stack([p.numpy().reshape(shape) for p in blended.features], -1), blended.T.numpy().reshape(shape)


def assert_same(splats: Splats, camera: Camera, tolerance=1e-5, mean=2e-5, **choices):
    image, T = engine(splats, camera, **choices)
    expected, expected_T, _ = reference.render(
        splats, camera, negative_transmittance=choices.get("negative_transmittance", True),
        smooth=choices.get("cutoffs") is SMOOTH)
    for name, ours, twin in (("image", image, expected), ("T", T, expected_T)):
        error = np.abs(ours - twin)
        assert error.mean() < mean, f"{name}: mean error {error.mean():.2g}"
        # A pixel on a cutoff may fall on its other side: one level out of 255 at most, and rarely.
        beyond = error > tolerance * np.maximum(1, np.abs(twin))
        assert beyond.mean() < 1e-3, f"{name}: {beyond.sum()} of {beyond.size} values, largest {error.max():.2g}"
        assert error.max() < 1.5 / 255


@pytest.mark.parametrize("dog_share", [0, 0.5, 1])
@pytest.mark.parametrize("negative_transmittance", [True, False])
def test_random_scenes_blend_as_in_the_twin(dog_share, negative_transmittance):
    splats = random_splats(150, seed=11, degree=0, dog_share=dog_share)
    assert_same(rounded(splats), tilted_camera(), negative_transmittance=negative_transmittance)


@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_without_cutoffs_random_scenes_blend_as_in_the_smooth_twin(dog_share):
    splats = rounded(random_splats(100, seed=12, degree=0, dog_share=dog_share))
    assert_same(splats, tilted_camera(), cutoffs=SMOOTH)


def test_specks_at_any_place_within_a_pixel_keep_their_value():
    """0.3 px² is the narrowest kernel there is: the largest steps from pixel to pixel."""
    camera, rng = make_camera(64, 48, f=60.0), np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(2, 62, 6.1), np.arange(2, 46, 6.1))
    x, y = x.ravel() + rng.uniform(0, 1, x.size), y.ravel() + rng.uniform(0, 1, x.size)
    means = np.stack([(x - 32) / 60 * 2, (y - 24) / 66 * 2, 0 * x + 2], -1)
    assert_same(rounded(make_splats(means, 1e-6, 0.98)), camera)


def test_needles_at_any_angle_keep_their_value():
    angle = np.linspace(0, np.pi, 40, endpoint=False)
    quats = np.stack([0 * angle, 0 * angle, np.sin(angle / 2), np.cos(angle / 2)], -1)
    means = np.column_stack([0.01 * np.cos(7 * angle), 0.01 * np.sin(5 * angle), np.linspace(1.5, 2, 40)])
    splats = make_splats(means, (0.8, 1e-5, 1e-5), 0.6, quats=quats)
    assert_same(rounded(splats), make_camera(130, 70), tolerance=1e-4)


def test_kernels_far_larger_than_the_image_keep_their_value():
    splats = make_splats([[0, 0, 2], [300, -200, 900], [-90, 10, 50]], [[20], [300], [60]], [0.3, 0.9, 0.5],
                         [[0.1, 0.5, 0.9], [1, 0, 0], [0, 1, 0]], dog=[0, 2])
    assert_same(rounded(splats), make_camera())


def test_a_stack_of_opaque_layers_stops_where_the_twin_stops():
    n = 60
    means = np.column_stack([np.zeros((n, 2)), np.linspace(1, 4, n)])
    for opacity in (0.5, 0.9, 0.989, 0.9999):
        splats = make_splats(means, 0.3, opacity, np.random.default_rng(0).uniform(size=(n, 3)))
        assert_same(rounded(splats), make_camera())


def test_saturated_kernels_are_limited_to_99_percent_each():
    plain, dog = make_splats([0, 0, 2], 1e4, 0.9999), make_splats([0, 0, 2], 1e4, 0.9999, dog=[0], f_a=0.5)
    np.testing.assert_allclose(engine(rounded(plain), make_camera())[0], 0.99, rtol=1e-6)
    np.testing.assert_allclose(engine(rounded(dog), make_camera())[0], 0.99 - 0.9999 / 2, rtol=1e-5)
    both = make_splats([0, 0, 2], 1e4, 0.9999, dog=[0], f_a=0.9999)
    assert not engine(rounded(both), make_camera())[0].any()


def test_a_ring_raises_T_above_one_unless_negative_transmittance_is_off():
    splats, camera = rounded(make_splats([0, 0, 2], 0.2, 0.9, dog=[0])), make_camera()
    image, T = engine(splats, camera)
    assert T.max() > 1.05
    np.testing.assert_allclose(T, 1 - image[..., 0], atol=1e-6)
    off, T_off = engine(splats, camera, negative_transmittance=False)
    np.testing.assert_allclose(off, image, atol=1e-7)
    np.testing.assert_allclose(T_off, 1 - np.maximum(image[..., 0], 0), atol=1e-6)


def test_a_stack_of_negative_lobes_ends_before_T_is_too_large():
    splats, camera = rounded(constant_layers([-0.4] * 80)), make_camera(20, 18)
    image, T = engine(splats, camera)
    expected, expected_T, _ = reference.render(splats, camera)
    assert 2.0**29 < T.max() < 2.0**30
    np.testing.assert_allclose(T, expected_T, rtol=1e-3)
    np.testing.assert_allclose(image, expected, rtol=1e-3)


@pytest.mark.parametrize("count", [1, 2, 4, 7])
def test_any_number_of_features_is_blended_like_colours(count):
    splats, camera = rounded(random_splats(60, degree=0)), tilted_camera()
    features = np.random.default_rng(1).normal(size=(60, count)).astype(np.float32)
    p = reference.project(splats, camera)
    expected, expected_T, _ = reference.composite(p, [reference.depth_order(p)], 64, 48, [0] * count,
                                                  features=features, tile_width=64, tile_height=48)
    image, T = engine(splats, camera, features)
    assert np.abs(image - expected).mean() < 2e-5 and np.abs(T - expected_T).mean() < 2e-5


def test_lists_may_end_anywhere_within_an_unrolled_iteration():
    """Isects behind the end of a tile's list belong to the next tile: they must not show."""
    camera = make_camera(64, 48)
    for n in range(1, 10):
        splats = make_splats(np.column_stack([np.zeros((n, 2)), 1 + np.arange(n)]), 1e4, 0.1)
        image, T = engine(rounded(splats), camera)
        np.testing.assert_allclose(T, 0.9**n, rtol=1e-5)
        np.testing.assert_allclose(image[..., 0], 1 - 0.9**n, rtol=1e-5)


def test_empty_lists_leave_the_image_black_and_transparent():
    camera = make_camera(37, 23)
    grid, UInt = Grid.of(37, 23, Blocks.of_backend()), array_types().UInt
    nothing = dr.zeros(UInt, grid.n_tiles)
    lists = TileLists(dr.zeros(UInt, 1), nothing, nothing, *(dr.zeros(UInt, 1) for _ in range(4)))
    image, T = engine(rounded(make_splats([0, 0, 2])), camera, lists=lists)
    assert not image.any() and (T == 1).all()


def test_pixels_beyond_the_border_of_the_image_do_not_keep_a_walk_alive_or_write():
    splats = rounded(random_splats(100, seed=3, degree=0))
    whole = tilted_camera(64, 48)
    image, T = engine(splats, whole)
    for width, height in ((17, 1), (1, 33), (50, 31)):
        camera = Camera(whole.w2c, whole.fx, whole.fy, whole.cx, whole.cy, width, height)
        # The clamp of the linearisation depends on the image size: keep it out by primitives that are inside.
        p = reference.project(splats, whole)
        inner = (p.means2d > 8).all(1) & (p.means2d < [40, 30]).all(1)
        part, part_T = engine(splats.select(inner), camera)
        expected, expected_T, _ = reference.render(splats.select(inner), camera)
        assert np.abs(part - expected).mean() < 2e-5 and np.abs(part_T - expected_T).mean() < 2e-5
        assert part.shape == (height, width, 3)


def test_walks_take_all_rounds_whatever_the_flags_of_drjit():
    """Where its own loops are evaluated, too: with as many rounds as a view of fewer primitives needs, the other one
    would lack those behind."""
    few, many = (rounded(random_splats(n, seed=14, degree=0, dog_share=0.5)) for n in (5, 150))
    expected = engine(many, make_camera())
    with dr.scoped_set_flag(dr.JitFlag.SymbolicLoops, False):
        engine(few, make_camera())
        found = engine(many, make_camera())
    assert all(map(np.array_equal, found, expected))
