"""What cameras did to the training images, learned beside the model: exposure and white balance of each image,
vignetting of each device.

The rendered colours pass the chain of ``image_formation.py`` before the loss; its five numbers begin as the identity.
What they explain stays out of the model.

What fixes them: a gain that all images have in common, undone by the colours of the model, changes no training image,
but every test view. So the gains of an image are those that Adam moves minus their mean over all images. And since
colours depend on the direction, they can undo the gain of a single view as well: the loss has a term that grows with
the distance of each number from 0, by its square near 0 and by its logarithm further on (Cauchy's, as in robust
statistics). It holds what no photograph asks for, and does not hold back what one does. Its weight is how much the
mean of the photograph changes with a gain, as dark ones ask for little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import drjit as dr
import numpy as np

from ...engine.arrays import detached
from ...engine.parameters import device_array
from ...scene.appearance import GAINS, N_NUMBERS, N_OF_IMAGE, VIGNETTING, Appearance, device_of
from ...scene.cameras import Camera
from .image_formation import ImageSize, formed, formed_gradients
from .rows_of_numbers import RowsOfNumbers

TRAVEL = 3.0  # how far a gain can move in all, EV
MAX_RATE, END = 0.2, 0.03  # of a step of Adam, EV; and what is left of it at the end, to which it falls log-linearly


def per_number(gains: float, vignetting: float) -> np.ndarray:
    """A constant of each of the five numbers."""
    values = np.zeros(N_NUMBERS)
    values[GAINS], values[VIGNETTING] = gains, vignetting
    return values


RATES = per_number(1.0, 0.1)  # times that of the gains
STIFFNESS = per_number(13.0, 0.7)  # of the term in the loss: its second derivative at 0, over the weight
BEND = per_number(0.03, 0.05)  # where its derivative is largest


class LearnedAppearance:
    """Numbers of each training view and device. Planes are detached: derivatives are written out by hand.

    Args:
        cameras: of all training views.
        total_steps: of the training.
        batch_views: of a step.
    """

    def __init__(self, cameras: Sequence[Camera], total_steps: int, batch_views: int = 1):
        n_views = len(cameras)
        self.devices = sorted({device_of(camera) for camera in cameras})
        self.device_of_view = [self.devices.index(device_of(camera)) for camera in cameras]
        self.total_steps = max(total_steps, 1)
        # the mean of a rate that falls from 1 to END is (1 - END) / log(1 / END)
        turns = self.total_steps * batch_views / n_views
        self.rate = min(MAX_RATE, TRAVEL * np.log(1 / END) / (1 - END) / turns)
        self.of_images = RowsOfNumbers(n_views, RATES[:N_OF_IMAGE])
        self.of_devices = RowsOfNumbers(len(self.devices), RATES[N_OF_IMAGE:], most=0.0)  # no lens brightens corners
        self.mean = detached(device_array(np.zeros(N_OF_IMAGE)))  # over all images
        self.stiffness, self.inv_bend = (detached(device_array(v)) for v in (STIFFNESS, 1 / BEND))
        self._sizes: dict[tuple[int, int], ImageSize] = {}

    def applied(self, planes: list, view: int, size: tuple[int, int]) -> list:
        """Three planes [H*W] as the camera of a view recorded them; ``size``: width and height."""
        return formed(detached(planes), self._numbers(view), self._size(size))

    def backward(self, planes: list, gradient: list, view: int, size: tuple[int, int], step: int) -> list:
        """The gradient by the planes, of that by ``applied``; the numbers of the view take their step of Adam."""
        numbers, image_size = self._numbers(view), self._size(size)
        by_planes, rows = formed_gradients(detached(planes), numbers, image_size, detached(gradient))
        sums = dr.block_sum(rows, dr.width(image_size.lane))
        by_numbers = dr.gather(type(sums), sums, dr.arange(dr.uint32_array_t(sums), N_NUMBERS))
        reach = dr.gather(type(sums), sums, N_NUMBERS) * image_size.inv_values
        by_numbers += reach * self.stiffness * numbers / (1 + dr.square(numbers * self.inv_bend))
        self._step(view, by_numbers, self.rate * END ** min(step / self.total_steps, 1.0))
        return by_planes

    def stored(self, names: Sequence[str]) -> Appearance:
        """What is learned so far, by the names of the views."""
        of_images, mean = self.of_images.numpy().astype(np.float64), self.mean.numpy()
        return Appearance(names, self.devices, of_images - mean, self.of_devices.numpy().astype(np.float64))

    def state(self) -> dict[str, np.ndarray]:
        """What ``restore`` needs to go on with the same bits."""
        parts = {"images": self.of_images.state(), "devices": self.of_devices.state()}
        named = {f"{part}_{name}": values for part, state in parts.items() for name, values in state.items()}
        return named | {"mean": self.mean.numpy()}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take over a ``state()``. Raises ``KeyError``."""
        for prefix, rows in (("images_", self.of_images), ("devices_", self.of_devices)):
            rows.restore({name[len(prefix) :]: v for name, v in saved.items() if name.startswith(prefix)})
        self.mean = detached(device_array(saved["mean"]))  # rounded otherwise than if it was found anew

    def _step(self, view: int, by_numbers: Any, rate: float) -> None:
        dr.eval(by_numbers)
        UInt = dr.uint32_array_t(by_numbers)
        ranges = (0, N_OF_IMAGE), (N_OF_IMAGE, N_NUMBERS)
        of_image, of_device = (dr.gather(type(by_numbers), by_numbers, dr.arange(UInt, *range)) for range in ranges)
        change = self.of_images.step(view, of_image, rate)
        self.mean += change * dr.opaque(type(change), 1 / len(self.device_of_view))
        self.of_devices.step(self.device_of_view[view], of_device, rate)
        dr.schedule(self.mean)

    def _numbers(self, view: int) -> Any:
        """The five of a view, evaluated."""
        gains = self.of_images.values[view] - self.mean
        numbers = dr.concat([gains, self.of_devices.values[self.device_of_view[view]]])
        dr.eval(numbers)
        return numbers

    def _size(self, size: tuple[int, int]) -> ImageSize:
        if size not in self._sizes:
            self._sizes[size] = ImageSize.of(*size)
        return self._sizes[size]
