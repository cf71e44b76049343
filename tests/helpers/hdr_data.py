"""Data sets of linear radiance: what our own rasterizer makes of a known bright model, as OpenEXR."""

import json
from pathlib import Path

import numpy as np
from mi_dogsplat.datasets.exr import read_exr
from mi_dogsplat.datasets.point_ply import write_point_ply
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.render.picture import Picture, render_picture
from mi_dogsplat.scene.cameras import OPENCV_FROM_OPENGL
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.pictures import write_radiance
from mi_dogsplat.support.srgb import displayed
from tiny_data import HEIGHT, OPTIONS, WIDTH, cameras, truth


def bright_truth(unit: float = 1.0) -> Splats:
    """The truth of the tiny data, a tenth of it lamps of 8 to 20; all of it times ``unit``."""
    splats = truth()
    splats.sh_coeffs[:6] *= 40
    return brightened(splats, unit)


def picture(splats: Splats, camera, white: float = 1.0) -> Picture:
    return render_picture(upload(splats), camera, OPTIONS, drawn=DrawnAs(linear=True, white=white))


def write_hdr_data(folder: Path, unit: float = 1.0, alpha: bool = False) -> Path:
    """Write ``transforms.json``, ``images/0.exr`` ... and ``points.ply``, clipped display values as COLMAP has them."""
    splats, frames = bright_truth(unit), []
    (folder / "images").mkdir(parents=True)
    for i, camera in enumerate(cameras(8)):
        seen = picture(splats, camera)
        assert seen.radiance is not None
        pixels = np.maximum(seen.radiance, 0)
        pixels = np.concatenate([pixels, seen.alpha[..., None]], -1) if alpha else pixels
        write_radiance(folder / "images" / f"{i}.exr", pixels)
        pose = (camera.c2w @ OPENCV_FROM_OPENGL).tolist()
        frames.append({"file_path": f"images/{i}.exr", "transform_matrix": pose})
    near = splats.means + np.random.default_rng(1).normal(size=splats.means.shape) * 0.05
    write_point_ply(folder / "points.ply", near, displayed(0.5 + C0 * splats.sh_coeffs[:, 0], unit))
    content = {"w": WIDTH, "h": HEIGHT, "fl_x": 1.1 * WIDTH, "fl_y": 1.1 * WIDTH, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content | {"ply_file_path": "points.ply"}))
    return folder


FULL = 1.0  # radiance at which the sensor of ``write_saturated_data`` is full, below that of the lamps


def write_saturated_data(folder: Path, alpha: bool = False, told: bool = True, whole: int = 2) -> Path:
    """The same, taken by a sensor that is full at ``FULL``, which the images tell, in all but the last ``whole``."""
    write_hdr_data(folder, alpha=alpha)
    images = sorted((folder / "images").iterdir())
    for image in images[: len(images) - whole]:
        pixels = read_exr(image)
        pixels[..., :3] = np.minimum(pixels[..., :3], FULL)
        write_radiance(image, pixels, FULL if told else None)
    return folder
