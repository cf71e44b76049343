"""A view of a model as NumPy pictures, for evaluation and files (no derivatives)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike

from ..engine.aovs import channel_names, channels
from ..engine.project import DeviceCamera
from ..engine.rasterize import RasterOptions, rasterize
from ..scene.appearance import photographed, radii_squared
from ..scene.cameras import Camera
from ..support.srgb import linear_to_srgb


def background_color(background: str, has_alpha: bool) -> float:
    """Grey level behind the splats, 0 or 1, for ``PictureOptions.background``; ``random`` measures as ``auto``."""
    return {"black": 0.0, "white": 1.0}.get(background, 1.0 if has_alpha else 0.0)


@dataclass(frozen=True)
class Picture:
    """Display-referred colours over the background, coverage, and depth along the optical axis."""

    color: np.ndarray  # [H, W, 3] clamped to 0..1
    alpha: np.ndarray  # [H, W] 1 - T
    depth: np.ndarray | None  # [H, W] Σ depth α T / alpha, 0 where nothing was hit
    aovs: dict[str, np.ndarray] = field(default_factory=dict)  # [H, W] by the name of the channel


def render_picture(
    params: dict,
    camera: Camera,
    options: RasterOptions,
    background: float = 0.0,
    near_clip: float = 0.2,
    aovs: Sequence[str] = (),
    film: tuple[float, float, float, float] | None = None,
    linear: bool = False,
) -> Picture:
    """Render parameters (as ``upload`` makes them) from a camera over a grey ``background``, 0..1.

    ``aovs`` are names as in ``aovs.py``, whose needs are among the ``options``. ``film``: the whole image where the
    camera sees a part of it (``DeviceCamera.upload``). ``linear``: the primitives hold linear radiance, which is
    blended as such and shown as sRGB.
    """
    detached = {name: dr.detach(value) for name, value in params.items()}
    frame = rasterize(detached, DeviceCamera.upload(camera, near_clip, film=film), options)
    shape = (camera.height, camera.width)
    T = frame.T.numpy().reshape(shape)
    color = np.stack([plane.numpy().reshape(shape) for plane in frame.colors], -1) + background * T[..., None]
    alpha = 1 - T
    depth = None
    if frame.depth is not None:
        blended = frame.depth.numpy().reshape(shape)
        depth = np.divide(blended, alpha, out=np.zeros(shape, np.float32), where=alpha > 0)
    if linear:
        color = linear_to_srgb(color)
    extra = [plane.numpy().reshape(shape) for plane in channels(aovs, frame)]
    return Picture(np.clip(color, 0, 1), alpha, depth, dict(zip(channel_names(aovs), extra, strict=True)))


def as_taken(picture: Picture, camera: Camera, numbers: ArrayLike) -> Picture:
    """The picture as a camera takes it, with its exposure, white balance and vignetting (``scene/appearance.py``)."""
    color = np.clip(photographed(picture.color, radii_squared(camera), numbers), 0, 1)
    return replace(picture, color=color)


def over_background(image: np.ndarray, background: float) -> np.ndarray:
    """[H, W, 3] of an image with or without premultiplied alpha."""
    return image if image.shape[-1] == 3 else image[..., :3] + (1 - image[..., 3:]) * background


def premultiplied(picture: Picture, background: float) -> np.ndarray:
    """[H, W, 4] of a picture without its grey ``background``: what a compositing program expects of RGBA."""
    color = picture.color - background * (1 - picture.alpha[..., None])
    return np.concatenate([color, picture.alpha[..., None]], -1)
