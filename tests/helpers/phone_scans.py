"""Scans of a box of a room in the formats of apps, by formulas of their own: what pixels see follows from the walls."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

LOW, HIGH = np.array([-2.0, 0.0, -2.0]), np.array([2.0, 2.4, 2.0])  # corners in metres; y is up, as in ARKit
COLORS = np.array([[220, 60, 50], [60, 200, 70], [230, 210, 60], [60, 80, 220], [200, 80, 210], [70, 210, 210]])
DARKER = 0.75  # the other fields of the chessboard on a wall
SIZE, DEPTH_SIZE = (96, 72), (48, 36)  # of images and of depth maps
FOCAL, CENTER = (70.0, 71.0), (47.0, 36.5)
MATRIX = [[FOCAL[0], 0, CENTER[0]], [0, FOCAL[1], CENTER[1]], [0, 0, 1]]
ROLL = 0.2  # radians
BORDER = 6  # black columns at the left of photographs without a lens


@dataclass(frozen=True)
class Pose:
    """Camera to world, OpenGL: its place [3], and its rotation [3, 3]."""

    place: np.ndarray
    turn: np.ndarray


def poses(n: int) -> list[Pose]:
    """Most of the way around, all looking outwards and a little down, and held askew, so that they do not tell up."""
    made, roll = [], np.array([[np.cos(ROLL), -np.sin(ROLL), 0], [np.sin(ROLL), np.cos(ROLL), 0], [0, 0, 1]])
    for angle in np.linspace(0, 1.8 * np.pi, n, endpoint=False):
        ahead = np.array([np.sin(angle), -0.25, np.cos(angle)]) / np.hypot(1, 0.25)
        right = np.array([-np.cos(angle), 0, np.sin(angle)])
        turn = np.stack([right, np.cross(right, ahead), -ahead], axis=1) @ roll
        made.append(Pose(np.array([0.5 * np.sin(angle), 1.3, 0.5 * np.cos(angle)]), turn))
    return made


def seen(pose: Pose, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(depths [H, W] in metres, colours uint8 [H, W, 3]) of the walls, in an image resampled to ``size``."""
    x, y = np.meshgrid((np.arange(size[0]) + 0.5) / size[0] * SIZE[0], (np.arange(size[1]) + 0.5) / size[1] * SIZE[1])
    rays = np.stack([(x - CENTER[0]) / FOCAL[0], (CENTER[1] - y) / FOCAL[1], -np.ones_like(x)], axis=-1)
    rays = rays @ pose.turn.T
    rays = np.where(rays == 0, 1e-12, rays)
    ends = np.where(rays > 0, HIGH - pose.place, LOW - pose.place) / rays
    axis = ends.argmin(axis=-1)
    depth = ends.min(axis=-1)  # rays are as long as their depth
    point = pose.place + depth[..., None] * rays
    side = np.take_along_axis(rays, axis[..., None], -1)[..., 0] > 0
    fields = np.floor(point * 2.5 + 1e-6).astype(int)
    np.put_along_axis(fields, axis[..., None], 0, -1)
    color = COLORS[2 * axis + side] * np.where(fields.sum(-1) % 2, 1, DARKER)[..., None]
    return depth, np.rint(color).astype(np.uint8)


def millimetres(depth: np.ndarray) -> Image.Image:
    return Image.fromarray(np.rint(1000 * depth).astype(np.uint16))


