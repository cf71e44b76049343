"""Energies of pictures that are seen through a tone curve, against float64 pictures one by one."""

from dataclasses import replace

import numpy as np
from hdr_data import bright_truth
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.reference import render
from mi_dogsplat.reference.score import weights
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.bands import bands
from mi_dogsplat.scores.score import ScoreRule, energies
from mi_dogsplat.scores.squared_weights import squared_weights
from mi_dogsplat.scores.training_views import TrainingViews
from mi_dogsplat.support.srgb import linear_to_srgb_log
from mi_dogsplat.training.images.tone_curve import SrgbLog
from tiny_data import HEIGHT, WIDTH, cameras

BACKGROUND = 0.25
OPTIONS = RasterOptions(sh_degree=1)
VIEWS = cameras(3)


def model() -> Splats:
    splats = bright_truth()
    splats.sh_coeffs[:, 0] = np.abs(splats.sh_coeffs[:, 0]) + 0.5  # no colour is below 0, in no direction
    splats.sh_coeffs[:, 1:] *= 0.1
    return splats


def mask(view: int) -> np.ndarray | None:
    return None if view == 1 else (np.indices((HEIGHT, WIDTH)).sum(0) % 3 > 0).astype(np.float32)


def picture(splats: Splats, view: int) -> np.ndarray:
    return render(splats, VIEWS[view], (BACKGROUND,) * 3, sh_degree=1)[0]


def weight(splats: Splats, view: int) -> np.ndarray:
    """[H, W] of a squared change: the slope by differences, squared, where a pixel counts."""
    x, h = picture(splats, view), 1e-6
    slope = ((linear_to_srgb_log(x * (1 + h)) - linear_to_srgb_log(x * (1 - h))) / (2 * h * x)).mean(-1)
    shown = mask(view)
    return slope**2 if shown is None else slope**2 * shown


def energy(splats: Splats, other: Splats) -> float:
    """Of the change from one model to another, over all views."""
    changes = [picture(splats, v) - picture(other, v) for v in range(len(VIEWS))]
    return sum(float(np.sum(weight(splats, v)[..., None] * change**2)) for v, change in enumerate(changes))


def test_removals_and_bands_of_colour_count_what_is_seen_through_the_curve():
    splats, on_device = model(), [DeviceCamera.upload(camera, 0.2) for camera in VIEWS]
    params, views = upload(splats), TrainingViews(on_device, OPTIONS, BACKGROUND, mask, SrgbLog())
    for view, camera in enumerate(VIEWS):
        squares = np.square(weights(splats, camera)[0])  # [N, H, W]
        expected = (weight(splats, view) * squares).sum((1, 2))
        np.testing.assert_allclose(squared_weights(params, views, view).numpy(), expected, rtol=2e-3)
    removal = energies(ScoreRule("leave-one-out", spectral_weight=0.0), params, views, 0)[0]
    without_bands = bands(params, splats.sh_coeffs, views)
    lost = without_bands.losses()[:, 0]
    flat = without_bands.fitted(np.zeros(splats.n_splats, int))
    chosen = np.argsort(-removal)[:5]
    for i in chosen:
        other = splats.select(np.delete(np.arange(splats.n_splats), i))
        np.testing.assert_allclose(removal[i], energy(splats, other), rtol=1e-2)
        coeffs = splats.sh_coeffs.copy()
        coeffs[i] = flat[i]
        np.testing.assert_allclose(lost[i], energy(splats, replace(splats, sh_coeffs=coeffs)), rtol=1e-2)
