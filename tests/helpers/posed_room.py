"""The room of ``benchmarks/poses/filmed_scene.py``, photographed and filmed small; and the exact cameras of both."""

from pathlib import Path

import numpy as np
from mi_dogsplat.datasets.colmap import find_model, read_sources
from mi_dogsplat.scene.cameras import Camera
from PIL import Image

from benchmarks.poses.filmed_scene import arc, film, picture, textured_room, write_video

SIZE = 320, 240
N = 8
SHUTTER, FRAMES = 3, 24
PATH = arc(2 * SHUTTER * FRAMES, *SIZE, turn=0.9)


def write_room(folder: Path) -> None:
    """``pictures/`` and ``walk.mp4``, which is blurred by its motion and becomes darker."""
    scene = textured_room()
    (folder / "pictures").mkdir(parents=True)
    for name, camera in photographed().items():
        Image.fromarray(picture(scene, [camera], 9)).save(folder / "pictures" / f"{name}.png")
    write_video(folder / "walk.mp4", (p for _, p in film(scene, PATH, SHUTTER, 1, lambda t: 1 - 0.4 * t)))


def folder_of(folder: Path, pictures: list[np.ndarray]) -> Path:
    """A new folder with these pictures, uint8 [H, W, 3] each."""
    folder.mkdir()
    for k, pixels in enumerate(pictures):
        Image.fromarray(pixels).save(folder / f"{k}.png")
    return folder


def photographed() -> dict[str, Camera]:
    return {f"view {k}": camera for k, camera in enumerate(arc(N, *SIZE))}


def filmed() -> dict[str, Camera]:
    return {f"frame_{k:06d}": PATH[2 * SHUTTER * k + SHUTTER // 2] for k in range(FRAMES)}


def found_cameras(folder: Path) -> dict[str, Camera]:
    """By the names of the views, as the model has them."""
    model = find_model(folder)
    assert model
    return {source.name: source.camera for source in read_sources(model, folder / "images")[0]}
