"""Small scenes that the tests share, and the engine's answers to them as NumPy arrays."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.parameters import RAW, RAW_OF_GROUPS, upload
from mi_dogsplat.engine.rasterize import Frame, RasterOptions, rasterize
from mi_dogsplat.reference.forward import raw_indices, raw_names
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from mi_dogsplat.scene.splats import Splats

from benchmarks.numerics.derivative_cases import dog_dict

C0 = 0.28209479177387814


def logit(p):
    return np.log(p) - np.log1p(-np.asarray(p, float))


def make_camera(width=64, height=48, f=60.0, cx=None, cy=None, w2c=None) -> Camera:
    """Pixels a little higher than wide, the principal point in the middle unless told otherwise."""
    return Camera(np.eye(4) if w2c is None else w2c, f, 1.1 * f, width / 2 if cx is None else cx,
                  height / 2 if cy is None else cy, width, height)


def make_splats(means, scales: Any = 0.1, opacities: Any = 0.5, colors: Any = 1.0, quats: Any = (0, 0, 0, 1),
                dog: Any = (), f_a: Any = 0.5, F: Any = 1.6) -> Any:
    """Float64 (the closed forms need it), SH degree 0; scalars are spread over the N primitives."""
    means = np.asarray(means, float).reshape(-1, 3)
    n, m = len(means), len(dog)
    return SimpleNamespace(
        means=means,
        log_scales=np.log(np.broadcast_to(scales, (n, 3))),
        quats=np.broadcast_to(np.asarray(quats, float), (n, 4)),
        logit_opacities=logit(np.broadcast_to(opacities, n)),
        sh_coeffs=(np.broadcast_to(colors, (n, 3))[:, None, :] - 0.5) / C0,
        dog_index=np.asarray(dog, np.uint32),
        dog_logit_opacities=logit(np.broadcast_to(f_a, m)),
        dog_log_scales=np.log(np.broadcast_to(F, (m, 3))),
    )


def random_splats(n=40, seed=0, degree=3, dog_share=0.5, slope_share=0.0, cut_share=0.0,
                  second_cut_share=0.0, curvature_share=0.0, shift_share=0.0) -> Any:  # fmt: skip
    """Of all sizes, opacities and orientations, in front of a camera at the origin; float64."""
    rng = np.random.default_rng(seed)
    splats = make_splats(
        rng.uniform([-1.5, -1.2, 1.5], [1.5, 1.2, 5], (n, 3)), np.exp(rng.uniform(-3.5, -0.8, (n, 3))),
        rng.uniform(0.02, 0.98, n), rng.uniform(0, 1, (n, 3)), rng.normal(size=(n, 4)),
        dog=np.flatnonzero(rng.uniform(size=n) < dog_share))
    m = len(splats.dog_index)
    splats.dog_logit_opacities, splats.dog_log_scales = rng.normal(size=m), rng.normal(0.2, 0.4, (m, 3))
    rest = rng.normal(0, 0.2, (n, (degree + 1) ** 2 - 1, 3))
    splats.sh_coeffs = np.concatenate([splats.sh_coeffs, rest], axis=1)
    if slope_share:
        splats.slope_index = np.flatnonzero(rng.uniform(size=n) < slope_share)
        splats.color_slopes = rng.normal(0, 0.3, (len(splats.slope_index), 3, 3))
    if cut_share:
        splats.cut_index = np.flatnonzero(rng.uniform(size=n) < cut_share)
        splats.cut_normals = rng.normal(0, 4, (len(splats.cut_index), 3))
    if second_cut_share:
        splats.second_cut_index = np.flatnonzero(rng.uniform(size=n) < second_cut_share)
        splats.second_cut_normals = rng.normal(0, 4, (len(splats.second_cut_index), 3))
    if curvature_share:
        splats.curvature_index = np.flatnonzero(rng.uniform(size=n) < curvature_share)
        splats.brightness_curvatures = rng.normal(0, 0.2, (len(splats.curvature_index), 6))
    if shift_share:
        splats.shift_index = np.flatnonzero(rng.uniform(size=n) < shift_share)
        splats.view_shifts = rng.normal(0, 0.5, (len(splats.shift_index), 3, 3))
        splats.mean_views = rng.uniform(-0.5, 0.5, (len(splats.shift_index), 3))
    return splats


def constant_layers(alphas) -> Any:
    """Layers of one alpha each, front to back. A negative one is the pseudo-Gaussian of a point beside the image."""
    alphas = np.array(alphas)
    negative, depths = alphas < 0, np.linspace(1, 2, len(alphas))
    means = np.column_stack([np.where(negative, -depths, 0), 0 * depths, depths])
    return make_splats(means, np.where(negative, 1e-12, 1e5)[:, None],
                       np.where(negative, 0.985, alphas), (0.3, 0.6, 0.9), dog=np.flatnonzero(negative),
                       f_a=-alphas[negative] / 0.985, F=1e17)


def axis_rotation(axis, angle):
    """Matrix and quaternion (x, y, z, w) of a rotation."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    quat = np.append(np.sin(angle / 2) * axis, np.cos(angle / 2))
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K, quat


