"""A video of a Mitsuba scene whose exact camera is known for each frame: motion blur, and an exposure that adapts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets.camera_paths import Shot, look_at
from mi_dogsplat.datasets.traced_view import render_shot
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.srgb import linear_to_srgb

TEXELS = 256


def textured_room() -> Any:
    """A floor, two walls and boxes, all with blotches of many sizes: some 3 units wide, up is z."""
    white = {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}
    room: dict[str, Any] = {"type": "scene", "integrator": {"type": "path", "max_depth": 3}, "light": white}
    T = mi.ScalarTransform4f
    planes = [
        T().scale(2.5),
        T().translate([0, 2.5, 2.5]).rotate([1, 0, 0], 90).scale(2.5),
        T().translate([-2.5, 0, 2.5]).rotate([0, 1, 0], 90).scale(2.5),
    ]
    boxes = [(0.2, 0.4, 0.5, 20.0), (-0.9, -0.3, 0.35, 50.0), (1.0, -0.5, 0.25, -10.0), (-0.3, -1.1, 0.3, 5.0)]
    for k, plane in enumerate(planes):
        room[f"plane{k}"] = {"type": "rectangle", "to_world": plane, "bsdf": _blotches(k)}
    for k, (x, y, half, turn) in enumerate(boxes):
        pose = T().translate([x, y, half]).rotate([0, 0, 1], turn).scale(half)
        room[f"box{k}"] = {"type": "cube", "to_world": pose, "bsdf": _blotches(10 + k)}
    return mi.load_dict(room)


def _blotches(seed: int) -> dict[str, Any]:
    """A diffuse material whose texture is noise of five octaves, clipped so that it has edges."""
    rng, picture = np.random.default_rng(seed), np.zeros((TEXELS, TEXELS, 3))
    for octave in range(5):
        side = TEXELS >> (octave + 1)
        picture += np.kron(rng.normal(size=(side, side, 3)), np.ones((TEXELS // side, TEXELS // side, 1)))
    bitmap = mi.Bitmap(np.clip(0.45 + 0.2 * picture, 0.03, 0.95).astype(np.float32))
    texture = {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear"}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}}


def arc(n: int, width: int, height: int, turn: float = 1.4, rise: float = 0.5) -> list[Camera]:
    """``n`` cameras on a rising arc of ``turn`` radians that look into the room."""
    focal, cameras = 0.9 * width, []
    for t in np.linspace(0, 1, n):
        angle = -np.pi / 4 + turn * (t - 0.5)
        position = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.5 + rise * t])
        intrinsics = (focal, focal, width / 2, height / 2, width, height)
        cameras.append(Camera(look_at(position, np.array([0, 0, 0.4]), "z"), *intrinsics))
    return cameras


def picture(scene: Any, cameras: Sequence[Camera], spp: int, exposure: float = 1.0, seed: int = 0) -> np.ndarray:
    """sRGB uint8 [H, W, 3]: the mean light of an exposure during which the camera passes through ``cameras``."""
    shots = [Shot("", camera, 0.01, 100.0) for camera in cameras]
    seen = [render_shot(mi, scene, shot, spp, seed + k, False) for k, shot in enumerate(shots)]
    light = np.mean(seen, axis=0)
    return np.rint(np.clip(linear_to_srgb(exposure * light), 0, 1) * 255).astype(np.uint8)


def film(
    scene: Any, cameras: Sequence[Camera], shutter: int, spp: int, exposure: Callable[[float], float] = lambda t: 1.0
) -> Iterable[tuple[Camera, np.ndarray]]:
    """(camera at the middle of the exposure, picture) of each frame.

    ``cameras`` are those of the whole path, 2 ``shutter`` of them for each frame, of whose exposure the first half are:
    a shutter of 180°. ``exposure`` of the time in 0..1 multiplies the light.
    """
    step = 2 * shutter
    for at in range(0, len(cameras) - step + 1, step):
        open_shutter = cameras[at : at + shutter]
        yield open_shutter[shutter // 2], picture(scene, open_shutter, spp, exposure(at / len(cameras)), at)


def write_video(path: Path, frames: Iterable[np.ndarray], aspect: Fraction = Fraction(1)) -> int:
    """Encode uint8 frames [H, W, 3], 30 per second; returns how many. ``aspect``: width of a pixel over its height."""
    import av

    n = 0
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=Fraction(30), options={"crf": "18"})
        stream.pix_fmt, stream.codec_context.sample_aspect_ratio = "yuv420p", aspect
        for frame in frames:
            if not n:
                stream.height, stream.width = frame.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
            n += 1
        container.mux(stream.encode())
    return n
