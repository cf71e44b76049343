"""PUP-3DGS (Hanson et al. 2025, Sec. 4): how far the pictures are from indifferent to where and how large it is.

    H_i = Σ_views Σ_patches Σ_c ∇I ∇Iᵀ     6 x 6, ∇ by the mean and the log scales of primitive i, I the sum of a
                                          channel over a patch of 4 x 4 pixels (the authors' faster variant)
    score = log det H_i                    -∞ where some direction changes no picture

H is the Hessian of the squared error at a perfect fit. The sums over patches are exact, and so is the way from the
projected shape and colour back to mean and scales: six tangents of the projection per view. (Only with --antialiased
the derivative of the compensated opacity is left out.) Pruned to 20 %, then that to 50 % in the paper, with 5,000
steps after each; the same two parts of the way to the budget here, from the densified start on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.arrays import detached
from ...engine.device_camera import DeviceCamera
from ...engine.options import RasterOptions
from ...engine.parameters import device_array
from ...engine.project import project
from ...engine.view import prepare_both
from ...engine.walks.composite import composite_over
from ...engine.walks.fisher import COLUMNS, PAIRS, SHAPE, composite_fisher, patch_blocks
from ...scores.training_views import TrainingViews, mean_slope
from ...training.recipe import Recipe
from ...training.strategy.scheduler import PruningRule

DEVIATIONS = (
    "pruned at steps 15,000 and 20,000, in the same parts of the way (the code prunes a trained model by 80 %, then "
    "50 %); exact sums over patches (the code renders smaller pictures); step sizes are those of 3DGS (in the code "
    "all except those of positions fall by 5 % every 400 steps)"
)
RESOLUTION = 1e-7  # of float32 sums: smaller eigenvalues of H, its diagonal scaled to 1, are noise of either sign


@dataclass(frozen=True)
class Sensitivity:
    """log det H."""

    def __call__(self, params: dict, views: TrainingViews, seed: int) -> np.ndarray:
        H = fisher(params, views)
        lengths = np.sqrt(np.einsum("nii->ni", H))  # [N, 6]
        whole = (lengths > 0).all(1)
        scaled = H[whole] / (lengths[whole, :, None] * lengths[whole, None, :])
        result = np.full(len(H), -np.inf)
        eigenvalues = np.maximum(np.linalg.eigvalsh(scaled), RESOLUTION)
        result[whole] = 2 * np.log(lengths[whole]).sum(1) + np.log(eigenvalues).sum(1)
        return result


def fisher(params: dict, views: TrainingViews) -> np.ndarray:
    """[N, 6, 6] H of each primitive, by (mean, log scales)."""
    params = dr.detach(params)
    total = np.zeros((dr.width(params["logit_opacities"]), 6, 6))
    for k, camera in enumerate(views.cameras):
        sums = _products(params, views, k)  # [COLUMNS, N]
        seen = np.flatnonzero(sums[-1] > 0)
        jacobian = _jacobian(params, camera, views.options)[seen]
        A, B = np.split(jacobian, [SHAPE], axis=1)  # [n, 5, 6] shape, [n, 3, 6] color
        of_pairs, crossed, squared = np.split(sums[:, seen], [len(PAIRS), COLUMNS - 1])
        G = np.zeros((len(seen), SHAPE, SHAPE))
        for (i, j), column in zip(PAIRS, of_pairs, strict=True):
            G[:, i, j] = G[:, j, i] = column
        C = crossed.T.reshape(-1, 3, SHAPE)
        mixed = np.einsum("ncs,nsi,ncj->nij", C, A, B, optimize=True)
        by_color = squared[0, :, None, None] * (B.transpose(0, 2, 1) @ B)
        total[seen] += A.transpose(0, 2, 1) @ G @ A + mixed + mixed.transpose(0, 2, 1) + by_color
    return total


def _products(params: dict, views: TrainingViews, k: int) -> np.ndarray:
    """[COLUMNS, N] float64, what ``composite_fisher`` adds up for view ``k``.

    Seen through a tone curve, derivatives count times its slope, the mean over the channels of a pixel.
    """
    camera, mask = views.cameras[k], views.mask(k)
    pictured, patches = prepare_both(params, camera, views.options, patch_blocks())
    image = composite_over(pictured, views.background)
    if views.curve:
        slope = mean_slope(views.curve, image).reshape(camera.height, camera.width)
        mask = slope if mask is None else slope * mask
    columns = composite_fisher(patches, image, None if mask is None else detached(device_array(mask)))
    return np.stack([column.numpy() for column in columns]).astype(np.float64)


def _jacobian(params: dict, camera: DeviceCamera, options: RasterOptions) -> np.ndarray:
    """[N, 8, 6] derivatives of x, y, ux, uy, vy and the three colours by the mean and the log scales, forward mode."""
    n = dr.width(params["logit_opacities"])
    result = np.zeros((n, SHAPE + 3, 6))
    for k in range(6):
        name, axis = ("means", k) if k < 3 else ("log_scales", k - 3)
        value: Any = mi.Float(params[name])
        dr.enable_grad(value)
        dr.set_grad(value, device_array(np.tile(np.eye(3)[axis], n)))
        projection = project(
            params | {name: value}, camera, sh_degree=options.sh_degree, antialiased=options.antialiased
        )
        kernels = projection.kernels
        outputs = [projection.x, projection.y, kernels.ux, kernels.uy, kernels.vy, *projection.colors]
        flags = dr.ADFlag.ClearEdges  # not the gradients of ux and vy, which others are computed from
        for row, tangent in enumerate(dr.forward_to(*outputs, flags=flags)):
            result[:, row, k] = dr.detach(tangent).numpy()
    return result


RECIPE = Recipe(
    pruning=PruningRule(15_000, 20_000, check_every=5000, max_interval=5000, division=(0.7, 0.3), rounds=2),
    score=Sensitivity(),
)