def fine(camera: Camera, factor: int) -> Camera:
    """More pixels of the same view: a pass through many pixels costs little more than one through few."""
    f, cx, cy = factor * camera.fx, factor * camera.cx, factor * camera.cy
    return Camera(camera.w2c, f, f, cx, cy, factor * camera.width, factor * camera.height)


def tilted_camera(width=64, height=48, f=60.0, cx=None, cy=None) -> Camera:
    """One that is neither at the origin nor along an axis, so that no rotation can be forgotten."""
    return make_camera(width, height, f, cx, cy, affine(axis_rotation([0.3, 1, -0.4], 0.2)[0], (0.3, -0.1, 0.2)))


def opaque_only(splats: Any, kept: np.ndarray) -> Any:
    """The others become invisible, so that rows stay where they are."""
    rows = {name: np.array(getattr(splats, name), float) for name in raw_names(splats)}
    copy = SimpleNamespace(**rows, **raw_indices(splats))
    copy.logit_opacities[~kept] = -np.inf
    return copy


def rounded(splats: Any) -> Splats:
    """The same model in float32, which the engine and its float64 twin then both start from."""
    return Splats(**vars(splats))


def select(splats: Any, n: int) -> Splats:
    """The first n primitives, as float32."""
    return rounded(splats).select(np.arange(n))


def options(splats: Splats, **others) -> RasterOptions:
    return RasterOptions(sh_degree=splats.sh_degree, **others)


SMOOTH_OPTIONS: dict[str, Any] = {"cutoffs": SMOOTH}


def attached(splats: Splats) -> dict:
    """Parameters on the device, every one of them part of the AD graph."""
    params = upload(splats)
    for name in RAW + RAW_OF_GROUPS:
        if name in params:
            dr.enable_grad(params[name])
    return params


def rasterized(splats: Splats, camera: Camera, **others) -> Frame:
    return rasterize(upload(splats), DeviceCamera.upload(camera), options(splats, **others))


def image_of(frame: Frame, camera: Camera, background=(0, 0, 0)) -> np.ndarray:
    """[H, W, 3] over a background."""
    T = dr.detach(frame.T).numpy()
    planes = [dr.detach(c).numpy() + T * b for c, b in zip(frame.colors, background, strict=True)]
    return np.stack(planes, -1).reshape(camera.height, camera.width, 3)


def plane_of(plane: mi.Float, camera: Camera) -> np.ndarray:
    """[H, W]"""
    return dr.detach(plane).numpy().reshape(camera.height, camera.width)


def seen_at(splats: Any, camera: Camera, x: float, y: float, border: int = 0) -> np.ndarray:
    """[H, W, 4] by the float64 twin, with alpha: what is at x, y in the pixels, and in as many around the picture."""
    center = camera.cx + 0.5 - x + border, camera.cy + 0.5 - y + border
    size = camera.width + 2 * border, camera.height + 2 * border
    color, T, _ = reference.render(splats, Camera(camera.w2c, camera.fx, camera.fy, *center, *size))
    return np.dstack([color, 1 - T])


