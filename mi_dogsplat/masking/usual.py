"""How much the photographs usually differ from a model, at each place of it.

The model is wrong in the same place in many views where it is too coarse or something shines there. What stands in the
way of one photograph makes an error there alone. So each primitive gets the mean error of the pixels that it is seen
in, over all views, and a render of the primitives in these "colours" is the error that a view would usually have:

    e_i = Σ c E w_i / Σ c w_i        over the pixels of all views
    X = Σ_i w_i e_i + T ē            in a pixel of a view

with the error E of a pixel, c = 1 where it counts and 0 elsewhere, the blending weight w_i = α_i T_i of primitive i,
the light T that all primitives let through, and the mean ē of E over what counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.parameters import upload
from ..render.picture import picture_of
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.sh_basis import C0
from ..scene.splats import Splats
from ..scores.weights import weights


def usual_errors(
    splats: Splats,
    cameras: Sequence[Camera],
    drawn: DrawnAs,
    errors: Sequence[NDArray],
    counts: Sequence[NDArray],
) -> Iterator[NDArray[np.float32]]:
    """X of each view [h, w]; what is never seen where it counts has ē.

    Args:
        splats: the model.
        cameras: of the views, in the size of their errors.
        drawn: how the model is drawn.
        errors: E of each view, [h, w] in 0..1.
        counts: c of each view, [h, w] bool.
    """
    devices = [DeviceCamera.upload(camera, drawn.near_clip) for camera in cameras]
    options = RasterOptions(sh_degree=splats.sh_degree, antialiased=drawn.antialiased)
    params = upload(splats)
    seen = weights(params, devices, options, list(counts)).weighted
    summed = weights(params, devices, options, [E * c for E, c in zip(errors, counts, strict=True)]).weighted
    mean = sum(float(E[c].sum()) for E, c in zip(errors, counts, strict=True))
    mean /= max(sum(int(c.sum()) for c in counts), 1)
    usual = np.divide(summed, seen, out=np.full_like(seen, mean), where=seen > 0)
    picture = picture_of(in_grey(splats, usual), mean, replace(drawn, linear=False))
    return (picture(camera).color[..., 0] for camera in cameras)


def in_grey(splats: Splats, grey: NDArray) -> Splats:
    """The primitives where they are, each in one grey [N] that is the same from every side and all over it."""
    plain = splats.without_slopes().uniform_sh(0)  # without curvatures, too
    levels = np.repeat((np.clip(grey, 0, 1) - 0.5) / C0, 3).reshape(-1, 1, 3)
    return replace(plain, sh_coeffs=levels.astype(np.float32))