def write_polycam(folder: Path, n: int = 16, corrected: bool = True) -> list[Pose]:
    """``keyframes/``, with a quarter of each depth map of low confidence, and wrong there."""
    kinds = ("images", "cameras", "depth", "confidence") + ("corrected_images", "corrected_cameras") * corrected
    for kind in kinds:
        (folder / "keyframes" / kind).mkdir(parents=True)
    made = poses(n)
    for k, pose in enumerate(made):
        name = f"keyframes/{{}}/{1_700_000_000_000 + 250_000 * k}"
        depth, low = seen(pose, DEPTH_SIZE)[0], np.arange(DEPTH_SIZE[1]) < DEPTH_SIZE[1] // 4
        millimetres(np.where(low[:, None], 0.7, depth)).save(folder / f"{name.format('depth')}.png")
        levels = np.broadcast_to(np.where(low, 0, 127)[:, None], depth.shape).astype(np.uint8)
        Image.fromarray(levels).save(folder / f"{name.format('confidence')}.png")
        for part in ("", "corrected_") if corrected else ("",):
            pixels = seen(pose, SIZE)[1].copy()
            pixels[:, : BORDER if part else 0] = 0
            Image.fromarray(pixels).save(folder / f"{name.format(part + 'images')}.jpg", quality=95)
            place = pose.place if part or not corrected else pose.place + 0.3  # what was tracked has drifted
            rows = {f"t_{i}{j}": v for i in range(3) for j, v in enumerate([*pose.turn[i], place[i]])}
            optics = dict(zip(("fx", "fy", "cx", "cy"), (*FOCAL, *CENTER), strict=True))
            told = {**optics, "width": SIZE[0], "height": SIZE[1], "blur_score": 100.0, **rows}
            (folder / f"{name.format(part + 'cameras')}.json").write_text(json.dumps(told))
    return made


def write_record3d(folder: Path, n: int = 17, per_frame: bool = False) -> list[Pose]:
    """In the axes of the first camera; the images are larger than those that the intrinsics are of, the last is
    missing."""
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    first, rows = poses(n)[0], []
    made = [Pose(first.turn.T @ (pose.place - first.place), first.turn.T @ pose.turn) for pose in poses(n)]
    for k, (pose, own) in enumerate(zip(poses(n), made, strict=True)):
        rows.append([*quaternion(own.turn), *own.place])
        channels = {"R": seen(pose, DEPTH_SIZE)[0].astype(np.float32)}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, channels).write(str(folder / "depth" / f"{k}.exr"))  # type: ignore[arg-type]
        if k < n - 1:
            pixels = seen(pose, (2 * SIZE[0], 2 * SIZE[1]))[1]
            Image.fromarray(pixels).save(folder / "rgb" / f"{k}.jpg", quality=95)
    told = {"w": SIZE[0], "h": SIZE[1], "fps": 60, "K": np.array(MATRIX).T.ravel().tolist(), "poses": rows}
    if per_frame:
        told |= {"perFrameIntrinsicCoeffs": [[*FOCAL, *CENTER]] * n, "K": [1, 0, 0, 0, 1, 0, 0, 0, 1]}
    (folder / "metadata.json").write_text(json.dumps(told))
    return made[:-1]


def write_stray_files(folder: Path, n: int, per_frame: bool = False) -> list[Pose]:
    """All but the video; the depth map of the first frame is of low confidence altogether."""
    for kind in ("depth", "confidence"):
        (folder / kind).mkdir(parents=True)
    made, lines = poses(n), ["timestamp, frame, x, y, z, qx, qy, qz, qw" + ", fx, fy, cx, cy" * per_frame]
    for k, pose in enumerate(made):
        turn = pose.turn * [1, -1, -1]  # columns: OpenCV's axes
        numbers = [*pose.place, *quaternion(turn), *((*FOCAL, *CENTER) if per_frame else ())]
        lines.append(", ".join([f"{k / 60}", f"{k + 3:06d}", *map(repr, map(float, numbers))]))
        millimetres(seen(pose, DEPTH_SIZE)[0]).save(folder / "depth" / f"{k + 3:06d}.png")
        levels = np.full(DEPTH_SIZE[::-1], min(k, 2), np.uint8)
        Image.fromarray(levels).save(folder / "confidence" / f"{k + 3:06d}.png")
    (folder / "odometry.csv").write_text("\n".join(lines) + "\n")
    if not per_frame:
        (folder / "camera_matrix.csv").write_text("\n".join(", ".join(map(str, row)) for row in MATRIX))
    return made


def quaternion(turn: np.ndarray) -> np.ndarray:
    """x, y, z, w of a rotation by its axis and angle."""
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    values, vectors = np.linalg.eig(turn)
    axis = np.real(vectors[:, np.argmin(np.abs(values - 1))])
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    axis = axis * (1 if axis @ skew >= 0 else -1)
    return np.array([*(axis * np.sin(angle / 2)), np.cos(angle / 2)])