def square_camera(width=40, height=30, f=36.0, cx=None, cy=None) -> Camera:
    """A tilted camera that Mitsuba can have too: its pixels are square."""
    camera = tilted_camera(width, height, f, cx, cy)
    return Camera(camera.w2c, f, f, camera.cx, camera.cy, width, height)


def scalar_transform(matrix: Any) -> mi.ScalarTransform4f:
    return mi.ScalarTransform4f(matrix)


def sensor_dict(camera: Camera, **film) -> dict[str, Any]:
    sensor = camera_to_mitsuba(camera)
    sensor["film"].update({"pixel_format": "rgb", **film})
    return sensor


def scene_of(splats: Splats, camera: Camera, shape: dict | None = None, film: dict | None = None,
             extra: dict | None = None, **integrator) -> mi.Scene:
    scene = mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat", **integrator},
                          "sensor": sensor_dict(camera, **(film or {})),
                          "splats": dog_dict(splats, **(shape or {})), **(extra or {})})
    assert isinstance(scene, mi.Scene)
    return scene


def mismatches(got: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> str:
    """Every entry off by more than 1 % (and by more than rounding: 1e-4 of the largest of its kind), as a table."""
    lines = []
    for name, values in got.items():
        assert np.isfinite(values).all(), f"{name} is not finite"
        tolerance = 1e-2 * np.abs(expected[name]) + 1e-4 * np.abs(expected[name]).max(initial=0)
        for index in zip(*np.nonzero(np.abs(values - expected[name]) > tolerance), strict=True):
            place = f"{name}[{', '.join(map(str, index))}]"
            lines.append(f"{place:<32}{values[index]:>14.6g}{expected[name][index]:>14.6g}")
    return "\n".join([f"{'':<32}{'engine':>14}{'differences':>14}", *lines]) if lines else ""


def assert_gradients_equal(got: dict[str, np.ndarray], expected: dict[str, np.ndarray]):
    assert set(got) == {name for name in expected if expected[name].size}
    assert all(np.abs(expected[name]).max() > 1e-4 for name in got)
    table = mismatches(got, expected)
    assert not table, "\n" + table


def differences(splats: Splats, loss: Callable[[Splats], Any], eps=1e-5, n_losses=0) -> dict[str, np.ndarray]:
    """Central differences of a loss of float64 parameters by every one of their entries; of several losses, which come
    as one array, along a last axis of the results."""
    raw = {name: np.array(getattr(splats, name), np.float64) for name in raw_names(splats)}
    perturbed = cast("Splats", SimpleNamespace(**raw, **raw_indices(splats)))
    result = {name: np.zeros((*values.shape, n_losses) if n_losses else values.shape) for name, values in raw.items()}
    for name, values in raw.items():
        for index in np.ndindex(values.shape):
            value, sides = values[index], []
            for side in (eps, -eps):
                values[index] = value + side
                sides.append(loss(perturbed))
            values[index] = value
            result[name][index] = (sides[0] - sides[1]) / (2 * eps)
    return result


def kernels(run: Callable[[], Any]) -> set[str]:
    """Hashes of the kernels launched while ``run`` ran. One that is new may have to be compiled (or is on disk)."""
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        run()
        dr.sync_thread()
        return {k["hash"] for k in dr.kernel_history([dr.KernelType.JIT])}


def variable_in_the_place_of(index: int, value: float, size: int) -> Any:
    """A new variable, with the index of one that is gone if Dr.Jit gives it out again."""
    others = []
    for _ in range(500):
        others.append(dr.opaque(mi.Float, value, size))
        if others[-1].index == index:
            break
    return others[-1]


def to_linear(v: np.ndarray) -> np.ndarray:
    """Display values to linear ones, as IEC 61966-2-1 has it, beyond 0..1 too."""
    return np.where(v <= 0.04045, v / 12.92, (np.maximum(v, 0.04045) + 0.055) ** 2.4 / 1.055**2.4)


def to_srgb(v: np.ndarray) -> np.ndarray:
    return np.where(v <= 0.0031308, v * 12.92, 1.055 * np.maximum(v, 0.0031308) ** (1 / 2.4) - 0.055)
