"""A view of a model as NumPy pictures, for evaluation and files (no derivatives)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike

from ..engine.aovs import channel_names, channels, options_for
from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.parameters import upload
from ..engine.rasterize import rasterize
from ..scene.appearance import photographed, radii_squared
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.splats import Splats
from ..support.srgb import displayed, linear_to_srgb, srgb_to_linear

if TYPE_CHECKING:
    from ..datasets.dataset import View


def background_color(background: str | None, has_alpha: bool) -> float:
    """Grey level behind the splats, 0 or 1, for ``PictureOptions.background``; None and ``random`` are as ``auto``."""
    return {"black": 0.0, "white": 1.0}.get(background or "auto", 1.0 if has_alpha else 0.0)


@dataclass(frozen=True)
class Picture:
    """Display-referred colours over the background, coverage, and depth along the optical axis."""

    color: np.ndarray  # [H, W, 3] clamped to 0..1
    alpha: np.ndarray  # [H, W] 1 - T
    depth: np.ndarray | None  # [H, W] Σ depth α T / alpha, 0 where nothing was hit
    aovs: dict[str, np.ndarray] = field(default_factory=dict)  # [H, W] by the name of the channel
    radiance: np.ndarray | None = None  # [H, W, 3] over the background, of a model that is linear
    white: float = 1.0  # the radiance that ``color`` shows as white

    def in_units_of(self, factor: float) -> Picture:
        """The same picture of linear radiance, which is ``factor`` times as much in another unit."""
        radiance = None if self.radiance is None else self.radiance * np.float32(factor)
        return replace(self, radiance=radiance, white=self.white * factor)


def render_picture(
    params: dict,
    camera: Camera,
    options: RasterOptions,
    background: float = 0.0,
    drawn: DrawnAs = DrawnAs(),
    aovs: Sequence[str] = (),
    film: tuple[float, float, float, float] | None = None,
    perspective: bool = True,
) -> Picture:
    """Render parameters (as ``upload`` makes them) from a camera.

    Args:
        options: whether it is antialiased, ``drawn`` decides alone.
        background: grey level behind, 0..1.
        drawn: where it is ``linear``, the primitives hold linear radiance, which is blended as such, over
            ``background`` times ``white``, and shown as ``displayed`` has it.
        aovs: names as in ``aovs.py``, whose needs are among the ``options``.
        film: the whole image where the camera sees a part of it (``DeviceCamera.upload``).
        perspective: whether the camera is a pinhole (the same).
    """
    on_device = DeviceCamera.upload(camera, drawn.near_clip, film=film, perspective=perspective)
    frame = rasterize(dr.detach(params), on_device, replace(options, antialiased=drawn.antialiased))
    shape = (camera.height, camera.width)
    T = frame.T.numpy().reshape(shape)
    behind = background * drawn.white if drawn.linear else background
    color = np.stack([plane.numpy().reshape(shape) for plane in frame.colors], -1) + behind * T[..., None]
    alpha = 1 - T
    depth = None
    if frame.depth is not None:
        blended = frame.depth.numpy().reshape(shape)
        depth = np.divide(blended, alpha, out=np.zeros(shape, np.float32), where=alpha > 0)
    extra = [plane.numpy().reshape(shape) for plane in channels(aovs, frame)]
    named = dict(zip(channel_names(aovs), extra, strict=True))
    if drawn.linear:
        return Picture(displayed(color, drawn.white), alpha, depth, named, color, drawn.white)
    return Picture(np.clip(color, 0, 1), alpha, depth, named)


def picture_of(
    splats: Splats, background: float, drawn: DrawnAs = DrawnAs(), aovs: Sequence[str] = ()
) -> Callable[[Camera], Picture]:
    """Renderer of a model, which may be empty and is uploaded once.

    Args:
        background: grey level behind, 0..1.
        aovs: names as in ``aovs.py``, which the pictures carry.
    """
    params = upload(splats)
    options = options_for(aovs, RasterOptions(sh_degree=splats.sh_degree))
    return lambda camera: render_picture(params, camera, options, background, drawn, aovs)


def photograph(view: View, background: float) -> np.ndarray:
    """[H, W, 3] display-referred: the image of a view over a grey ``background``, 0..1; linear radiance as
    ``displayed`` has it."""
    if view.white is None:
        return over_background(view.image, background)
    return displayed(radiance_of(view, background), view.white)


def radiance_of(view: View, background: float) -> np.ndarray:
    """[H, W, 3] of a view of linear radiance, over a grey ``background`` of its white."""
    return over_background(view.image, background * (view.white or 1.0))


def light_of(picture: Picture) -> np.ndarray:
    """[H, W, 3] linear radiance of a picture, at least 0; of display-referred colours what they stand for."""
    return srgb_to_linear(picture.color) if picture.radiance is None else np.maximum(picture.radiance, 0)


def light_seen_as(picture: Picture, view: View) -> np.ndarray:
    """[H, W, 3] linear radiance of a picture, as that of a view which it is compared with: no brighter where the sensor
    was full."""
    light, recording = light_of(picture), view.recording
    if recording.saturated is None:
        return light
    bound = recording.image[..., :3]
    return np.where(recording.saturated[..., None], np.minimum(light, bound), light)


def seen_as(picture: Picture, view: View) -> np.ndarray:
    """[H, W, 3] display-referred: a picture in the exposure of the ``photograph`` that it is compared with; no brighter
    where that is saturated."""
    return picture.color if view.white is None else displayed(light_seen_as(picture, view), view.white)


def exposed_by(picture: Picture, white: float | None) -> np.ndarray:
    """[H, W, 3] display-referred: a picture that shows this radiance as white, as images with this ``white`` do; None
    is for images that are display-referred themselves."""
    return picture.color if white is None else displayed(light_of(picture), white)


def as_taken(picture: Picture, camera: Camera, numbers: ArrayLike) -> Picture:
    """The picture of display-referred colours as a camera takes it, with its exposure, white balance and vignetting
    (``scene/appearance.py``)."""
    color = np.clip(photographed(picture.color, radii_squared(camera), numbers), 0, 1)
    return replace(picture, color=color)


def over_background(image: np.ndarray, background: float) -> np.ndarray:
    """[H, W, 3] of an image with or without premultiplied alpha."""
    return image if image.shape[-1] == 3 else image[..., :3] + (1 - image[..., 3:]) * background


def premultiplied(picture: Picture, background: float) -> np.ndarray:
    """[H, W, 4] of a picture without its grey ``background``: what a compositing program expects of RGBA.

    Of linear radiance it is the sRGB curve, not clamped, which ``write_exr`` undoes.
    """
    if picture.radiance is None:
        color = picture.color - background * (1 - picture.alpha[..., None])
    else:
        color = linear_to_srgb(picture.radiance - background * picture.white * (1 - picture.alpha[..., None]))
    return np.concatenate([color, picture.alpha[..., None]], -1)
