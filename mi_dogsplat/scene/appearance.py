"""What a camera does to the light of the scene in one photograph, as five numbers, and the file that keeps them.

    gains        log2 of the factors on red, green, blue: their mean is the exposure in EV, the rest the white balance
    vignetting   log2 of the factor at the corners of the picture, in r² and in r⁴

All zero is the identity. ``reference/image_formation.py`` says what they do, in this order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support.errors import DataError
from ..support.files import read_json, write_json
from ..support.srgb import linear_to_srgb, srgb_to_linear
from .cameras import Camera

N_OF_IMAGE, N_OF_DEVICE = 3, 2
N_NUMBERS = N_OF_IMAGE + N_OF_DEVICE
GAINS, VIGNETTING = slice(0, 3), slice(3, 5)
APPEARANCE = "appearance.json"  # in a run folder
REMEDY = "name the appearance.json of a run that was trained with --appearance"
Device = tuple[int, int, int]


def device_of(camera: Camera) -> Device:
    """What tells the device of a camera: the shape of its pictures, and their angle of view, both in percents."""
    longer = max(camera.width, camera.height)
    return round(100 * camera.width / longer), round(100 * camera.height / longer), round(20 * camera.fx / longer) * 5


def radii_squared(camera: Camera) -> NDArray[np.float64]:
    """Squared distance of each pixel from the middle of the picture, 1 at its corners, [H, W]."""
    y, x = np.indices((camera.height, camera.width)) + 0.5
    half = camera.width / 2, camera.height / 2
    return ((x - half[0]) ** 2 + (y - half[1]) ** 2) / (half[0] ** 2 + half[1] ** 2)


def photographed(image: ArrayLike, r_sq: ArrayLike, numbers: ArrayLike) -> NDArray[np.float32]:
    """What a camera takes of display-referred colours [..., 3]: gains and vignetting act on their linear light.

    ``r_sq`` [...]: of ``radii_squared``; ``numbers`` [5].
    """
    p, r = np.asarray(numbers, np.float64), np.asarray(r_sq, np.float64)[..., None]
    a_1, a_2 = p[VIGNETTING]
    return linear_to_srgb(np.exp2(p[GAINS] + a_1 * r + a_2 * r**2) * srgb_to_linear(image))


@dataclass(frozen=True)
class Appearance:
    """Of a capture: ``of_images`` [V, 3] by the names of the views, ``of_devices`` [D, 2] by their devices."""

    names: Sequence[str]
    devices: Sequence[Device]
    of_images: NDArray[np.float64]
    of_devices: NDArray[np.float64]

    def numbers(self, camera: Camera, name: str | None = None) -> NDArray[np.float64]:
        """The five [5] of a photograph by its name. One that is not known has the mean exposure, which is 0, and a
        device that is not known does nothing."""
        of_image = dict(zip(self.names, self.of_images, strict=True)).get(name or "", np.zeros(N_OF_IMAGE))
        return np.concatenate([of_image, self.of_device(camera)])

    def of_device(self, camera: Camera) -> NDArray[np.float64]:
        """Vignetting of the device of a camera, [2]."""
        device = device_of(camera)
        return self.of_devices[list(self.devices).index(device)] if device in self.devices else np.zeros(N_OF_DEVICE)

    def taken_out(self, image: ArrayLike, camera: Camera, name: str) -> NDArray[np.float32]:
        """A photograph [H, W, 3] by its name, 0..1, without what its camera did: what ``photographed`` made of it."""
        return np.clip(photographed(image, radii_squared(camera), -self.numbers(camera, name)), 0, 1)

    def write(self, path: Path) -> None:
        """As JSON: ``exposure`` in EV and ``white_balance`` in log2 of each image, ``vignetting`` of each device."""
        images, devices = {}, []
        for name, gains in zip(self.names, self.of_images.tolist(), strict=True):
            exposure = sum(gains) / 3
            images[name] = {"exposure": exposure, "white_balance": [gain - exposure for gain in gains]}
        for device, vignetting in zip(self.devices, self.of_devices.tolist(), strict=True):
            devices.append({"shape": list(device), "vignetting": vignetting})
        write_json(path, {"images": images, "devices": devices})


def read_appearance(path: Path) -> Appearance:
    """What ``Appearance.write`` wrote. Raises ``DataError``."""
    content: Any = read_json(path, REMEDY)
    try:
        images, devices = content["images"], content["devices"]
        gains = [[float(i["exposure"]) + float(w) for w in i["white_balance"]] for i in images.values()]
        of_devices = [[float(a) for a in d["vignetting"]] for d in devices]
        numbers = np.array(gains).reshape(len(images), 3), np.array(of_devices).reshape(len(devices), 2)
        shapes = [_shape(d["shape"]) for d in devices]
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise DataError(path, "is not what a run writes", REMEDY) from None
    if not all(np.isfinite(part).all() for part in numbers):
        raise DataError(path, "holds numbers that are not finite", REMEDY)
    return Appearance(list(images), shapes, *numbers)


def _shape(said: Any) -> Device:
    """That of ``device_of``. Raises ``TypeError`` or ``ValueError``."""
    width, height, focal = said
    if not all(isinstance(part, int) and not isinstance(part, bool) for part in said):
        raise TypeError("a shape is of whole numbers")
    return width, height, focal
