"""Mitsuba's sensors as cameras on the device, read again only when they have changed.

``perspective`` is a pinhole, ``orthographic`` a camera of parallel rays. ``thinlens`` is a pinhole at every point of
its lens: it moves by p in the plane of the lens while its image moves by f p / d, so that what lies at the focus
distance d stays where it is. ``batch`` holds several of them, side by side on one film.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import drjit as dr
import mitsuba as mi

from ..engine.device_camera import DeviceCamera
from ..engine.drjit_internals import held, variable_indices
from ..scene.mitsuba_cameras import (
    central_camera_from_mitsuba,
    far_clip_from_mitsuba,
    near_clip_from_mitsuba,
    orthographic_camera_from_mitsuba,
)
from .samples import Sample

KINDS = ("PerspectiveCamera", "ThinLensCamera", "OrthographicCamera")
OPTICS = ("to_world", "x_fov", "principal_point_offset_x", "principal_point_offset_y", "aperture_radius",
          "focus_distance")
Rectangle = tuple[float, float, float, float]


@dataclass
class View:
    """A sensor that sees one image, and its camera; ``lens``: radius and focus distance."""

    sensor: mi.Sensor
    camera: DeviceCamera
    lens: tuple | None

    def through(self, sample: Sample, border: int = 0) -> ViewPass:
        """The view through the samples of a pass; ``border``: pixels around the crop window, sampled as well."""
        if sample == Sample(seed=sample.seed) and not border:
            return ViewPass(self.sensor, self.camera, sample)
        camera, W = self.camera, self.camera.rotation
        x, y = dr.opaque(mi.Float, 0.5 - sample.x + border), dr.opaque(mi.Float, 0.5 - sample.y + border)
        cx, cy, rest, limits = camera.cx + x, camera.cy + y, camera.position_rest, camera.limits
        if self.lens:
            radius, focus = self.lens
            point: Any = mi.warp.square_to_uniform_disk_concentric(mi.ScalarPoint2f(sample.lens_x, sample.lens_y))
            left, up = (float(cast(Any, dr.slice(p))) for p in point)
            right, down = (radius * dr.opaque(mi.Float, -p) for p in (left, up))
            along_x, along_y = right / focus, down / focus  # from there the whole film is seen in other directions
            cx, cy = cx + camera.fx * along_x, cy + camera.fy * along_y
            limits = [limits[0] + along_x, limits[1] - along_x, limits[2] + along_y, limits[3] - along_y]
            rest = [rest[c] + right * W[0][c] + down * W[1][c] for c in range(3)]
        size = {"width": camera.width + 2 * border, "height": camera.height + 2 * border}
        numbers = *camera.numbers, sample, border
        moved = replace(camera, cx=cx, cy=cy, position_rest=rest, limits=limits, numbers=numbers, **size)
        return ViewPass(self.sensor, moved, sample, border)


@dataclass
class ViewPass:
    """A view during one pass: ``camera`` is the pinhole (or of parallel rays) that has the samples at pixel centres."""

    sensor: Any  # mi.Sensor
    camera: DeviceCamera
    sample: Sample
    border: int = 0

    def rays(self) -> mi.RayDifferential3f:
        """Rays through the samples, row by row."""
        width, height = self.camera.width, self.camera.height
        index = dr.arange(mi.UInt32, width * height)
        y = index // dr.opaque(mi.UInt32, width)
        within = [dr.opaque(mi.Float, k - self.border) for k in (self.sample.x, self.sample.y)]
        position: Any = mi.Point2f(mi.Float(index - y * width) + within[0], mi.Float(y) + within[1])
        lens = [dr.opaque(mi.Float, k) for k in (self.sample.lens_x, self.sample.lens_y)]
        crop = width - 2 * self.border, height - 2 * self.border
        ray, _ = self.sensor.sample_ray_differential(0, 0, position / mi.ScalarVector2f(crop), mi.Point2f(*lens))
        return ray


class SensorReader:
    """Remembers the cameras of the latest sensors.

    Reading a sensor waits for the device, which may still be busy with the frame before. Sensors are compared by the
    identity of their JIT variables, which are immutable and kept alive here, so a match is never a coincidence. A
    sensor's parameters themselves keep none alive, as they are changed in place.
    """

    def __init__(self):
        self._parameters: dict[int, _Parameters] = {}
        self._known: dict[int, tuple] = {}

    def views(self, sensor: mi.Sensor, near_clip: float, picture: Rectangle | None = None) -> list[View]:
        """What a sensor sees: one image, or those of a ``batch``, from left to right.

        ``picture``: (left, top, right, bottom) in pixels of the crop window, around which Jacobians are clamped in
        place of the film. Raises ``ValueError`` for a sensor that cannot be splatted.
        """
        sensors = [sensor]
        if sensor.class_name() == "BatchSensor":
            film, sensors = sensor.film(), _Sensors(sensor).found
            if film.sample_border() or any(film.crop_size() != film.size()):
                raise ValueError("dogsplat: a batch has no sample_border and no crop window; leave them out")
            if any(each.film() is film for each in sensors):  # Mitsuba makes one of equal plugins in a file
                raise ValueError("dogsplat: a batch and its sensors have one film; give films to the batch alone")
        return [self._view(slot, each, near_clip, picture) for slot, each in enumerate(sensors)]

    def _view(self, slot: int, sensor: Any, near_clip: float, picture: Rectangle | None) -> View:
        kind = sensor.class_name()
        if kind not in KINDS:
            raise ValueError(
                f"dogsplat: a sensor {kind} cannot be splatted; "
                "use perspective, thinlens, orthographic, or a batch of these"
            )
        if slot not in self._parameters or self._parameters[slot].sensor is not sensor:
            self._parameters[slot] = _Parameters(sensor)
        values, film = self._parameters[slot].values(), sensor.film()
        lens = (values["aperture_radius"], values["focus_distance"]) if kind == "ThinLensCamera" else None
        dr.make_opaque(lens)  # in the sensor, too: its rays, and all that follows, would be compiled for each focus
        size, crop, offset = film.size(), film.crop_size(), film.crop_offset()
        indices = variable_indices(list(values.values()))
        key = (*indices, *size, *crop, *offset, picture, near_clip, sensor.near_clip(), sensor.far_clip(), kind)
        known, _, camera = self._known.get(slot, (None, None, None))
        if camera is None or key != known:
            camera = _read(sensor, near_clip, picture)
            if lens:  # another lens is another picture, though its pinhole is the same
                camera = replace(camera, numbers=(*camera.numbers, *(dr.detach(value)[0] for value in lens)))
            self._known[slot] = key, held(values.values()), camera
        return View(sensor, _attached(camera, values, size), lens)


class _Parameters(mi.TraversalCallback):
    """Those of a sensor that make its image. Read in each frame: ``mi.traverse`` would take five times as long."""

    def __init__(self, sensor: mi.Sensor):
        super().__init__()
        self.sensor, self._places = sensor, {}
        sensor.traverse(self)

    def put(self, name, value, flags, cpptype=None):
        if name in OPTICS:
            self._places[name] = value, cpptype

    def values(self) -> dict[str, Any]:
        return {name: mi.get_property(at, kind, self.sensor) for name, (at, kind) in self._places.items()}


class _Sensors(mi.TraversalCallback):
    """Collects the sensors that another one holds, in its order."""

    def __init__(self, holder: mi.Sensor):
        super().__init__()
        self.found = []
        holder.traverse(self)

    def put(self, name, value, *flags):
        if isinstance(value, mi.Sensor):
            self.found.append(value)


def _read(sensor: mi.Sensor, near_clip: float, picture: Rectangle | None) -> DeviceCamera:
    """The camera of a sensor's crop window; its Jacobians are clamped around the picture, or the whole film."""
    near, far = max(near_clip, near_clip_from_mitsuba(sensor)), far_clip_from_mitsuba(sensor)
    size, offset = sensor.film().size(), sensor.film().crop_offset()
    whole = picture or (-offset[0], -offset[1], size[0] - offset[0], size[1] - offset[1])
    if sensor.class_name() == "OrthographicCamera":
        return DeviceCamera.upload(orthographic_camera_from_mitsuba(sensor), near, far, whole, perspective=False)
    return DeviceCamera.upload(central_camera_from_mitsuba(sensor), near, far, whole)


