"""Importance of primitives, the order in which pruning removes them (method paper, Sec. 3.2).

All rules but "opacity" sum over the training views and pixels what a primitive's footprint image F contributes
(``walks/score.py``: J, the derivative of the summed image by the kernel's value, D, the change of the image if the
primitive is removed, P, if a DoG primitive becomes its primary, or Q, if a primitive loses a cut):

    U_i = Σ F_i²                         spatial
    Uf_i = Σ_ω w(ω) |F̂_i(ω)|² / (H W)     spectral, w(ω) = (|ω| / ω_corner)^γ; w = 1 would give U_i (Parseval)
    score_i = λ_s U_i / ‖U‖₂ + λ_f Uf_i / ‖Uf‖₂

F is 0 where a mask says that a pixel does not count. ``released`` is the authors' code: U of the image clamped to [0,
1], whose derivative is 0 where a channel is clamped, with the weight of its ``band_pass_weight`` on each pixel; through
no tone curve.

Uf without N Fourier transforms. With h the filter whose frequency response is √w, Uf_i = ‖h * F_i‖². For white noise z
(independent signs) and ξ = h * z, the pixel sum s_i = Σ ξ F_i has E[s_i²] = Uf_i: one walk serves all primitives and
probes. Its variance is 2 (Uf_i² - Σ_p (h * F_i)(p)⁴): a single probe of a single view has a relative error of up to √2,
which falls as 1/√(probes x views). Or, without noise, for γ = 2: the energy of the gradient of F, see
``walks/score.Sums``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import drjit as dr
import numpy as np

from ..engine.arrays import array_types, detached
from ..engine.parameters import device_array
from ..engine.view import prepare_both
from ..engine.walks.composite import composite_over
from ..engine.walks.score import Sums, composite_score
from ..scene.opacity import sigmoid
from ..scene.row_groups import CUTS, PLANES, SECOND_CUTS, RowGroup
from .training_views import TrainingViews, mean_slope

CUT_KINDS = {"leave-cut-out": CUTS, "leave-second-cut-out": SECOND_CUTS}
KINDS = ("opacity", "spatio-spectral", "released", "leave-one-out", "leave-dog-out", *CUT_KINDS)
CORNER = float(np.sqrt(0.5))  # cycles per pixel, the highest frequency of an image
LUMA = (0.299, 0.587, 0.114)  # Rec. 601
BAND_GAIN, BAND_MAX = 0.1, 3.0  # of the released code's band-pass picture


class Score(Protocol):
    """Importance of each primitive, as a ``ScoreRule`` gives it."""

    def __call__(self, params: dict, views: TrainingViews, seed: int) -> np.ndarray: ...


@dataclass(frozen=True)
class ScoreRule:
    """Which score, and its numbers. Raises ``ValueError`` for numbers that mean nothing."""

    kind: str = "spatio-spectral"
    """Of ``KINDS``; F is J, of leave-one-out D, of leave-dog-out P, of leave-cut-out and leave-second-cut-out Q."""
    spatial_weight: float = 1.0  # λ_s
    spectral_weight: float = 1.0  # λ_f
    gamma_f: float = 1.0  # γ, of the spectral part
    probes: int = 1  # per view, for the spectral part; 0: no noise but the gradient's energy, for gamma_f = 2

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f'ScoreRule: kind "{self.kind}" is unknown; use {", ".join(KINDS)}')
        weights = self.spatial_weight, self.spectral_weight
        if not (min(weights) >= 0 and 0 < sum(weights) < np.inf):
            raise ValueError(f"ScoreRule: the weights are {weights}; none may be negative, one must be positive")
        if self.probes < 0 or not 0 < self.gamma_f < np.inf:
            raise ValueError(f"ScoreRule: probes={self.probes}, gamma_f={self.gamma_f}; use at least 0, and above 0")
        if self.probes == 0 and self.gamma_f != 2:
            raise ValueError(f"ScoreRule: gamma_f={self.gamma_f} needs a probe; without, only gamma_f=2 is known")

    def __call__(self, params: dict, views: TrainingViews, seed: int) -> np.ndarray:
        """Importance of each primitive, [N] float64, at least 0, larger is more important; 0 if no camera sees it.

        Args:
            params: as in ``rasterize``.
            seed: of the noise of the spectral probes.

        Raises ``ValueError`` if there is no camera.
        """
        if self.kind == "opacity":
            return _opacities(params["logit_opacities"].numpy())
        spatial, spectral = energies(self, params, views, seed)
        if self.kind == "released":
            return spatial
        return self.spatial_weight * _normalised(spatial) + self.spectral_weight * _normalised(spectral)

    @property
    def sums(self) -> Sums:
        """What a walk has to add up."""
        if self.kind == "released":
            return Sums(clamped=True)
        spectral = self.spectral_weight > 0
        return Sums(
            removal=self.kind == "leave-one-out",
            degeneration=self.kind == "leave-dog-out",
            uncut=0 if self.kind in CUT_KINDS else None,  # a plane; which place it has, a model says (``_place``)
            energy=self.spatial_weight > 0,
            gradient=spectral and self.probes == 0,
            probes=self.probes if spectral else 0,
        )


def energies(rule: ScoreRule, params: dict, views: TrainingViews, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(U, Uf) of a rule that looks at the views, [N] float64 each; zeros where the rule gives one no weight.

    Arguments and errors as for the rule itself.
    """
    if not views.cameras:
        raise ValueError(f'ScoreRule: "{rule.kind}" needs a camera, there is none')
    n, sums = dr.width(params["logit_opacities"]), rule.sums
    if n == 0:
        return np.zeros(0), np.zeros(0)
    params = dr.detach(params)
    rng = np.random.default_rng(seed)
    Double = array_types().Double
    spatial, spectral = dr.zeros(Double, n), dr.zeros(Double, n)
    for k in range(len(views.cameras)):
        columns = [Double(column) for column in _view_sums(rule, params, views, k, rng)]
        if sums.energy:
            spatial += columns.pop(0)
        if sums.gradient:
            spectral += columns.pop(0)
        for correlation in columns:
            spectral += correlation * correlation * (1 / sums.probes)
        dr.eval(spatial, spectral)
    return spatial.numpy(), spectral.numpy()


