"""A walk through a furnished room (``closed_room.py``): photographs, sparse points, and depth maps of several kinds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets.camera_paths import Shot, look_at
from mi_dogsplat.datasets.frame_cameras import intrinsics_of
from mi_dogsplat.datasets.point_ply import write_point_ply
from mi_dogsplat.datasets.traced_view import as_srgb, depth_of, first_surfaces, render_shot
from mi_dogsplat.scene.cameras import OPENCV_FROM_OPENGL, Camera
from mi_dogsplat.support.files import write_json
from mi_dogsplat.support.pictures import write_png
from PIL import Image
from scipy.spatial.transform import Rotation

from ..poses.closed_room import closed_room

SIZE, FOCAL, SPP = (320, 240), 230.0, 64
POINTS = 100  # of each view, off by a centimetre, as those of structure from motion
COARSER, NOISE, MISSING = 4, 0.01, 0.1  # of the sensor


def walk_through(out: Path, observed: Path, n: int) -> None:
    """Write a data set of ``n`` views of the room, with ``depth/`` and the ``sensor/``'s.

    ``observed``: the same once more, as COLMAP has it, which says what each view sees, with the ``inverse/`` depth.
    """
    scene, rng, frames = closed_room(), np.random.default_rng(0), []
    for folder in (out / "images", out / "depth", out / "sensor", observed / "images", observed / "inverse"):
        folder.mkdir(parents=True, exist_ok=True)
    points, colors, seen, lines = [], [], [], np.random.default_rng(1)
    path = cameras(n, rng)
    for k, camera in enumerate(path):
        name, shot = f"{k:03d}", Shot(f"{k:03d}", camera, 0.01, 100.0)
        image = as_srgb(render_shot(mi, scene, shot, SPP, k, alpha=False))
        places, found = first_surfaces(mi, scene, shot, False)
        depth = depth_of(shot, places, found)
        for data in (out, observed):
            write_png(data / "images" / f"{name}.png", image)
        np.save(out / "depth" / f"{name}.npy", depth)
        np.save(out / "sensor" / f"{name}.npy", sensed(depth, rng))
        Image.fromarray(relative_inverse(depth, lines)).save(observed / "inverse" / f"{name}.png")
        pose = (camera.c2w @ OPENCV_FROM_OPENGL).tolist()
        frames.append({"file_path": f"images/{name}.png", "transform_matrix": pose, **intrinsics_of(camera)})
        some = rng.choice(np.flatnonzero(found), POINTS)
        points.append(places.reshape(-1, 3)[some] + rng.normal(0, 0.01, (POINTS, 3)))
        colors.append(np.clip(image, 0, 1).reshape(-1, 3)[some])
        row, column = np.divmod(some, camera.width)
        seen.append(np.column_stack([column, row]) + 0.5)
    write_point_ply(out / "points.ply", np.concatenate(points).astype(np.float32), np.concatenate(colors))
    write_colmap(observed / "sparse" / "0", path, np.concatenate(points), np.concatenate(colors), seen)
    write_json(out / "transforms.json", {"ply_file_path": "points.ply", "frames": frames})


def cameras(n: int, rng: np.random.Generator) -> list[Camera]:
    """Once around in the middle of the room, with a look at what is ahead to the left, up and down."""
    width, height = SIZE
    found = []
    for turn in 2 * np.pi * np.arange(n) / n:
        place = np.array([1.2 * np.cos(turn), 0.9 * np.sin(turn), 1.4 + 0.3 * np.sin(3 * turn)])
        place += rng.normal(0, 0.05, 3)
        seen = np.array([3 * np.cos(turn + 0.9), 2.5 * np.sin(turn + 0.9), 1.1 + 0.6 * np.sin(5 * turn)])
        found.append(Camera(look_at(place, seen, "z"), FOCAL, FOCAL, width / 2, height / 2, width, height))
    return found


def write_colmap(
    out: Path, path: Sequence[Camera], points: np.ndarray, colors: np.ndarray, seen: Sequence[np.ndarray]
) -> None:
    """COLMAP's model of views that see points at the pixels ``seen`` [M, 2], each its own: the next M of the
    ``points``."""
    out.mkdir(parents=True, exist_ok=True)
    (width, height), images = SIZE, []
    (out / "cameras.txt").write_text(f"1 PINHOLE {width} {height} {FOCAL} {FOCAL} {width / 2} {height / 2}\n")
    owners = np.repeat(np.arange(len(seen)), [len(pixels) for pixels in seen])  # [P]
    for k, (camera, pixels) in enumerate(zip(path, seen, strict=True)):
        w2c = np.linalg.inv(camera.c2w)
        x, y, z, w = Rotation.from_matrix(w2c[:3, :3]).as_quat()
        images.append(" ".join(map(str, (k + 1, w, x, y, z, *w2c[:3, 3], 1, f"{k:03d}.png"))))
        of_view = zip(pixels, np.flatnonzero(owners == k), strict=True)
        images.append(" ".join(f"{column} {row} {point + 1}" for (column, row), point in of_view))
    (out / "images.txt").write_text("\n".join(images) + "\n")
    rows = zip(points, np.rint(255 * colors).astype(int), strict=True)
    written = [" ".join(map(str, (k + 1, *point, *color, 0))) for k, (point, color) in enumerate(rows)]
    (out / "points3D.txt").write_text("\n".join(written) + "\n")


def relative_inverse(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Inverse depths [H, W] on a scale and with an offset that nobody knows: uint16."""
    low, high = rng.uniform(0, 0.3), rng.uniform(0.6, 1)
    inverse = 1 / depth
    relative = (inverse - inverse.min()) / np.ptp(inverse)
    return np.rint((2**16 - 1) * (low + (high - low) * relative)).astype(np.uint16)


def sensed(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What the sensor says of depths [H, W]: float32 of fewer pixels, 0 where it says nothing."""
    coarse = depth[COARSER // 2 :: COARSER, COARSER // 2 :: COARSER]
    noisy = coarse * (1 + rng.normal(0, NOISE, coarse.shape) + rng.normal(0, NOISE))
    return np.where(rng.random(coarse.shape) < MISSING, 0, noisy).astype(np.float32)
