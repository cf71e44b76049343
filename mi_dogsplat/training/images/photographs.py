"""The training images as the loss sees them: background, masks, appearance; on the device, or decoded when due.

Images of linear radiance are seen in units of their white, and through a tone curve, as are the renders.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...datasets import Dataset
from ...datasets.dataset import View, as_bytes
from ...datasets.masks import Masks, all_black
from ...datasets.view_images import shrunk
from ...engine.arrays import detached
from ...engine.device_camera import DeviceCamera
from ...engine.parameters import device_array, device_bytes
from ...engine.rasterize import Frame
from ...render.picture import over_background
from ...support.errors import DataError
from .appearance import LearnedAppearance
from .loss import PhotometricLoss, Target
from .read_ahead import ReadAhead
from .tone_curve import SrgbLog, ToneCurve
from .truth import Truth


@dataclass(frozen=True)
class _Decoded:
    """A view on the host: its image, bytes or floats; its mask, and where it is saturated [H, W], or None."""

    image: np.ndarray
    mask: np.ndarray | None
    saturated: np.ndarray | None


@dataclass(frozen=True)
class _OnDevice:
    """A view on the device: its image, ``prepared`` as far as can be before it is due; its mask, bytes; ``bounds`` as
    of ``Truth``, or, where the background changes, one plane that makes them by being added to the image."""

    prepared: Any
    mask: Any
    bounds: list | Any


class Photographs:
    """What is rendered and what that is compared with, and how. What is off costs neither a kernel nor an instruction.

    Args:
        dataset: its training views.
        background: grey level behind the views, where it is not random.
        near_clip: of the cameras, world units.
        random: another background at each step, behind images with alpha.
        masks: folder of masks, named as the images; each is read with its image, and held as bytes where that is held.
        appearance_steps: steps over which is learned what the cameras did to single images; None for none.
        on_disk: images and masks are decoded when they are due.
        keep_targets: what the loss needs of an image is kept, 36 bytes per pixel; else only the image is, 3 to 16.
        curve: through which linear radiance is seen; display-referred images are seen as they are.
        batch_views: of a step.

    Raises ``DataError`` for masks that cannot be read, those on disk when they are due, for masks that are all black,
    and for a random background without alpha.
    """

    def __init__(
        self,
        dataset: Dataset,
        background: float,
        near_clip: float = 0.2,
        random: bool = False,
        masks: str | None = None,
        appearance_steps: int | None = None,
        on_disk: bool = False,
        keep_targets: bool = True,
        curve: ToneCurve = SrgbLog(),  # noqa: B008, it is immutable
        batch_views: int = 1,
    ):
        self.originals, self.background, self.near_clip = list(dataset.train), background, near_clip
        self.white = dataset.white
        self.curve = None if dataset.white is None else curve
        self.loss = PhotometricLoss(most=math.inf if self.curve else 1.0)
        self.random = random
        if random and not dataset.has_alpha:
            raise DataError("--background", "random needs images with alpha", "use black or white")
        self.color: list | None = None  # of the background, while it is random
        self.mask_folder = Masks(masks, dataset.train) if masks else None
        cameras = [view.camera for view in dataset.train]
        steps = appearance_steps
        self.appearance = None if steps is None else LearnedAppearance(cameras, steps, batch_views)
        self.on_disk, self.keep_targets = on_disk, keep_targets
        self._show(self.originals, 1)

    def shrink(self, factor: int) -> None:
        """Show all views ``factor`` times smaller than they are from now on; 1: as they are."""
        if factor == self.factor:
            return
        small = [
            View(v.name, v.camera.downscaled(factor), shrunk(v.recording, factor), v.straight, v.white)
            for v in self.originals
        ]
        self._show(self.originals if factor == 1 else small, factor)

    def _show(self, views: list[View], factor: int) -> None:
        self.views, self.factor = views, factor
        self.cameras = [DeviceCamera.upload(view.camera, self.near_clip) for view in views]
        self._ahead = ReadAhead(lambda k: self._decoded(views[k])) if self.on_disk else None
        self._kept, counts = [], False
        for decoded in (self._decoded(view) for view in views if not self.on_disk):
            self._kept.append(self._on_device(decoded))
            counts |= decoded.mask is None or bool(decoded.mask.any())
        if self.on_disk:  # reads masks up to the first that counts, mostly one
            counts = any(mask is None or mask.any() for mask in map(self.mask, range(len(views))))
        if not counts and self.mask_folder:
            raise all_black(self.mask_folder.folder, "view that is trained on")

    def move(self, view: int, w2c: np.ndarray) -> None:
        """Let a view have been taken from another pose, [4, 4] world to camera."""
        camera = replace(self.originals[view].camera, w2c=w2c)
        self.originals[view] = replace(self.originals[view], camera=camera)
        if self.factor > 1:
            camera = replace(self.views[view].camera, w2c=w2c)
            self.views[view] = replace(self.views[view], camera=camera)
        self.cameras[view] = DeviceCamera.upload(camera, self.near_clip)

    @property
    def positions(self) -> np.ndarray:
        """[V, 3] of the cameras."""
        return np.array([view.camera.position for view in self.views])

    def __len__(self) -> int:
        return len(self.views)

    def choose_background(self, rng: np.random.Generator) -> None:
        """Another colour, if it is random."""
        if self.random:
            self.color = [dr.opaque(mi.Float, level) for level in rng.uniform(size=3)]

    def keep_background(self) -> None:
        """The one that is not random, for a measurement."""
        self.color = None

    def over_background(self, frame: Frame) -> list:
        """Planes of a frame over the background of this step."""
        if self.color:
            return [dr.fma(frame.T, level, c) for level, c in zip(self.color, frame.colors, strict=True)]
        return [dr.fma(frame.T, self.background, c) for c in frame.colors] if self.background else frame.colors

    def compare(self, planes: list, view: int, step: int, upcoming: Sequence[int] = ()) -> tuple[Any, Any, list]:
        """L1, loss, and its gradient by the planes; the appearance takes its step. ``upcoming`` ones are read ahead."""
        truth = self._truth(view, upcoming)
        recorded = self._recorded(planes, view)
        seen = self._seen(recorded)
        l1, _, loss, gradient = self.loss.value_and_gradient(truth.comparable(seen), truth.target)
        gradient = truth.gradient(gradient, seen)
        if self.curve:
            gradient = [δ * self.curve.slope(plane) for δ, plane in zip(gradient, detached(recorded), strict=True)]
        if self.appearance:
            gradient = self.appearance.backward(planes, gradient, view, self._size(view), step)
        return l1, loss, gradient

    def _size(self, view: int) -> tuple[int, int]:
        camera = self.views[view].camera
        return camera.width, camera.height

    def l1(self, planes: list, view: int) -> Any:
        """The L1 of ``compare`` alone."""
        truth = self._truth(view, range(view + 1, len(self.views)))
        return self.loss.l1(truth.comparable(self._seen(self._recorded(planes, view))), truth.target)

    def _recorded(self, planes: list, view: int) -> list:
        """Rendered planes as the camera of a view recorded them."""
        return self.appearance.applied(planes, view, self._size(view)) if self.appearance else planes

    def _seen(self, planes: list) -> list:
        """What the loss sees of recorded planes."""
        return [self.curve(plane) for plane in detached(planes)] if self.curve else planes

    def _truth(self, view: int, upcoming: Sequence[int]) -> Truth:
        """What a view is compared with."""
        kept = self._on_device(self._ahead.take(view, upcoming)) if self._ahead else self._kept[view]
        mask = None if kept.mask is None else mi.Float(kept.mask)
        if self.random:
            return self._over_random(kept, mask, view)
        target = kept.prepared
        if not isinstance(target, Target):
            y = _levels(target) if isinstance(target, device_bytes()) else target
            target = self.loss.target_of_planes([y], *self._size(view))
        return Truth(target, mask, kept.bounds)

    def _over_random(self, kept: _OnDevice, mask: Any, view: int) -> Truth:
        """What is compared with a render that has the background of this step."""
        *colors, alpha = kept.prepared
        behind = self.color or [dr.opaque(mi.Float, self.background)] * 3
        planes = self._seen([dr.fma(1 - alpha, level, c) for level, c in zip(behind, colors, strict=True)])
        bounds = None if kept.bounds is None else [plane + kept.bounds for plane in planes]
        masked = planes if mask is None else [plane * mask for plane in planes]
        return Truth(self.loss.target_of_planes(masked, *self._size(view)), mask, bounds)

    def _decoded(self, view: View) -> _Decoded:
        """The image comes in bytes where it is held so and the loss sees it as it is."""
        mask = self.mask_folder.of(view) if self.mask_folder else None
        if view.pixels is not None and not (self.mask_folder or self.random or self.curve):
            return _Decoded(view.pixels, mask, None)
        recording = view.recording
        return _Decoded(recording.image, mask, recording.saturated)

    def as_seen(self, image: np.ndarray) -> np.ndarray:
        """[H, W, 3] what the loss sees of an image of the data, over the background that is not random, unmasked."""
        truth = over_background(self._in_units_of_white(image), self.background)
        if self.curve:
            truth = self.curve(device_array(np.ascontiguousarray(truth))).numpy().reshape(truth.shape)
        return truth

    def mask(self, view: int) -> np.ndarray | None:
        """[H, W] of a view of the data, 1 where a pixel counts; None where it counts whole."""
        return self.mask_folder.of(self.originals[view]) if self.mask_folder else None

    def shown_mask(self, view: int) -> np.ndarray | None:
        """The same at the size at which the view is shown now."""
        return self.mask_folder.of(self.views[view]) if self.mask_folder else None

    def _in_units_of_white(self, image: np.ndarray) -> np.ndarray:
        if self.white is None:
            return image
        return np.concatenate([image[..., :3] / np.float32(self.white), image[..., 3:]], axis=-1)

    def _on_device(self, decoded: _Decoded) -> _OnDevice:
        mask = None if decoded.mask is None else device_array(decoded.mask, device_bytes())
        return _OnDevice(self._prepared(decoded.image, decoded.mask), mask, self._bounds(decoded))

    def _bounds(self, decoded: _Decoded) -> list | Any:
        """As ``_OnDevice`` has them."""
        if decoded.saturated is None:
            return None
        if self.random:
            return device_array(np.where(decoded.saturated, np.float32(0), np.float32(np.inf)))
        bounds = np.where(decoded.saturated[..., None], self.as_seen(decoded.image), np.float32(np.inf))
        return [device_array(np.ascontiguousarray(bounds[..., c])) for c in range(3)]

    def _prepared(self, image: np.ndarray, mask: np.ndarray | None) -> Target | list | Any:
        """A target, or the image that it is made of, bytes or floats [3 H W]; or, behind which the background changes,
        premultiplied planes and alpha."""
        if self.random:
            image = self._in_units_of_white(image)
            return [device_array(np.ascontiguousarray(image[..., c])) for c in range(4)]
        planes, pixels = (2, 0, 1), image if image.dtype == np.uint8 else None
        if pixels is None:
            truth = self.as_seen(image)
            truth = truth if mask is None else truth * mask[..., None]
            if self.keep_targets or self.on_disk:
                return self.loss.target(truth)
            if (pixels := as_bytes(truth)) is None:
                return device_array(truth.transpose(planes))
        prepared = device_array(pixels.transpose(planes), device_bytes())
        if not self.keep_targets:
            return prepared
        height, width, _ = pixels.shape
        return self.loss.target_of_planes([_levels(prepared)], width, height)


def _levels(pixels: Any) -> mi.Float:
    """Display values of bytes on the device."""
    return mi.Float(pixels) / dr.opaque(mi.Float, 255)  # by a literal some would be off by a rounding
