"""What slopes and curvatures contribute, estimates, against pictures with and without them in float64."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cameras_around import cameras_around
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.slope_losses import curvature_losses, slope_losses
from mi_dogsplat.scores.training_views import TrainingViews
from own_axes_models import CURVED, PLANE_KINDS, SLOPED, Kind
from row_kinds import of_each
from splat_scenes import image_of, make_splats, options, random_splats, rasterized, rounded

CAMERAS = cameras_around(1.2, 5, 96, 72, 80.0)


EACH = of_each(SLOPED, CURVED)


def estimated(splats: Splats, kind: Kind) -> np.ndarray:
    losses = {"slopes": slope_losses, "curvatures": curvature_losses}[kind.word]
    on_device = [DeviceCamera.upload(camera) for camera in CAMERAS]
    return losses(upload(splats), TrainingViews(on_device, options(splats)))


def measured(splats: Splats, kind: Kind, i: int) -> float:
    """Energy of the change of all pictures without those of primitive i, which keeps its average brightness."""
    stay, sh = kind.index(splats) != i, splats.sh_coeffs.copy()
    if kind is CURVED:
        sh[i] = splats.without_curvatures().sh_coeffs[i]
    rows = {kind.group.index: kind.index(splats)[stay], kind.name: kind.values(splats)[stay]}
    without = replace(splats, sh_coeffs=sh, **rows)
    pairs = [[image_of(rasterized(s, c), c).astype(np.float64) for s in (splats, without)] for c in CAMERAS]
    return float(sum(np.square(a - b).sum() for a, b in pairs))


@pytest.mark.parametrize("scales", [(0.3, 0.3, 0.3), (0.4, 0.2, 0.1), (0.4, 0.4, 0.01), (0.5, 0.05, 0.05)])
@pytest.mark.parametrize("axis", [0, 1, 2, None])
@EACH
def test_of_one_primitive_it_is_the_energy_of_the_change(scales, axis, kind: Kind):
    one = make_splats([[0.1, -0.1, 3]], scales, 0.6, 0.5, [[0.3, -0.2, 0.4, 0.8]])
    values = np.random.default_rng(1).normal(0, 0.2, kind.shape)
    if axis is not None:
        values[np.arange(len(values)) != axis] = 0
    some = rounded(kind.given(one, values))
    assert estimated(some, kind)[0] == pytest.approx(measured(some, kind, 0), rel=0.02)


@pytest.mark.parametrize("cut_shares", [(0, 0), (0.5, 0), (0.5, 0.5)])
@EACH
def test_among_others_it_orders_primitives_as_their_changes_do(cut_shares, kind: Kind):
    of_planes = zip(PLANE_KINDS, cut_shares, strict=True)
    shares: dict[str, Any] = {kind.share: 0.8} | {plane.share: share for plane, share in of_planes}
    splats = rounded(random_splats(24, 4, 1, 0.3, **shares))
    found, index = estimated(splats, kind), kind.index(splats)
    assert not found[~np.isin(np.arange(24), index)].any()
    expected = np.array([measured(splats, kind, int(i)) for i in index])
    seen = expected > 1e-3 * expected.max()
    ratio = found[index][seen] / expected[seen]
    assert seen.sum() > 10 and np.median(ratio) == pytest.approx(1, abs=0.25)
    likeness = np.corrcoef(np.log(found[index][seen]), np.log(expected[seen]))[0, 1]
    assert likeness > {"slopes": 0.95, "curvatures": 0.85}[kind.word]  # of these the rim counts more, which others hide