def _view_sums(rule: ScoreRule, params: dict, views: TrainingViews, k: int, rng: np.random.Generator) -> list:
    """Columns of ``sums`` for view ``k``, [N] each, float32."""
    camera, mask = views.cameras[k], views.mask(k)
    weighted = rule.kind == "released" or views.curve is not None
    sums = replace(rule.sums, masked=mask is not None, weighted=weighted)
    if sums.uncut is not None:
        sums = replace(sums, uncut=_place(CUT_KINDS[rule.kind], params))
    pictured, view = prepare_both(params, camera, views.options, sums.blocks)
    image = composite_over(pictured, views.background)
    planes = [] if mask is None else [mask]
    if rule.kind == "released":
        picture = np.stack([plane.numpy() for plane in image], -1).reshape(camera.height, camera.width, 3)
        planes.append(band_pass_weight(np.clip(picture, 0, 1)))
    elif views.curve:
        planes.append(mean_slope(views.curve, image))
    if sums.clamped:
        planes += [((plane.numpy() >= 0) & (plane.numpy() <= 1)).astype(np.float32) for plane in image]
    if sums.probes:
        signs = 2.0 * rng.integers(0, 2, (sums.probes * sums.channels, camera.height, camera.width)) - 1
        planes += list(filtered_noise(signs, rule.gamma_f))
    return composite_score(view, sums, image, [detached(device_array(plane)) for plane in planes])


def _place(plane: RowGroup, params: dict) -> int:
    """Of a plane among those of a model; behind the last one if it is not there."""
    there = [group for group in PLANES if group.index in params]
    return there.index(plane) if plane in there else len(there)


def _frequencies(height: int, width: int) -> np.ndarray:
    """|ω| over that of the corner, for the half spectrum of ``np.fft.rfft2``: [H, W // 2 + 1]."""
    return np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None]) / CORNER


def filtered_noise(noise: np.ndarray, gamma_f: float) -> np.ndarray:
    """ξ = h * z of the probes, periodic: planes [..., H, W] filtered by |ω|^(γ/2)."""
    height, width = noise.shape[-2:]
    response = _frequencies(height, width) ** (gamma_f / 2)
    return np.fft.irfft2(response * np.fft.rfft2(noise), s=(height, width))


def band_pass_weight(image: np.ndarray) -> np.ndarray:
    """1 + 0.1 W of a view [H, W, 3], the weight of the authors' released code: [H, W], 1 to 1.3.

    W is the magnitude of the band-passed luma over its mean, at most 3.
    """
    luma = image.astype(np.float64) @ LUMA
    r = _frequencies(*luma.shape)
    band = np.clip((r - 0.04) / 0.08, 0, 1) * np.clip((0.45 - r) / 0.15, 0, 1)
    magnitude = np.abs(np.fft.irfft2(band * np.fft.rfft2(luma - luma.mean()), s=luma.shape))
    return 1 + BAND_GAIN * np.clip(magnitude / max(float(magnitude.mean()), 1e-12), 0, BAND_MAX)


def _normalised(values: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(values)
    return values / norm if norm > 0 else values


def _opacities(logits: np.ndarray) -> np.ndarray:
    """Sigmoid in float64, of ±∞ 1 and 0; 0 for what is not a number."""
    return sigmoid(np.where(np.isnan(logits), -np.inf, logits).astype(np.float64))
