"""Small data sets in each format, written out, and the line that loading a bad one must end with."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.support.errors import DataError
from PIL import Image

WIDTH, HEIGHT, N_VIEWS = 21, 15, 10
QUATERNION = (0.9921567416492215, 0.0, 0.125, 0.0)  # w, x, y, z: turned by 14 degrees about y


def write_images(folder: Path, names: list[str], size=(WIDTH, HEIGHT), color=(200, 100, 50)) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGBA" if len(color) == 4 else "RGB", size, color).save(folder / name)


def colmap_folder(
    root: Path,
    model: str = "sparse/0",
    text: bool = True,
    camera: str = "PINHOLE",
    params=(20, 20, 10.5, 7.5),
):
    """Ten views that look along z at a grid of points; view 0 observes all. Returns the points [P, 3]."""
    folder = root / model
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"img_{i:02d}.png" for i in range(N_VIEWS)]
    write_images(root / "images", names)
    points = np.array([(x, y, 5.0) for x in (-0.5, 0, 0.5) for y in (-0.5, 0, 0.5)])
    translations = [(0.1 * i, 0.0, 0.0) for i in range(N_VIEWS)]
    poses = [(*((1.0, 0, 0, 0) if i else QUATERNION), *translations[i]) for i in range(N_VIEWS)]
    seen = project_by_hand(points, *translations[0])
    values = " ".join(str(v) for v in params)
    (folder / "cameras.txt").write_text(f"# comment\n7 {camera} {WIDTH} {HEIGHT} {values}\n")
    lines = ["# comment"]
    for i in reversed(range(N_VIEWS)):  # the file's order is not the order of the names
        lines.append(f"{i + 1} {' '.join(str(v) for v in poses[i])} 7 {names[i]}")
        lines.append(
            " ".join(f"{u} {v} {k + 1}" for k, (u, v) in enumerate(seen)) + " 3.0 4.0 -1" if i == 0 else ""
        )
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    rows = [f"{k + 1} {x} {y} {z} 200 100 50 0.1 1 {k}" for k, (x, y, z) in reversed(list(enumerate(points)))]
    (folder / "points3D.txt").write_text("\n".join(rows) + "\n")
    if not text:
        text_to_binary(folder, seen, points, poses, names, params)
    return points


def project_by_hand(points, tx, ty, tz):
    """Pixels [P, 2] of the turned first view, written out independently of Camera."""
    w, _, y, _ = QUATERNION
    c, s = 1 - 2 * y * y, 2 * w * y
    local = np.stack(
        [
            c * points[:, 0] + s * points[:, 2] + tx,
            points[:, 1] + ty,
            -s * points[:, 0] + c * points[:, 2] + tz,
        ],
        1,
    )
    return local[:, :2] / local[:, 2:] * 20 + (10.5, 7.5)


def text_to_binary(folder, seen, points, poses, names, params):
    (folder / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", 1, 7, 1, WIDTH, HEIGHT, *params))
    blob = struct.pack("<Q", N_VIEWS)
    for i, (pose, name) in enumerate(zip(poses, names, strict=True)):
        blob += struct.pack("<I7dI", i + 1, *pose, 7) + name.encode() + b"\0"
        rows = [(*uv, k + 1) for k, uv in enumerate(seen)] + [(3.0, 4.0, -1)] if i == 0 else []
        blob += struct.pack("<Q", len(rows)) + b"".join(struct.pack("<ddq", *row) for row in rows)
    (folder / "images.bin").write_bytes(blob)
    blob = struct.pack("<Q", len(points))
    for k, point in enumerate(points):
        blob += struct.pack("<Q3d3BdQII", k + 1, *point, 200, 100, 50, 0.1, 1, 1, k)
    (folder / "points3D.bin").write_bytes(blob)
    for file in folder.glob("*.txt"):
        file.unlink()


def transforms_folder(
    root: Path, name: str = "transforms.json", n: int = 3, folder: str = "images", **content
) -> Path:
    frames = []
    for i in range(n):
        pose = affine(np.eye(3), (0.2 * i, 0, 0))
        frames.append({"file_path": f"./{folder}/r_{i}", "transform_matrix": pose.tolist()})
    write_images(root / folder, [f"r_{i}.png" for i in range(n)])
    (root / name).write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames, **content}))
    return root


def error_of(path: Path, **arguments) -> str:
    """The message of the DataError that loading raises: always a single line."""
    with pytest.raises(DataError) as caught:
        load_dataset(path, **arguments)
    message = str(caught.value)
    assert "\n" not in message and "; " in message
    return message
