"""The float64 rasteriser for real models: image and analytic gradients, in NumPy alone, tile by tile.

`forward.py` is written for reading: it evaluates every primitive at every pixel and differentiates by differences,
two renders per parameter. Here 100,000 primitives at 400 x 300 pixels take seconds. What a pixel blends is in
`blending.py`.

Notation of `forward.py` and `blending.py`, and
    δx           d loss / d x, loss = sum(adjoint * image); what of it the projection needs is a `ScreenAdjoints`

image = sum_i alpha_i T_i c_i + T_final background gives
    dC/dalpha_i = T_i c_i - (sum_{j > i} alpha_j T_j c_j + T_final background) / (1 - alpha_i)
The division is safe, 1 - alpha >= .01. The sum runs from the back: no difference of large numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .blending import Blending, Block, blocks
from .forward import MAX_ALPHA, MIN_T
from .project_gradients import ScreenAdjoints, project_backward
from .projection import MIN_ALPHA, project

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats


@dataclass
class Rendered:
    """What `render_tiled` returns, float64."""

    image: np.ndarray  # [H, W, 3] over the background, not clamped
    T: np.ndarray  # [H, W] transmittance left for the background
    max_T: float  # largest transmittance met on the way, 1 without negative alphas


def render_tiled(splats: Splats, camera: Camera, background: Sequence[float] | np.ndarray = (0, 0, 0), *,
                 near_clip: float = 0.2, antialiased: bool = False, sh_degree: int | None = None,
                 negative_transmittance: bool = True, min_alpha: float = MIN_ALPHA,
                 min_transmittance: float = MIN_T, moved: float = 0.0) -> Rendered:
    """The image of `reference.render`, for models of any size.

    `min_alpha=0` ignores no primitive (kernels end at 2^-60), `min_transmittance=0` stops no walk: both together are
    its `smooth=True`. `moved`: by this share all cutoffs are stricter, as `Blending` has it. Raises ValueError if
    `sh_degree` exceeds what the primitives have.
    """
    projection = project(splats, camera, near_clip=near_clip, antialiased=antialiased, sh_degree=sh_degree)
    image, T, max_T = np.zeros((camera.height, camera.width, 3)), np.ones((camera.height, camera.width)), 1.0
    for block in blocks(projection, camera, (1 - 2 * abs(moved)) * min_alpha):
        blend = Blending(projection, block, negative_transmittance, min_alpha, min_transmittance, moved)
        image[block.pixels] = blend.sum_of_colors(blend.alpha * blend.T, blend.variations())
        T[block.pixels] = blend.T_final
        max_T = max(max_T, blend.T.max(), blend.T_final.max())
    return Rendered(image + T[..., None] * np.asarray(background, np.float64), T, float(max_T))


def gradients_tiled(splats: Splats, camera: Camera, adjoint: np.ndarray,
                    background: Sequence[float] | np.ndarray = (0, 0, 0), *, near_clip: float = 0.2,
                    antialiased: bool = False, sh_degree: int | None = None, negative_transmittance: bool = True,
                    min_alpha: float = MIN_ALPHA, min_transmittance: float = MIN_T) -> dict[str, np.ndarray]:
    """d sum(adjoint [H, W, 3] * image) / d raw parameter, by name and in the shapes of `splats`, float64.

    Options as in `render_tiled`. Derivatives through a cutoff are 0: of a primitive that was ignored or lies behind
    the end of the walk, of a kernel at its limit of .99, of a colour at its limit of 0. Raises ValueError if the
    shape of `adjoint` is not that of the image, or `sh_degree` exceeds what the primitives have.
    """
    adjoint = np.asarray(adjoint, np.float64)
    if adjoint.shape != (camera.height, camera.width, 3):
        raise ValueError(f"gradients_tiled: adjoint has the shape {adjoint.shape}, the image "
                         f"{(camera.height, camera.width, 3)}; both need to be equal")
    projection = project(splats, camera, near_clip=near_clip, antialiased=antialiased, sh_degree=sh_degree)
    δ = ScreenAdjoints.zeros(len(projection.depths))
    for block in blocks(projection, camera, min_alpha):
        blend = Blending(projection, block, negative_transmittance, min_alpha, min_transmittance)
        δpixels = adjoint[block.pixels]  # [h, w, 3]
        _add_colors(δ, block, blend, δpixels)
        _add_kernels(δ, block, blend, blend.backward(blend.colors_times(δpixels), δpixels @ background))
    return project_backward(splats, camera, projection, δ, antialiased, sh_degree)


def _add_colors(δ: ScreenAdjoints, block: Block, blend: Blending, δpixels: np.ndarray) -> None:
    """What the pixels [h, w, 3] of a block say of the colours of its primitives, and of how these vary."""
    weights = blend.alpha * blend.T
    δ.colors[block.splats] += np.tensordot(weights, δpixels, ((1, 2), (0, 1)))
    if blend.varying.size:
        varying, offsets = block.splats[blend.varying], blend.offsets.reshape(len(blend.varying), -1, 2)
        weighted = weights[blend.varying].reshape(len(varying), -1, 1) * offsets  # [m, h w, 2]
        δcolors = δpixels.reshape(-1, 3)
        δ.color_slopes[varying] += δcolors.T @ weighted
        δ.curvatures[varying] += offsets.swapaxes(1, 2) @ (weighted * δcolors.sum(-1, keepdims=True)) / 2


def _add_kernels(δ: ScreenAdjoints, block: Block, blend: Blending, δalpha: np.ndarray) -> None:
    """What δalpha [n, h, w] says of the kernels of the primitives, and of cuts."""
    δlog_G = np.where(blend.G < MAX_ALPHA, δalpha * blend.G, 0)
    δ.moments[block.splats] += _moments(δlog_G, block.dx, block.dy)
    if blend.dog.size:
        δlog_G_p = np.where(blend.G_p < MAX_ALPHA, -δalpha[blend.dog] * blend.G_p, 0)
        δ.pseudo_moments[block.splats[blend.dog]] += _moments(δlog_G_p, block.dx[blend.dog], block.dy[blend.dog])
        δlog_G[blend.dog] += δlog_G_p  # both have the factors g
    for cut in blend.cuts:
        δalong = δlog_G[cut.rows] * cut.log_kept_slope()
        of_cut = _moments(δalong, block.dx[cut.rows], block.dy[cut.rows])[:, :3]
        δ.cut_moments[cut.plane, block.splats[cut.rows]] += of_cut


def _moments(values: np.ndarray, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
    """Sums [n, 6] of values [n, h, w] times 1, dx, dy, dx^2, dx dy, dy^2."""
    by_x, by_y = values.sum(1), values.sum(2)  # [n, w], [n, h]
    times_dx = np.einsum("nhw,nw->nh", values, dx)
    return np.stack([by_y.sum(1), times_dx.sum(1), (by_y * dy).sum(1), (by_x * dx**2).sum(1),
                     (times_dx * dy).sum(1), (by_y * dy**2).sum(1)], axis=1)
