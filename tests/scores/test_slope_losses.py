"""What slopes contribute, an estimate, against pictures with and without them in float64."""

from dataclasses import replace

import numpy as np
import pytest
from cameras_around import cameras_around
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.slope_losses import slope_losses
from splat_scenes import image_of, make_splats, options, random_splats, rasterized, rounded

CAMERAS = cameras_around(1.2, 5, 96, 72, 80.0)


def estimated(splats: Splats) -> np.ndarray:
    return slope_losses(upload(splats), [DeviceCamera.upload(camera) for camera in CAMERAS], options(splats))


def measured(splats: Splats, i: int) -> float:
    """Energy of the change of all pictures without the slopes of primitive i."""
    stay = splats.slope_index != i
    without = replace(splats, slope_index=splats.slope_index[stay], color_slopes=splats.color_slopes[stay])
    pairs = [[image_of(rasterized(s, c), c).astype(np.float64) for s in (splats, without)] for c in CAMERAS]
    return float(sum(np.square(a - b).sum() for a, b in pairs))


@pytest.mark.parametrize("scales", [(0.3, 0.3, 0.3), (0.4, 0.2, 0.1), (0.4, 0.4, 0.01), (0.5, 0.05, 0.05)])
@pytest.mark.parametrize("axis", [0, 1, 2, None])
def test_of_one_primitive_it_is_the_energy_of_the_change(scales, axis):
    one = rounded(make_splats([[0.1, -0.1, 3]], scales, 0.6, 0.5, [[0.3, -0.2, 0.4, 0.8]]))
    slopes = np.random.default_rng(1).normal(0, 0.2, (1, 3, 3))
    if axis is not None:
        slopes[:, np.arange(3) != axis] = 0
    sloped = replace(one, slope_index=[0], color_slopes=slopes)
    assert estimated(sloped)[0] == pytest.approx(measured(sloped, 0), rel=0.02)


@pytest.mark.parametrize("cut_shares", [(0, 0), (0.5, 0), (0.5, 0.5)])
def test_among_others_it_orders_primitives_as_their_changes_do(cut_shares):
    splats = rounded(random_splats(24, 4, 1, 0.3, 0.8, *cut_shares))
    found = estimated(splats)
    has = np.isin(np.arange(24), splats.slope_index)
    assert not found[~has].any()
    expected = np.array([measured(splats, int(i)) for i in splats.slope_index])
    seen = expected > 1e-3 * expected.max()
    ratio = found[splats.slope_index][seen] / expected[seen]
    assert seen.sum() > 10 and np.median(ratio) == pytest.approx(1, abs=0.25)
    assert np.corrcoef(np.log(found[splats.slope_index][seen]), np.log(expected[seen]))[0, 1] > 0.95