def _attached(camera: DeviceCamera, parameters: dict[str, Any], film_size: mi.ScalarVector2u) -> DeviceCamera:
    """The camera with derivatives with respect to the sensor's parameters, where they are part of the AD graph.

    Its numbers stay those that were read on the host, with more than single precision.
    """
    if not dr.grad_enabled(parameters):
        return camera
    to_world = parameters["to_world"].matrix
    local = dr.rcp(mi.Matrix3f([[to_world[r, c] for c in range(3)] for r in range(3)]))  # world to sensor
    rows = [[sign * local[r, c] for c in range(3)] for r, sign in enumerate((-1, -1, 1))]  # to OpenCV's axes
    if camera.perspective:
        attached = _attached_pinhole(camera, parameters, film_size)
    else:
        norms = [dr.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]) for row in rows]
        pixels = 0.5 * film_size[0]
        attached = replace(camera, fx=_follow(camera.fx, pixels * norms[0]), fy=_follow(camera.fy, pixels * norms[1]))
        rows = [[value / norm for value in row] for row, norm in zip(rows, norms, strict=True)]
    rotation = [[_follow(camera.rotation[r][c], rows[r][c]) for c in range(3)] for r in range(3)]
    position = [_follow(camera.position[r], to_world[r, 3]) for r in range(3)]
    attached = replace(attached, rotation=rotation, position=position)
    dr.make_opaque(rotation, position, attached.fx, attached.fy, attached.cx, attached.cy, attached.limits)
    return attached


def _attached_pinhole(
    camera: DeviceCamera, parameters: dict[str, Any], film_size: mi.ScalarVector2u
) -> DeviceCamera:
    """The camera with derivatives by the field of view and the principal point."""
    film_width, film_height = film_size
    focal = 0.5 * film_width / dr.tan(dr.deg2rad(0.5 * parameters["x_fov"]))
    fx, fy, cx, cy = _follow(camera.fx, focal), _follow(camera.fy, focal), camera.cx, camera.cy
    if "principal_point_offset_x" in parameters:
        cx = _follow(cx, -film_width * parameters["principal_point_offset_x"])
        cy = _follow(cy, -film_height * parameters["principal_point_offset_y"])
    left, right, top, bottom = camera.limits  # each (±centre + a number of pixels) / focal length
    limits = [
        _follow(limit, (limit * dr.detach(f) + sign * (c - dr.detach(c))) / f)
        for limit, sign, f, c in ((left, 1, fx, cx), (right, -1, fx, cx), (top, 1, fy, cy), (bottom, -1, fy, cy))
    ]
    return replace(camera, fx=fx, fy=fy, cx=cx, cy=cy, limits=limits)


def _follow(value: Any, expression: Any) -> Any:
    """``value`` with the derivative of an expression that is nearly equal."""
    return value + (expression - dr.detach(expression))
