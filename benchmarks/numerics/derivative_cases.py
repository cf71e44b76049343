"""Every kind of parameter that ``mi.render`` is differentiable by, each moved by one number θ along a fixed direction.

A case moves a scene on the device and, where there is one, the float64 twin of its image, so that a derivative can be
compared with central differences of either. Images are 16 x 12 pixels: splats over an emitter, in linear radiance.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat import reference, to_dog
from mi_dogsplat.engine.parameters import RAW, RAW_DOG
from mi_dogsplat.reference.forward import raw_indices, raw_names
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba, opencv_w2c_to_mitsuba_c2w
from mi_dogsplat.scene.row_groups import CURVATURES, PLANES, SHIFTS, SLOPES, RowGroup
from mi_dogsplat.scene.splats import Splats
from scipy.spatial.transform import Rotation

from .moved_cameras import device_motion, far_pinhole, lens_pinholes, of_moved_world, posed

WIDTH, HEIGHT, FOCAL = 16, 12, 14.0
SEED = 1  # of the passes that are differentiated
SKY = np.array([0.3, 0.5, 0.9])  # radiance of the constant emitter
RADIUS, FOCUS = 0.5, 2.0  # of the lens, in world units
HALF_WIDTH = 2.0  # of the orthographic sensor, in world units
TWIN_SPP = 5  # of a lens
# neither at the origin nor along an axis
W2C = affine(Rotation.from_rotvec([0.054, 0.179, -0.072]).as_matrix(), (0.3, -0.1, 0.2))
CENTRED = Camera(W2C, FOCAL, FOCAL, 0.5 * WIDTH, 0.5 * HEIGHT, WIDTH, HEIGHT)
OFF_CENTRE = Camera(W2C, FOCAL, FOCAL, 0.5 * WIDTH + 0.7, 0.5 * HEIGHT - 0.4, WIDTH, HEIGHT)
CAMERAS = {"perspective": OFF_CENTRE, "thinlens": CENTRED, "orthographic": CENTRED}
AXES = ("x", "y", "z", "about x", "about y", "about z")
OBLIQUE = np.array([0.4, -0.2, 0.3, 6.0, -4.0, 8.0])  # all of them at once
LENS_WAY = np.array([0.3, 0.2, -0.3, 5.0, 6.0, -4.0])  # the same, but felt by the luminance too
TEXELS = np.random.default_rng(2).uniform(0.2, 1, (8, 17, 3))  # as Mitsuba wants them: a column more than the picture


@dataclass(frozen=True)
class Case:
    """A parameter, or a direction in several."""

    name: str
    move: Callable[[Any, Any], dict]  # (parameters at 0, θ) to those at θ
    twin: Callable[[Splats, float], np.ndarray] | None = None  # (model, θ) to the image [H, W, 3], one sample per pixel
    sensor: str = "perspective"
    sky: str = "constant"
    step: float = 0.1  # longest of the steps that differences try
    least_spp: int = 1  # with fewer samples it has no effect
    model: Callable[[Splats], Splats] = lambda splats: splats  # what the case needs of the given one


def broad_splats() -> Splats:
    """Faint and so broad that no pixel comes near a cutoff: differences may take steps that float32 can resolve.

    Half of them are DoG; the pseudo-Gaussian is smaller in every direction, so that alpha never passes through zero.
    """
    rng, n = np.random.default_rng(5), 8
    inside = np.column_stack([rng.uniform(-0.6, 0.6, (n, 2)), np.linspace(2, 4.1, n)])  # in camera space
    dog = np.arange(0, n, 2, dtype=np.uint32)
    opacities = rng.uniform(0.2, 0.6, n)
    coefficients = np.concatenate([rng.uniform(-1.2, 1.2, (n, 1, 3)), rng.normal(0, 0.1, (n, 3, 3))], 1)
    return Splats(
        means=(inside - W2C[:3, 3]) @ W2C[:3, :3],
        log_scales=np.log(rng.uniform(1.0, 1.9, (n, 3))),
        quats=rng.normal(size=(n, 4)),
        logit_opacities=np.log(opacities / (1 - opacities)),
        sh_coeffs=coefficients,
        dog_index=dog,
        dog_logit_opacities=rng.uniform(-1.2, -0.4, len(dog)),
        dog_log_scales=np.log(rng.uniform(0.3, 0.7, (len(dog), 3))),
    )


def with_rows(group: RowGroup, size: float, splats: Splats) -> Splats:
    """The same where every second primitive is in the group, of DoG primitives and of others, with values of a size."""
    index, rng = np.flatnonzero(np.arange(splats.n_splats) % 4 > 1), np.random.default_rng(6)
    values = {name: rng.normal(0, size, (len(index), *row)) for name, row in group.arrays.items()}
    return replace(splats, **{group.index: index}, **values)


def dog_dict(splats: Splats, **others: Any) -> dict[str, Any]:
    """The shape as a dict for ``mi.load_dict``, with other properties of the shape."""
    return {**to_dog(splats), **others}


def smooth_sky() -> np.ndarray:
    """So fine and smooth that the kinks of its interpolation do not matter."""
    y, x = np.mgrid[0:256, 0:512] * 2 * np.pi / 512
    return np.stack([2 + np.sin(2 * x + y), 2 + np.cos(3 * x - 4 * y), 2 + np.sin(x) * y], -1).astype(np.float32)


def scene_with(case: Case, splats: Splats, film: dict[str, Any]) -> mi.Scene:
    """The scene at θ = 0; ``film``: what differs from an RGB film with a box filter."""
    sensor = camera_to_mitsuba(CAMERAS[case.sensor])
    sensor["film"] |= {"pixel_format": "rgb", **film}
    if case.sensor == "thinlens":
        sensor = {name: value for name, value in sensor.items() if not name.startswith("principal")}
        sensor |= {"type": "thinlens", "aperture_radius": RADIUS, "focus_distance": FOCUS}
    elif case.sensor == "orthographic":
        scaled = sensor["to_world"] @ mi.ScalarTransform4f().scale([HALF_WIDTH, HALF_WIDTH, 1])
        sensor = {"type": "orthographic", "film": sensor["film"], "to_world": scaled}
    emitters = {"constant": {"type": "constant", "radiance": {"type": "rgb", "value": SKY.tolist()}},
                "envmap": {"type": "envmap", "bitmap": mi.Bitmap(smooth_sky())}}
    return mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat"}, "sensor": sensor,
                         "splats": dog_dict(case.model(splats)), "sky": emitters[case.sky]})


def linear(blended: np.ndarray) -> np.ndarray:
    """sRGB to linear values in float64 (IEC 61966-2-1)."""
    return np.where(blended <= 0.04045, blended / 12.92, ((np.maximum(blended, 0.04) + 0.055) / 1.055) ** 2.4)


def twin_image(splats: Any, camera: Camera = OFF_CENTRE, sky: np.ndarray = SKY) -> np.ndarray:
    """Linear radiance [H, W, 3] of splats over a constant emitter, float64; ``sky`` above the curve's foot."""
    return linear(reference.render(splats, camera, 1.055 * sky ** (1 / 2.4) - 0.055)[0])


