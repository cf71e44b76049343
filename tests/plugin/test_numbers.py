"""Random numbers of light paths: even over the passes of a pixel, independent of each other otherwise."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.plugin.numbers import Streams
from mi_dogsplat.plugin.samples import samples
from mi_dogsplat.requests.gradual import means
from mi_dogsplat.requests.request import Request
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from splat_scenes import dog_dict, rounded, sensor_dict

PIXELS = 400


def drawn(count: int, segment=0, seed=3) -> np.ndarray:
    """[count, 4, PIXELS]: one number, one pair, and one number."""
    numbers = [Streams([one], PIXELS).at(dr.arange(mi.UInt32, PIXELS), segment) for one in samples(count, seed)]
    return np.array([[n.next_1d().numpy(), *n.next_2d().numpy(), n.next_1d().numpy()] for n in numbers], float)


def each_once(parts: np.ndarray) -> bool:
    """[count, PIXELS]: every pixel has each of 0 to count - 1."""
    return bool((np.sort(parts, 0) == np.arange(len(parts))[:, None]).all())


@pytest.mark.parametrize("bits", [3, 6])
def test_each_part_of_the_interval_and_of_the_square_has_one_value(bits):
    found = drawn(2**bits)
    assert found.min() >= 0 and found.max() < 1
    for number in found.swapaxes(0, 1):
        assert each_once((number * 2**bits).astype(int))
    x, y = found[:, 1], found[:, 2]
    for across in range(bits + 1):
        columns, rows = 2**across, 2 ** (bits - across)
        assert each_once((x * columns).astype(int) * rows + (y * rows).astype(int))


@pytest.mark.parametrize("count", [1, 5, 16])
def test_every_number_alone_is_uniform(count):
    """In each pass: tenths of the interval have as many pixels each, within five standard deviations."""
    for one in drawn(count).reshape(-1, PIXELS):
        tenths = np.bincount((one * 10).astype(int), minlength=10)
        assert np.abs(tenths - PIXELS / 10).max() < 5 * np.sqrt(PIXELS / 10)


@pytest.mark.parametrize("count", [1, 16])
def test_numbers_of_other_pixels_pairs_vertices_and_seeds_are_independent(count):
    """Correlations over the pixels are those of chance, of which the standard deviation is 1 / sqrt(PIXELS)."""
    first, vertex, seed = (drawn(count, *how)[:, :, :-1] for how in ((0, 3), (1, 3), (0, 4)))
    neighbour = drawn(count)[:, :, 1:]
    a, b, c, d = first[0]
    for one, other in ((a, b), (b, c), (a, d), (c, d), (a, vertex[0, 0]), (b, seed[0, 1]), (c, neighbour[0, 2])):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5 / np.sqrt(PIXELS)


@pytest.mark.parametrize("steps", [[16], [1, 2, 5, 8], [8, 8]])
def test_half_of_the_passes_go_through_what_is_half_there(steps):
    """A black mask of opacity 0.5 before the sky: each pixel has exactly half of its light, in steps as well.

    Also after a change of the variant, which makes another class of the integrator.
    """
    before = str(mi.variant())
    mi.set_variant("scalar_rgb")
    mi.set_variant(before)
    camera = Camera(np.eye(4), 9.0, 9.0, 3.0, 2.5, 6, 5)
    square = mi.ScalarTransform4f().translate([0, 0, 2]).rotate([0, 1, 0], 180).scale(9)
    black = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}}
    scene: Any = mi.load_dict({
        "type": "scene", "integrator": {"type": "dogpath"}, "sensor": sensor_dict(camera, pixel_format="rgba"),
        "splats": dog_dict(rounded(Splats.empty(1))), "sky": {"type": "constant"},
        "pane": {"type": "rectangle", "to_world": square, "bsdf": {"type": "mask", "opacity": 0.5, "bsdf": black}},
    })  # fmt: skip
    *_, (done, picture, _) = means(scene, scene.sensors()[0], Request(seed=4), steps)
    assert done == 16 and scene.integrator().first_pass is None
    np.testing.assert_allclose(picture[..., :3], 0.5, rtol=1e-5)
