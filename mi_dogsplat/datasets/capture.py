"""Makes a data set out of a Mitsuba scene: orbit cameras, their renders, and first hits as initial points.

The result is a folder that ``load_dataset`` reads: ``transforms_train.json``, ``transforms_test.json``,
``images/*.png`` and ``points.ply``. Cameras and points are exact, so only the splats limit what is learned.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from ..cameras import OPENCV_FROM_OPENGL, Camera, camera_to_mitsuba, inverse_rigid
from ..errors import DataError
from ..files import replacing
from ..pictures import write_png
from ..srgb import linear_to_srgb

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def capture(
    scene_path: str | Path,
    out: str | Path,
    *,
    n_views: int = 48,
    n_test: int = 8,
    width: int = 256,
    height: int = 256,
    spp: int = 121,
    seed: int = 0,
    fov: float = 40.0,
    up: str = "z",
    elevations: tuple[float, float] = (12.0, 65.0),
    zoom: float = 1.0,
    n_points: int = 8000,
    alpha: bool = False,
) -> Path:
    """Render ``n_views`` training and ``n_test`` test views of a scene into the folder ``out``, and return
    it.

    The scene's own integrator renders ``spp`` samples per pixel (rounded up to a square number). Cameras
    stand on a sphere around the middle of everything that does not shine, between two ``elevations`` in
    degrees above the plane across ``up`` (an axis, "x", "y" or "z"). ``fov`` is that of the longer side in
    degrees; at ``zoom`` 1 the bounding sphere just fits, at 2 it is twice as large. ``n_points`` first hits
    become ``points.ply``. With ``alpha`` the images keep the film's coverage (straight alpha), which is meant
    for an integrator with ``hide_emitters``. A Mitsuba variant must be set. The JSON files come last: an
    interrupted capture is no data set.

    Raises ``DataError`` for a scene that cannot be loaded, shows nothing or renders to NaN, and
    ``ValueError`` for numbers that make no orbit.
    """
    import mitsuba as mi

    if n_views < 1 or n_test < 0:
        raise ValueError(f"capture: n_views is {n_views} and n_test {n_test}; need at least 1 and 0")
    scene_path, out = Path(scene_path), Path(out)
    scene = _load_scene(mi, scene_path)
    center, radius = _bounding_sphere(scene_path, scene)
    focal = 0.5 * max(width, height) / math.tan(math.radians(fov) / 2)
    narrow = math.atan(0.5 * min(width, height) / focal)  # half the angle of the shorter side
    distance = radius / math.sin(narrow) / zoom
    intrinsics = (focal, focal, width / 2, height / 2, width, height)
    positions = center + distance * spiral(n_views + n_test, up, elevations)  # [V, 3]
    cameras = [Camera(look_at(position, center, up), *intrinsics) for position in positions]
    tests = {int((k + 0.5) * len(cameras) / n_test) for k in range(n_test)}  # evenly along the spiral

    for name in ("train", "test"):  # of an earlier capture, whose cameras are not these
        (out / f"transforms_{name}.json").unlink(missing_ok=True)
    names = [f"images/{i:03d}.png" for i in range(len(cameras))]
    rng = np.random.default_rng(seed)
    points, colors = [], []
    for i, camera in enumerate(tqdm(cameras, desc=f"capture {scene_path.name}", unit="view", disable=None)):
        image = _render(mi, scene, camera, spp, seed * len(cameras) + i, distance, alpha)  # [H, W, 3 or 4]
        if not np.isfinite(image).all():
            raise DataError(scene_path, f"view {i} renders to NaN or infinity", "correct the scene")
        write_png(out / names[i], image)
        if i not in tests:
            hits, pixels = _first_hits(mi, scene, camera)
            some = rng.permutation(len(hits))[: math.ceil(n_points / n_views)]
            points.append(hits[some])
            colors.append(image[pixels[some, 1], pixels[some, 0], :3])
    all_points, all_colors = np.concatenate(points), np.concatenate(colors)
    if not len(all_points):
        raise DataError(scene_path, "no camera sees a surface", "give a scene with shapes, and check zoom")
    kept = rng.permutation(len(all_points))[:n_points]
    write_point_ply(out / "points.ply", all_points[kept], all_colors[kept])
    # Train last: with it alone a reader would choose its own test views.
    for split, members in (("test", tests), ("train", set(range(len(cameras))) - tests)):
        if members:
            content = _transforms([(names[i], cameras[i]) for i in sorted(members)])
            with replacing(out / f"transforms_{split}.json") as part:
                part.write_text(json.dumps(content, indent=1), encoding="utf-8")
    return out


def spiral(n: int, up: str, elevations: tuple[float, float]) -> np.ndarray:
    """Unit vectors float64 [n, 3] on a Fibonacci spiral, evenly spread over a band of elevations."""
    if up not in ("x", "y", "z"):
        raise ValueError(f'orbit: up is "{up}"; need "x", "y" or "z"')
    if not -90 < elevations[0] <= elevations[1] < 90:
        raise ValueError(f"orbit: elevations are {elevations}; need two ascending ones within -90 and 90")
    low, high = np.sin(np.radians(elevations))
    rise = low + (high - low) * (np.arange(n) + 0.5) / n  # [n] equal steps are equal areas of the sphere
    flat = np.sqrt(1 - rise**2)
    angle = GOLDEN_ANGLE * np.arange(n)
    directions = np.stack([flat * np.cos(angle), flat * np.sin(angle), rise], axis=1)  # [n, 3], up is z
    return np.roll(directions, {"x": 1, "y": 2, "z": 0}[up], axis=1)


def look_at(position: np.ndarray, target: np.ndarray, up: str) -> np.ndarray:
    """OpenCV world-to-camera [4, 4] of a camera that looks at ``target``, with the axis ``up`` upright."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, np.eye(3)["xyz".index(up)])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c2w = np.eye(4)
    c2w[:3] = np.stack([right, down, forward, position], axis=1)
    return inverse_rigid(c2w)