def cases() -> list[Case]:
    """In the order of the table."""
    return [*_of_splats(), *_of_perspective(), *_of_lens(), *_of_parallel_rays(), *_of_shape(), *_of_emitters()]


def _direction(name: str, shape: tuple[int, ...]) -> np.ndarray:
    return np.random.default_rng(zlib.crc32(name.encode())).normal(size=shape)


def _of_splats() -> list[Case]:
    def move(name, at_0, θ):
        value = at_0[f"splats.{name}"]
        return {f"splats.{name}": value + mi.TensorXf(_direction(name, value.shape).astype(np.float32)) * θ}

    def twin(name, splats, θ):
        raw = {key: np.array(getattr(splats, key), np.float64) for key in raw_names(splats)}
        raw[name] += θ * _direction(name, raw[name].shape)
        return twin_image(SimpleNamespace(**raw, **raw_indices(splats)))

    def of_group(group, size):
        model = partial(with_rows, group, size)
        return [Case(f"`{name}`", partial(move, name), lambda splats, θ, name=name: twin(name, model(splats), θ),
                     step=0.4, model=model) for name in group.names]

    whole = [Case(f"`{name}`", partial(move, name), partial(twin, name), step=0.4) for name in RAW + RAW_DOG]
    groups = [(SLOPES, 0.1), (CURVATURES, 0.1), *((plane, 2.0) for plane in PLANES), (SHIFTS, 0.05)]
    return [*whole, *(case for group in groups for case in of_group(*group))]


def _axis(k: int) -> np.ndarray:
    return np.eye(6)[k] * (1 if k < 3 else 10)


def _motion(p: np.ndarray, θ: Any) -> Any:
    """Of numbers that kernels read, as those that held them would be compiled for each direction."""
    return device_motion([dr.opaque(mi.Float, float(v)) * θ for v in p])


def _pose(camera: Camera) -> Any:
    return mi.Transform4f(mi.ScalarTransform4f(opencv_w2c_to_mitsuba_c2w(camera.w2c)).matrix)


