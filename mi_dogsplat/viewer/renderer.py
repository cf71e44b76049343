"""A visitor's pose and settings to a picture, by this package's rasterizer."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..datasets.dataset import View
from ..engine.options import RasterOptions
from ..engine.parameters import upload
from ..render.picture import photograph as shown
from ..render.picture import render_picture
from ..scene.appearance import Appearance, photographed, radii_squared
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.kinds import varying
from ..scene.splats import Array, Splats
from ..support.pictures import heat_map
from .view_state import (
    CUT_DIFFERENCE,
    DOG_DIFFERENCE,
    ERROR,
    MODEL,
    ONLY_DOG,
    ONLY_GAUSSIANS,
    PHOTOGRAPH,
    SHIFT_DIFFERENCE,
    VARYING_DIFFERENCE,
    WITHOUT_CUTS,
    WITHOUT_DOG,
    WITHOUT_SHIFTS,
    WITHOUT_VARYING,
    Pose,
    Settings,
)

PARTS: dict[str, Callable[[Splats], Splats]] = {
    MODEL: lambda splats: splats,
    WITHOUT_DOG: Splats.plain,
    ONLY_DOG: Splats.only_dog,
    ONLY_GAUSSIANS: Splats.only_gaussians,
    WITHOUT_CUTS: Splats.without_cuts,
    WITHOUT_SHIFTS: Splats.without_shifts,
} | dict.fromkeys(WITHOUT_VARYING.values(), Splats.without_slopes)
DIFFERENCES = {  # of the model to its part
    DOG_DIFFERENCE: WITHOUT_DOG,
    CUT_DIFFERENCE: WITHOUT_CUTS,
    SHIFT_DIFFERENCE: WITHOUT_SHIFTS,
} | {VARYING_DIFFERENCE[what]: part for what, part in WITHOUT_VARYING.items()}


@dataclass(frozen=True)
class Drawn:
    """A picture uint8 [H, W, 3], what it is in words, and how long it took."""

    image: Array
    about: str
    milliseconds: float


class Renderer:
    """Draws a model that can be replaced; parts of it go to the device when they are first asked for."""

    def __init__(
        self, splats: Splats, drawn: DrawnAs, views: Sequence[View] = (), appearance: Appearance | None = None
    ):
        self.views = list(views)
        self.replace(splats, drawn, appearance)

    def replace(self, splats: Splats, drawn: DrawnAs, appearance: Appearance | None = None) -> None:
        """Draw another model from now on, and compare it with photographs of this appearance, where that is known."""
        self.splats, self.drawn, self.appearance = splats, drawn, appearance
        self._params: dict[str, tuple[dict, int]] = {}  # and the SH degree of the part

    @property
    def choices(self) -> list[str]:
        """What can be shown of this model and its data."""
        dog = [WITHOUT_DOG, ONLY_DOG, ONLY_GAUSSIANS, DOG_DIFFERENCE] if self.splats.n_dog else []
        what = varying(self.splats)
        varied = [WITHOUT_VARYING[what], VARYING_DIFFERENCE[what]] if what else []
        cuts = [WITHOUT_CUTS, CUT_DIFFERENCE] if self.splats.is_cut.any() else []
        shifts = [WITHOUT_SHIFTS, SHIFT_DIFFERENCE] if self.splats.n_shifts else []
        return [MODEL, *dog, *varied, *cuts, *shifts, *([ERROR, PHOTOGRAPH] if self.views else [])]

    def draw(self, pose: Pose, settings: Settings, moving: bool = False) -> Drawn:
        """The picture that is due. What the model does not have is drawn as the model."""
        start = time.perf_counter()
        show = settings.show if settings.show in self.choices else MODEL
        camera, about = pose.camera(settings.rows(moving)), ""
        if show in (ERROR, PHOTOGRAPH):
            view = nearest_view(self.views, camera)
            photograph, about = self._photograph(view, settings), f"photograph {view.name}"
            if show == PHOTOGRAPH:
                image = photograph
            else:
                error = np.abs(self._taken(view, settings) - photograph).mean(axis=-1)
                image, about = _as_colors(error, settings.gain), f"{about}: mean error {error.mean():.4f}"
            image = fitted(image, camera.width, camera.height)
        elif show in DIFFERENCES:
            whole, without = (self._render(part, camera, settings) for part in (MODEL, DIFFERENCES[show]))
            difference = np.abs(whole - without).mean(axis=-1)
            image, about = _as_colors(difference, settings.gain), f"mean difference {difference.mean():.4f}"
        else:
            image = self._render(show, camera, settings)
        pixels = np.round(np.clip(np.nan_to_num(image), 0, 1) * 255).astype(np.uint8)
        return Drawn(pixels, about, (time.perf_counter() - start) * 1e3)

    def _photograph(self, view: View, settings: Settings) -> Array:
        """[H, W, 3] in 0..1, in the exposure of the model: linear images have one of their own."""
        if view.white is not None:  # a display value of 1 is a radiance of 1
            view = replace(view, white=self.drawn.white if self.drawn.linear else 1.0)
        return shown(view, settings.background)

    def _taken(self, view: View, settings: Settings) -> Array:
        """[H, W, 3] in 0..1, the model as the camera of a view took it, as far as that was learned."""
        image = self._render(MODEL, view.camera, settings)
        if self.appearance is None or view.white is not None:
            return image
        numbers = self.appearance.numbers(view.camera, view.name)
        return np.clip(photographed(image, radii_squared(view.camera), numbers), 0, 1)

    def _render(self, part: str, camera: Camera, settings: Settings) -> Array:
        """[H, W, 3] in 0..1."""
        if part not in self._params:
            splats = PARTS[part](self.splats)
            self._params[part] = upload(splats), splats.sh_degree
        params, degree = self._params[part]
        options = RasterOptions(min(settings.sh_degree, degree))
        return render_picture(params, camera, options, settings.background, self.drawn).color


def nearest_view(views: Sequence[View], camera: Camera) -> View:
    """The view that stands nearest and looks the same way: a turn by 60 degrees counts as much as the spread."""
    positions = np.array([view.camera.position for view in views])  # [V, 3]
    forward = np.array([view.camera.w2c[2, :3] for view in views])  # [V, 3]
    spread = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max()) or 1.0
    distance = np.linalg.norm(positions - camera.position, axis=1) / spread
    turn = np.linalg.norm(forward - camera.w2c[2, :3], axis=1)  # 1 at 60 degrees
    return views[int(np.argmin(distance + turn))]


def fitted(image: Array, width: int, height: int) -> Array:
    """A picture [h, w, 3] resampled whole (nearest pixel) to [height, width, 3], with black bars at two sides."""
    scale = min(width / image.shape[1], height / image.shape[0])
    w, h = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    rows = np.minimum(((np.arange(h) + 0.5) / scale).astype(int), image.shape[0] - 1)
    columns = np.minimum(((np.arange(w) + 0.5) / scale).astype(int), image.shape[1] - 1)
    result = np.zeros((height, width, 3), image.dtype)
    top, left = (height - h) // 2, (width - w) // 2
    result[top : top + h, left : left + w] = image[rows[:, None], columns]
    return result


def _as_colors(error: Array, gain: float) -> Array:
    return heat_map(np.clip(error * gain, 0, 1))
