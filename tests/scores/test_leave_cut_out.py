"""What a cut is worth, by either plane: the energy of the change of real pictures, with it and without."""

from dataclasses import replace

import numpy as np
import pytest
from cameras_around import cameras_around
from cut_models import with_cuts, with_second_cuts
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.scene.row_groups import CUTS, SECOND_CUTS, RowGroup
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.score import ScoreRule, energies
from mi_dogsplat.scores.training_views import TrainingViews
from splat_scenes import image_of, options, random_splats, rasterized, rounded

CAMERAS = cameras_around(1.2, 4, 64, 48, 50.0)
RULES = {
    CUTS.index: ScoreRule("leave-cut-out", spectral_weight=0),
    SECOND_CUTS.index: ScoreRule("leave-second-cut-out", spectral_weight=0),
}
by_plane = pytest.mark.parametrize("plane", [CUTS, SECOND_CUTS], ids=["first", "second"])


def scored(splats: Splats, plane: RowGroup, background: float) -> np.ndarray:
    cameras = [DeviceCamera.upload(camera) for camera in CAMERAS]
    return energies(RULES[plane.index], upload(splats), TrainingViews(cameras, options(splats), background), 0)[0]


def measured(splats: Splats, plane: RowGroup, i: int, background: float) -> float:
    """Energy of the change of all pictures when that plane does not cut primitive i off."""
    stay = getattr(splats, plane.index) != i
    whole = replace(splats, **{name: getattr(splats, name)[stay] for name in (plane.index, *plane.names)})
    energy = 0.0
    for camera in CAMERAS:
        pictures = [image_of(rasterized(s, camera), camera, [background] * 3) for s in (splats, whole)]
        energy += float(np.square(pictures[0].astype(np.float64) - pictures[1]).sum())
    return energy


@pytest.mark.parametrize("background", [0.0, 1.0])
@pytest.mark.parametrize("dog_share", [0.0, 0.6])
@pytest.mark.parametrize("beside", [False, True])
@by_plane
def test_it_is_the_energy_of_pictures_in_which_the_plane_does_not_cut_a_primitive_off(
    plane, beside, dog_share, background
):
    """``beside``: the other plane cuts some of these off, too, and some others."""
    splats = rounded(random_splats(14, seed=7, degree=0, dog_share=dog_share))  # few: no walk ends early
    if beside or plane is CUTS:
        splats = with_cuts(splats, every=2 if plane is CUTS else 3)
    if beside or plane is SECOND_CUTS:
        splats = with_second_cuts(splats, every=2 if plane is SECOND_CUTS else 3)
    index, found = getattr(splats, plane.index), scored(splats, plane, background)
    expected = np.array([measured(splats, plane, int(i), background) for i in index])
    assert (expected > 0.01).sum() >= 5
    np.testing.assert_allclose(found[index], expected, rtol=2e-3, atol=1e-4 * expected.max())
    others = np.setdiff1d(np.arange(14), index)
    assert found[others].max() < 1e-6 * expected.max()


@by_plane
def test_without_such_cuts_it_is_nothing(plane):
    whole = rounded(random_splats(14, seed=7, degree=0))
    other = with_cuts(whole) if plane is SECOND_CUTS else with_second_cuts(whole)
    assert not scored(whole, plane, 0.5).any()
    assert scored(other, plane, 0.5).max() < 1e-12