def _of_perspective() -> list[Case]:
    def moved(p, at_0, θ):
        return {"sensor.to_world": _pose(OFF_CENTRE) @ _motion(p, θ)}

    def added(name, at_0, θ):
        return {f"sensor.{name}": at_0[f"sensor.{name}"] + θ}

    def optics(splats, fov=0.0, x=0.0, y=0.0):
        c, angle = OFF_CENTRE, 2 * np.arctan(0.5 * WIDTH / FOCAL) + np.radians(fov)
        f = 0.5 * WIDTH / np.tan(0.5 * angle)
        return twin_image(splats, Camera(c.w2c, f, f, c.cx - WIDTH * x, c.cy - HEIGHT * y, WIDTH, HEIGHT))

    along = [Case(f"`to_world` of perspective, {name}", partial(moved, _axis(k)),
                  lambda splats, θ, k=k: twin_image(splats, posed(OFF_CENTRE, _axis(k) * θ)))
             for k, name in enumerate(AXES)]
    oblique = Case("the same over an envmap, all at once", partial(moved, OBLIQUE), sky="envmap")
    return [*along, oblique,
            Case("`x_fov`", partial(added, "x_fov"), lambda splats, θ: optics(splats, fov=θ), step=4.0),
            *(Case(f"`principal_point_offset_{axis}`", partial(added, f"principal_point_offset_{axis}"),
                   lambda splats, θ, axis=axis: optics(splats, **{axis: θ})) for axis in "xy")]


def _of_lens() -> list[Case]:
    def twin(splats, radius=0.0, focus=0.0, p=OBLIQUE * 0):
        pinholes = lens_pinholes(CENTRED, RADIUS + radius, FOCUS + focus, p, TWIN_SPP, SEED)
        return np.mean([twin_image(splats, pinhole) for pinhole in pinholes], axis=0)

    return [
        Case("`aperture_radius` of thinlens", lambda at_0, θ: {"sensor.aperture_radius": RADIUS + θ},
             lambda splats, θ: twin(splats, radius=θ), "thinlens", step=0.4, least_spp=2),
        Case("`focus_distance`", lambda at_0, θ: {"sensor.focus_distance": FOCUS + θ},
             lambda splats, θ: twin(splats, focus=θ), "thinlens", step=0.4, least_spp=2),
        Case("`to_world` of thinlens, all at once",
             lambda at_0, θ: {"sensor.to_world": _pose(CENTRED) @ _motion(LENS_WAY, θ)},
             lambda splats, θ: twin(splats, p=LENS_WAY * θ), "thinlens", least_spp=2),
    ]


def _of_parallel_rays() -> list[Case]:
    def move(p, size, at_0, θ):
        half = HALF_WIDTH + dr.opaque(mi.Float, float(size)) * θ
        return {"sensor.to_world": _pose(CENTRED) @ _motion(p, θ) @ mi.Transform4f().scale(mi.Point3f(half, half, 1))}

    def twin(p, size, splats, θ):
        return twin_image(splats, far_pinhole(CENTRED, p * θ, HALF_WIDTH + size * θ))

    directions = {"all at once": (OBLIQUE, 0), "size": (OBLIQUE * 0, 1)}
    return [Case(f"`to_world` of orthographic, {name}", partial(move, *way), partial(twin, *way), "orthographic")
            for name, way in directions.items()]


def _of_shape() -> list[Case]:
    moved = [Case(f"`to_world` of dog, {name}", lambda at_0, θ, k=k: {"splats.to_world": _motion(_axis(k), θ)},
                  lambda splats, θ, k=k: twin_image(splats, of_moved_world(OFF_CENTRE, _axis(k) * θ)))
             for k, name in enumerate(AXES)]
    return [*moved, Case(
        "`to_world` of dog, scale", lambda at_0, θ: {"splats.to_world": mi.Transform4f().scale(mi.Point3f(1 + θ))},
        lambda splats, θ: twin_image(splats, of_moved_world(OFF_CENTRE, np.zeros(6), 1 + θ)))]


def _of_emitters() -> list[Case]:
    tint, texels = _direction("radiance", (3,)), _direction("texels", TEXELS.shape)

    def repainted(at_0, θ):
        return {"sky.data": mi.TensorXf(TEXELS.astype(np.float32)) + mi.TensorXf(texels.astype(np.float32)) * θ}

    def tinted(at_0, θ):
        return {"sky.radiance.value": mi.Color3f([float(SKY[c]) + float(tint[c]) * θ for c in range(3)])}

    return [
        Case("`radiance` of constant", tinted,
             lambda splats, θ: twin_image(splats, sky=SKY + θ * tint)),
        Case("`data` of envmap", repainted, sky="envmap", step=0.05),
        Case("`scale` of envmap", lambda at_0, θ: {"sky.scale": 1 + θ}, sky="envmap"),
    ]
