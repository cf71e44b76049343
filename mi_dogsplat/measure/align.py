"""The pose from which a model fits a photograph best: what test views are aligned by, the model being fixed.

Where poses are refined in training, those of the test views keep the errors that they came with, and the model may have
moved along with the training views. So BARF (Lin et al. 2021) also measures test views from
the pose that fits them best, beside their own. It is another figure and has another name, ``aligned_psnr``: the test
photograph has been looked at.

Least squares over six numbers (``scene/camera_motions.py``) by Levenberg and Marquardt, with differences of renders for
derivatives: so anything can be aligned that renders. Blurred pictures first, since a picture says where to go only as
far as it is smooth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter

from ..datasets.dataset import View
from ..render.picture import Picture, photograph, seen_as
from ..scene.camera_motions import moved_w2c
from .metrics import masked, psnr

BLURS = (1 / 50, 1 / 100, 1 / 200, 0.0)  # standard deviations, parts of the longer side
STEPS = 3  # at each
DIFFERENCE = 1e-3  # radians, and parts of the extent
DAMPING, TRIES = 1e-4, 4  # of the diagonal; ten times more after each step that makes it worse


def aligned(
    picture: Callable[[View], Picture],
    view: View,
    background: float,
    extent: float,
    mask: np.ndarray | None = None,
) -> View:
    """The view from where ``picture`` fits its photograph best, near to where it is.

    Args:
        picture: renders a view.
        view: the photograph.
        background: grey level behind an image with alpha.
        extent: of the cameras, world units: the unit of shifts.
        mask: [H, W] above 0 where a pixel counts; None: all of them.
    """
    truth = photograph(view, background)

    def moved(motion: np.ndarray) -> View:
        w2c = moved_w2c(view.camera.w2c[None], motion[None], extent)[0]
        return replace(view, camera=replace(view.camera, w2c=w2c))

    def seen(other: View) -> np.ndarray:
        return seen_as(picture(other), other)

    def difference(motion: np.ndarray) -> np.ndarray:
        return masked(seen(moved(motion)), truth, mask) - truth

    best = np.zeros(6)
    for blur in BLURS:
        best = _fitted(difference, best, blur * max(truth.shape[:2]))
    found = moved(best)
    gain = psnr(seen(found), truth, mask) - psnr(seen(view), truth, mask)
    return found if gain > 0 else view


def _fitted(difference: Callable[[np.ndarray], np.ndarray], motion: np.ndarray, sigma: float) -> np.ndarray:
    """The motion [6] after a few steps towards the least squares of a blurred ``difference``."""

    def residual(motion: np.ndarray) -> np.ndarray:
        pixels = difference(motion)
        return (gaussian_filter(pixels, (sigma, sigma, 0)) if sigma else pixels).ravel()

    r, damping = residual(motion), DAMPING
    for _ in range(STEPS):
        steps = DIFFERENCE * np.eye(6)
        J = np.stack([(residual(motion + step) - r) / DIFFERENCE for step in steps], -1).astype(np.float64)
        H, g = J.T @ J, J.T @ r
        for _ in range(TRIES):
            damped = H + np.diag(damping * np.diag(H) + 1e-12 * np.trace(H) + 1e-30)
            other = motion - np.linalg.solve(damped, g)
            r_other = residual(other)
            if r_other @ r_other < r @ r:
                motion, r, damping = other, r_other, damping / 10
                break
            damping *= 10
        else:
            break
    return motion
