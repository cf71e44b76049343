"""The importance scores once more, by brute force in float64 NumPy: whole footprint images, whole Fourier transforms.

Nothing here shares a formula with ``walks/score.py``. The footprint J_i is a difference of two images, with α_i set
to 1 and to 0; that of a removal is a difference of two renders; spectra come from the matrix of the discrete Fourier
transform.

Images are [H, W], frequencies are in radians per pixel, 2π k / H and 2π l / W.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .forward import colors_at, depth_order, pixel_centres, render, walk
from .projection import project

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats


def footprints(
    splats: Splats,
    camera: Camera,
    background: Sequence[float] | np.ndarray = (0, 0, 0),
    *,
    negative_transmittance: bool = True,
    clamped: bool = False,
    **options,
) -> np.ndarray:
    """J_i(p) = o_i d(sum over the channels of the image) / d alpha_i, images [N, H, W]; `options` go to `project`.

    Of the image clamped to [0, 1] if `clamped`: without the channels that are beyond, in each pixel. 0 where the
    primitive is not blended. The image is affine in each alpha while its sign is the same, so a difference is the
    derivative; where transmittance ignores negative alphas it starts at 0 and -1 for these. All other alphas, and the
    ends of the walks, stay.
    """
    projection = project(splats, camera, **options)
    order, (x, y) = depth_order(projection), pixel_centres(0, 0, camera.width, camera.height)
    alphas, result = np.zeros((2, len(projection.depths), len(x)))
    for meeting in walk(projection, order, x, y, negative_transmittance=negative_transmittance):
        alphas[meeting.splat] = np.where(meeting.goes_on, meeting.alpha, 0)
    shown = np.ones((len(x), 3))
    colors = {j: colors_at(projection, j, x, y) for j in order}  # for all of the images

    def image(i: int, alpha: np.ndarray) -> np.ndarray:
        """[P, 3] with this alpha [P] of primitive i in place of its own; as it is with i = -1."""
        total, T = np.zeros((alphas.shape[1], 3)), np.ones((alphas.shape[1], 1))
        for j in order:
            a = (alpha if j == i else alphas[j])[:, None]
            total += colors[j] * a * T
            T = T * (1 - (a if negative_transmittance else np.maximum(a, 0)))
        return total + T * np.asarray(background)

    if clamped:
        shown = (np.abs(image(-1, np.zeros(0)) - 0.5) <= 0.5) * 1.0

    def summed_image(i: int, alpha: np.ndarray) -> np.ndarray:
        return (image(i, alpha) * shown).sum(1)

    for i in order:
        end = np.ones(alphas.shape[1])
        if not negative_transmittance:
            end = np.where(alphas[i] < 0, -1.0, 1.0)
        derivative = (summed_image(i, end) - summed_image(i, np.zeros_like(end))) * end
        result[i] = np.where(alphas[i] != 0, projection.opacities[i] * derivative, 0)
    return result.reshape(-1, camera.height, camera.width)


def weights(splats: Splats, camera: Camera, **options) -> tuple[np.ndarray, np.ndarray]:
    """(alpha_i T_i, T_i) where primitive i is blended, else 0; images [N, H, W] each; `options` go to `project`."""
    projection, (x, y) = project(splats, camera, **options), pixel_centres(0, 0, camera.width, camera.height)
    weight, transmittance = np.zeros((2, len(projection.depths), len(x)))
    for meeting in walk(projection, depth_order(projection), x, y):
        weight[meeting.splat] = meeting.weight
        transmittance[meeting.splat] = np.where(meeting.goes_on & (meeting.alpha != 0), meeting.T, 0)
    return tuple(x.reshape(-1, camera.height, camera.width) for x in (weight, transmittance))  # type: ignore[return-value]


def removals(
    splats: Splats, camera: Camera, background: Sequence[float] | np.ndarray = (0, 0, 0), **options
) -> np.ndarray:
    """D_i = the render minus the render without primitive i, [N, H, W, 3]; `options` go to `render`."""
    image = render(splats, camera, background, **options)[0]
    everything = np.arange(splats.n_splats)
    others = [splats.select(np.delete(everything, i)) for i in everything]
    return np.stack([image - render(s, camera, background, **options)[0] for s in others])


def fourier(images: np.ndarray) -> np.ndarray:
    """Discrete Fourier transform of [..., H, W], not normalised, by its matrices."""

    def matrix(n: int) -> np.ndarray:
        k = np.arange(n)
        return np.exp(-2j * np.pi * np.outer(k, k) / n)

    return matrix(images.shape[-2]) @ images @ matrix(images.shape[-1])


def spectral_energy(images: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """sum of weight |F^|^2 / (H W) over the frequencies of images [..., H, W] -> [...]; weight 1: sum of squares."""
    return (weight * np.abs(fourier(images)) ** 2).mean((-2, -1))


def _angular_frequencies(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """omega_y [H, 1] and omega_x [1, W] in [-pi, pi]."""
    y, x = (2 * np.pi * np.arange(n) / n for n in (height, width))
    return np.where(y > np.pi, y - 2 * np.pi, y)[:, None], np.where(x > np.pi, x - 2 * np.pi, x)[None]


def power_weight(height: int, width: int, gamma_f: float) -> np.ndarray:
    """(|omega| / omega_corner)^gamma_f, [H, W]; 0 at the frequency 0."""
    y, x = _angular_frequencies(height, width)
    return (np.sqrt(x**2 + y**2) / (np.sqrt(2) * np.pi)) ** gamma_f


def difference_weight(height: int, width: int) -> np.ndarray:
    """4 sin^2(omega_x / 2) + 4 sin^2(omega_y / 2), [H, W]: the energy of the two forward differences."""
    y, x = _angular_frequencies(height, width)
    return 4 * np.sin(x / 2) ** 2 + 4 * np.sin(y / 2) ** 2


def gradient_energy(images: np.ndarray) -> np.ndarray:
    """`spectral_energy` with `difference_weight` of images [..., H, W] continued by reflection, per image.

    The reflected image [..., 2 H, 2 W] holds each image four times and has no edge at the border: differences are
    those of pixels inside.
    """
    rows = np.concatenate([images, images[..., ::-1, :]], -2)
    whole = np.concatenate([rows, rows[..., ::-1]], -1)
    return spectral_energy(whole, difference_weight(*whole.shape[-2:])) / 4


def filtered(images: np.ndarray, gamma_f: float) -> np.ndarray:
    """h * F of images [..., H, W], h the filter whose power is `power_weight`; periodic."""
    height, width = images.shape[-2:]
    spectrum = np.sqrt(power_weight(height, width, gamma_f)) * fourier(images)
    return np.real(fourier(spectrum.conj())) / (height * width)


def probe_variance(images: np.ndarray) -> np.ndarray:
    """Variance of s^2, s = <h * z, F> with random signs z, for footprints [..., C, H, W] of C channels; gamma_f is 1.

    s = <z, u> with u = h * F, so E[s^4] = 3 |u|^4 - 2 sum u_p^4 and Var[s^2] = 2 (|u|^4 - sum u_p^4).
    """
    u2 = filtered(images, 1.0) ** 2
    return 2 * (u2.sum((-3, -2, -1)) ** 2 - (u2**2).sum((-3, -2, -1)))
