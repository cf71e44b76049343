"""A Mitsuba sensor as a camera on the device, read again only when it has changed."""

# pyright: reportArgumentType=false
from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from .cameras import camera_from_mitsuba
from .project import DeviceCamera


class SensorReader:
    """Remembers the camera of the latest sensor.

    Reading a sensor waits for the device, which may still be busy with the frame before. Sensors are compared by the
    identity of their JIT variables, which are immutable and kept alive here, so a match is never a coincidence.
    """

    def __init__(self):
        self._key: tuple = ()
        self._parameters: list = []
        self._camera: DeviceCamera | None = None

    def read(self, sensor: mi.Sensor, near_clip: float) -> DeviceCamera:
        """The camera of a ``perspective`` sensor's crop window; its Jacobians are clamped around the whole film.

        Raises ``ValueError`` for any other kind of sensor.
        """
        parameters: list[Any] = [value for _, value in mi.traverse(sensor)]
        film = sensor.film()
        size, crop, offset = film.size(), film.crop_size(), film.crop_offset()
        key = (*dr.detail.collect_indices(parameters), *size, *crop, *offset, near_clip)
        if self._camera is None or key != self._key:
            whole = -offset[0], -offset[1], size[0] - offset[0], size[1] - offset[1]
            self._camera = DeviceCamera.upload(camera_from_mitsuba(sensor), near_clip, whole)
            self._key, self._parameters = key, parameters
        return self._camera
