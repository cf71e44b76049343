"""A data set of eight small pictures that our own rasterizer makes of a known model: training can only succeed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.datasets.point_ply import write_point_ply
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import Picture, premultiplied, render_picture
from mi_dogsplat.scene.cameras import OPENCV_FROM_OPENGL, Camera
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.pictures import write_png

from benchmarks.training.blobs import blobs

WIDTH, HEIGHT = 48, 36
N_TRUTH = 60
OPTIONS = RasterOptions(sh_degree=1, depth=True)


def truth(seed: int = 0) -> Splats:
    return blobs(N_TRUTH, seed)


def cameras(n: int = 8, width: int = WIDTH, height: int = HEIGHT) -> list[Camera]:
    """A ring around the origin that looks at it; neighbours at alternating heights."""
    angles = np.linspace(0, 2 * np.pi, n, endpoint=False)
    positions = [3 * np.array([np.cos(a), np.sin(a), 0.3 * (-1) ** i]) for i, a in enumerate(angles)]
    focal = 1.1 * width
    return [Camera(look_at(p, np.zeros(3), "z"), focal, focal, width / 2, height / 2, width, height) for p in positions]


def picture(splats: Splats, camera: Camera, background: float = 0.0) -> Picture:
    return render_picture(upload(splats), camera, OPTIONS, background)


def write_tiny_data(
    folder: Path, n: int = 8, alpha: bool = False, points: bool = True, splats: Splats | None = None
) -> Path:
    """Write ``transforms.json``, ``images/0.png`` ... and ``points.ply`` (the truth's centres, perturbed)."""
    splats, frames = truth() if splats is None else splats, []
    for i, camera in enumerate(cameras(n)):
        image = picture(splats, camera)
        pixels = image.color
        if alpha:  # PNG is not premultiplied
            rgba = premultiplied(image, 0.0)
            pixels = np.concatenate([rgba[..., :3] / np.maximum(rgba[..., 3:], 1e-6), rgba[..., 3:]], -1)
        write_png(folder / "images" / f"{i}.png", pixels)
        pose = (camera.c2w @ OPENCV_FROM_OPENGL).tolist()
        frames.append({"file_path": f"images/{i}.png", "transform_matrix": pose})
    content = {"w": WIDTH, "h": HEIGHT, "fl_x": 1.1 * WIDTH, "fl_y": 1.1 * WIDTH, "frames": frames}
    if points:
        rng = np.random.default_rng(1)
        near = splats.means + rng.normal(size=(N_TRUTH, 3)) * 0.05
        colors = 0.5 + C0 * splats.sh_coeffs[:, 0] + rng.normal(size=(N_TRUTH, 3)) * 0.1
        write_point_ply(folder / "points.ply", near, colors)
        content["ply_file_path"] = "points.ply"
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder


def write_tiny_model(folder: Path) -> None:
    """Write ``model.ply``, the truth, into a new folder."""
    folder.mkdir(parents=True)
    write_ply(folder / "model.ply", truth())


def sloped_truth() -> Splats:
    """The truth, larger and with colours that vary over its primitives."""
    model, rng = truth(), np.random.default_rng(3)
    rows = {"slope_index": np.arange(N_TRUTH), "color_slopes": rng.normal(0, 0.12, (N_TRUTH, 3, 3))}
    return replace(model, log_scales=model.log_scales + np.log(1.6), **rows)


def curved_truth() -> Splats:
    """The truth, larger and with a brightness that curves over its primitives."""
    model, rng = truth(), np.random.default_rng(5)
    rows = {"curvature_index": np.arange(N_TRUTH), "brightness_curvatures": rng.normal(0, 0.15, (N_TRUTH, 6))}
    return replace(model, log_scales=model.log_scales + np.log(1.6), **rows)


def cut_truth() -> Splats:
    """The truth, larger and each primitive cut off near its centre."""
    model = truth()
    rows = {"cut_index": np.arange(N_TRUTH), "cut_normals": np.random.default_rng(3).normal(0, 6, (N_TRUTH, 3))}
    return replace(model, log_scales=model.log_scales + np.log(1.6), **rows)


def twice_cut_truth() -> Splats:
    """The same, and a second plane for each: what is left is a wedge or a slab."""
    model = cut_truth()
    normals = np.random.default_rng(4).normal(0, 6, (N_TRUTH, 3))
    return replace(model, second_cut_index=model.cut_index, second_cut_normals=normals)


def shifted_truth() -> Splats:
    """The truth, each primitive of which moves as the cameras go round."""
    shifts = np.random.default_rng(7).normal(0, 0.8, (N_TRUTH, 3, 3))
    rows = {"shift_index": np.arange(N_TRUTH), "view_shifts": shifts, "mean_views": np.zeros((N_TRUTH, 3))}
    return replace(truth(), **rows)


def dog_model(f_a: float = 0.4, F: float = 1.5) -> Splats:
    """The truth of the tiny data, every other primitive a DoG."""
    model = truth()
    index = np.arange(0, model.n_splats, 2)
    return Splats(
        **{name: getattr(model, name) for name in ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")},
        dog_index=index,
        dog_logit_opacities=np.full(len(index), np.log(f_a / (1 - f_a))),
        dog_log_scales=np.log(np.full((len(index), 3), F)),
    )