def write_point_ply(path: Path, points: np.ndarray, colors: np.ndarray) -> None:
    """Write points [P, 3] and sRGB colours [P, 3] in 0..1 as a binary PLY with 8-bit colours."""
    rows = np.empty(len(points), [("xyz", "<f4", 3), ("rgb", "u1", 3)])  # [P]
    rows["xyz"] = points
    rows["rgb"] = np.round(np.clip(colors, 0, 1) * 255)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in "xyz"]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    with replacing(path) as part:
        part.write_bytes("\n".join([*header, "end_header\n"]).encode() + rows.tobytes())


def _load_scene(mi: Any, path: Path) -> Any:
    if mi.variant() is None:
        raise DataError(path, "no Mitsuba variant is set", 'call mi.set_variant("llvm_ad_rgb") first')
    if not path.is_file():
        raise DataError(path, "no such file", "give a Mitsuba scene as .xml file")
    try:
        scene = mi.load_file(str(path))
    except Exception as error:  # Mitsuba raises several kinds, all of them with a message to show
        raise DataError(path, f"Mitsuba cannot load it ({error})", "correct the scene") from error
    if not isinstance(scene, mi.Scene):
        raise DataError(path, "its root is no scene", "give a file with a <scene> element")
    return scene


def _bounding_sphere(path: Path, scene: Any) -> tuple[np.ndarray, float]:
    """(centre [3], radius) of a sphere around the bounding box of all shapes but the lamps, which stand far
    off."""
    boxes = [shape.bbox() for shape in scene.shapes() if not shape.is_emitter()]
    if not boxes:
        raise DataError(path, "the scene has no shape besides its lamps", "add something to look at")
    low = np.min([np.array(box.min, dtype=np.float64).reshape(3) for box in boxes], axis=0)
    high = np.max([np.array(box.max, dtype=np.float64).reshape(3) for box in boxes], axis=0)
    radius = float(np.linalg.norm(high - low)) / 2
    if not 0 < radius < math.inf:
        raise DataError(path, f"its bounding box is {low} to {high}", "remove what is infinite or empty")
    return (low + high) / 2, radius


def _render(mi: Any, scene: Any, camera: Camera, spp: int, seed: int, distance: float, alpha: bool) -> np.ndarray:
    """sRGB values float32 [H, W, 3] of what the scene's own integrator shows to the camera, or with straight
    alpha [H, W, 4]."""
    side = math.ceil(math.sqrt(spp))
    sensor = camera_to_mitsuba(camera, near_clip=1e-3 * distance, far_clip=1e3 * distance)
    sensor["sampler"] = {"type": "multijitter", "sample_count": side**2}
    sensor["film"]["pixel_format"] = "rgba" if alpha else "rgb"
    loaded = mi.load_dict(sensor)
    mi.render(scene, sensor=loaded, spp=side**2, seed=seed)
    bitmap = loaded.film().bitmap()
    if bitmap.pixel_format() == mi.Bitmap.PixelFormat.MultiChannel:  # AOVs come along
        bitmap = dict(bitmap.split())["<root>"]
    pixel_format = mi.Bitmap.PixelFormat.RGBA if alpha else mi.Bitmap.PixelFormat.RGB
    linear = np.array(bitmap.convert(pixel_format, mi.Struct.Type.Float32, False))
    if not alpha:
        return linear_to_srgb(linear)
    color, coverage = linear[..., :3], linear[..., 3:]
    straight = np.divide(color, coverage, out=np.zeros_like(color), where=coverage > 0)
    return np.concatenate([linear_to_srgb(straight), np.clip(coverage, 0, 1)], axis=-1)


def _first_hits(mi: Any, scene: Any, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Surface points [P, 3] behind the centres of all pixels that show one, and those pixels [P, 2] (column,
    row)."""
    pixels = np.indices((camera.width, camera.height)).reshape(2, -1).T  # [n, 2], n = width x height
    rays = (pixels + 0.5 - (camera.cx, camera.cy)) / (camera.fx, camera.fy)  # [n, 2] at depth 1
    directions = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) @ camera.w2c[:3, :3]  # [n, 3]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origin = np.float32(camera.position[:, None])  # [3, 1]; an array, as numbers would recompile each time
    ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(directions.T.astype(np.float32)))
    hit = scene.ray_intersect_preliminary(ray)
    found = np.array(hit.is_valid()).astype(bool)  # [n]
    points = camera.position + np.array(hit.t, dtype=np.float64)[found, None] * directions[found]  # [P, 3]
    return points, pixels[found]


def _transforms(frames: list[tuple[str, Camera]]) -> dict[str, Any]:
    """Content of a ``transforms_*.json``: frames share intrinsics, poses are OpenGL camera-to-world."""
    first = frames[0][1]
    poses = [(name, (camera.c2w @ OPENCV_FROM_OPENGL).tolist()) for name, camera in frames]
    return {
        "w": first.width, "h": first.height,
        "fl_x": first.fx, "fl_y": first.fy, "cx": first.cx, "cy": first.cy,
        "ply_file_path": "points.ply",
        "frames": [{"file_path": name, "transform_matrix": pose} for name, pose in poses],
    }  # fmt: skip
