"""What a cut is worth: the energy of the change of real pictures, with it and without."""

from dataclasses import replace

import numpy as np
import pytest
from cameras_around import cameras_around
from cut_models import with_cuts
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.score import ScoreRule, energies
from splat_scenes import image_of, options, random_splats, rasterized, rounded

CAMERAS = cameras_around(1.2, 4, 64, 48, 50.0)
RULE = ScoreRule("leave-cut-out", spectral_weight=0)


def scored(splats: Splats, background: float) -> np.ndarray:
    cameras = [DeviceCamera.upload(camera) for camera in CAMERAS]
    return energies(RULE, upload(splats), cameras, options(splats), background, 0)[0]


def measured(splats: Splats, i: int, background: float) -> float:
    """Energy of the change of all pictures when primitive i is whole."""
    stay = splats.cut_index != i
    whole = replace(splats, cut_index=splats.cut_index[stay], cut_normals=splats.cut_normals[stay])
    energy = 0.0
    for camera in CAMERAS:
        pictures = [image_of(rasterized(s, camera), camera, [background] * 3) for s in (splats, whole)]
        energy += float(np.square(pictures[0].astype(np.float64) - pictures[1]).sum())
    return energy


@pytest.mark.parametrize("background", [0.0, 1.0])
@pytest.mark.parametrize("dog_share", [0.0, 0.6])
def test_leave_cut_out_is_the_energy_of_pictures_in_which_a_primitive_is_whole(background, dog_share):
    splats = with_cuts(rounded(random_splats(14, seed=7, degree=0, dog_share=dog_share)))  # few: no walk ends early
    found = scored(splats, background)
    expected = np.array([measured(splats, int(i), background) for i in splats.cut_index])
    assert (expected > 0.01).sum() >= 5
    np.testing.assert_allclose(found[splats.cut_index], expected, rtol=2e-3, atol=1e-4 * expected.max())
    others = np.setdiff1d(np.arange(14), splats.cut_index)
    assert found[others].max() < 1e-6 * expected.max()


def test_without_cuts_it_is_nothing():
    assert not scored(rounded(random_splats(14, seed=7, degree=0)), 0.5).any()
