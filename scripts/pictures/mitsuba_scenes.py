"""Makes the pictures of docs/gallery.md that show what goes with ``dogsplat`` in a Mitsuba scene.

``python -m scripts.pictures.mitsuba_scenes [NAME ...]``; the names are sensors, samples, backgrounds, pose and capture.
Two minutes for all on two cores. The model is scenes/still_life.ply.
"""

import runpy
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.support.pictures import heat_map
from mi_dogsplat.support.srgb import linear_to_srgb

from .panels import write_rows

SCENES = Path(__file__).parents[2] / "scenes"
WIDTH, HEIGHT = 360, 270  # pixels of a panel
ZOOM, CORNER = 6, (150, 96)  # what is enlarged of the picture of a panel, and from where, in pixels
WHITE: dict[str, Any] = {"type": "constant"}
ERROR = 0.25  # difference that is shown as white


def film(**others: Any) -> dict[str, Any]:
    usual = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    return usual | others


def from_side(angle: float = 0.0) -> Any:
    """Camera on a circle around the still life, in degrees away from the camera of its scene."""
    turn = mi.ScalarTransform4f().rotate([0, 0, 1], angle)
    return turn @ mi.ScalarTransform4f().look_at([-1.4, -4.9, 2.75], [0, -0.05, 0.2], [0, 0, 1])


def perspective(**others: Any) -> dict[str, Any]:
    return {"type": "perspective", "fov": 38, "to_world": from_side(), "film": film(), **others}


def render(sensor: dict[str, Any], sky: dict[str, Any] = WHITE, spp: int = 1, **integrator: Any) -> np.ndarray:
    """[H, W, 3] sRGB values, 0..1."""
    model = {"type": "dog", "filename": str(SCENES / "still_life.ply")}
    scene: Any = mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat", **integrator}, "splats": model,
                               "sensor": sensor, "sky": sky})
    return shown(mi.render(scene, spp=spp))


def shown(image: Any) -> np.ndarray:
    """Linear radiance, three channels or one, as a screen shows it."""
    linear = np.asarray(image)
    return np.clip(linear_to_srgb(linear if linear.shape[-1] == 3 else np.repeat(linear, 3, -1)), 0, 1)


def sensors() -> None:
    lens = perspective(type="thinlens", aperture_radius=0.16, focus_distance=4.6)
    scaled = from_side() @ mi.ScalarTransform4f().scale([1.9, 1.9, 1])
    flat = {"type": "orthographic", "film": film(), "to_world": scaled}
    window = {"crop_width": WIDTH, "crop_height": HEIGHT, "crop_offset_x": 2 * WIDTH, "crop_offset_y": HEIGHT}
    crop = perspective(film=film(width=4 * WIDTH, height=3 * HEIGHT, **window))
    views = {f"view{k}": perspective(to_world=from_side(90.0 * k)) for k in range(4)}
    batch = {"type": "batch", "film": film(width=4 * WIDTH), **views}
    write_rows("sensors.png", [
        [labelled(render(perspective(principal_point_offset_x=0.2)), "perspective, principal point moved"),
         labelled(render(crop), "perspective, crop window of a film 4 times as wide"),
         labelled(render(lens, spp=64), "thinlens, 64 samples, focus on the blocks"),
         labelled(render(flat), "orthographic")],
        [labelled(render(batch), "batch: one film, four views")],
    ])


def enlarged(picture: np.ndarray) -> np.ndarray:
    left, top = CORNER
    part = picture[top:top + HEIGHT // ZOOM, left:left + WIDTH // ZOOM]
    return np.repeat(np.repeat(part, ZOOM, 0), ZOOM, 1)


def samples() -> None:
    kinds = [("1 sample: pixel centres, no filter", 1, "box"), ("16 samples, box filter", 16, "box"),
             ("16 samples, gaussian filter", 16, "gaussian"), ("16 samples, lanczos filter", 16, "lanczos")]
    write_rows("samples.png", [[
        labelled(enlarged(render(perspective(film=film(rfilter={"type": kind})), spp=spp)), text)
        for text, spp, kind in kinds
    ]])


def evening() -> dict[str, Any]:
    """An environment map: sky over a dark ground, with a low sun."""
    v, u = np.mgrid[0.5:256, 0.5:512] / [[[256]], [[512]]]
    height = np.cos(np.pi * v)[..., None]  # 1 at the zenith, 0 at the horizon
    sky = np.array([0.10, 0.22, 0.55]) + np.exp(-6 * np.abs(height)) * [1.0, 0.42, 0.12]
    sun = np.exp(-((u - 0.3) ** 2 + (0.5 * (v - 0.46)) ** 2) / 2e-4)[..., None] * [30.0, 16, 6]
    image = np.where(height > 0, sky + sun, [0.06, 0.05, 0.045])
    upright = mi.ScalarTransform4f().rotate([0, 0, 1], 100).rotate([1, 0, 0], 90)
    return {"type": "envmap", "bitmap": mi.Bitmap(image.astype(np.float32)), "to_world": upright}


def backgrounds() -> None:
    low = perspective(fov=60, to_world=mi.ScalarTransform4f().look_at([-1.4, -3.6, 0.8], [0, 0, 0.75], [0, 0, 1]))
    blue = {"type": "constant", "radiance": {"type": "rgb", "value": [0.05, 0.12, 0.30]}}
    grey = {**low, "film": film(pixel_format="luminance")}
    write_rows("backgrounds.png", [[
        labelled(render(low, blue), "constant emitter"),
        labelled(render(low, evening()), "environment map"),
        labelled(render(low, evening(), hide_emitters=True), "the same with hide_emitters"),
        labelled(render(grey, evening()), "the environment map on a luminance film"),
    ]])


def pose() -> None:
    """What scenes/refine_pose.py does, its first and its last picture."""
    example: Any = SimpleNamespace(**runpy.run_path(str(SCENES / "refine_pose.py")))
    scene: Any = mi.load_file(str(example.SCENE))
    params: Any = mi.traverse(scene)
    prefix = scene.sensors()[0].id()
    start, size = example.START, [WIDTH, HEIGHT]
    turns = [v * example.DEGREE for v in start[3:]]
    true = mi.Transform4f(params[f"{prefix}.to_world"].matrix)
    poses = [true, true @ example.motion([*start[:3], *turns])]
    history = example.refine(scene)
    poses.append(mi.Transform4f(params[f"{prefix}.to_world"].matrix))
    pictures = []
    for to_world in poses:
        params[f"{prefix}.film.size"], params[f"{prefix}.to_world"] = size, to_world
        params.update()
        pictures.append(shown(mi.render(scene))[..., :3])
    target, first, last = pictures
    texts = ["{}: {:.2g} units, {:.2g} degrees off".format(name, *at) for name, at in
             (("start", history[0]), ("found", history[-1]))]
    write_rows("pose.png", [
        [labelled(target, "to be found: from the scene's own camera"), labelled(first, texts[0]),
         labelled(last, texts[1])],
        [labelled(0.5 * (target + first), "that and the start, one over the other"),
         *(labelled(heat_map(np.minimum(np.abs(p - target).mean(-1) / ERROR, 1)), f"{text}, white from {ERROR} on")
           for p, text in ((first, "difference before"), (last, "difference after")))],
    ])


def captured() -> None:
    """Some views of what ``dogsplat capture`` makes of the path-traced scene that ``make demo`` learns from."""
    config = CaptureConfig(views=8, test=0, size=(WIDTH // 2, WIDTH // 2), elevations=(12.0, 65.0), zoom=1.35, spp=64,
                           alpha=True, points=1000)
    with tempfile.TemporaryDirectory() as folder:
        out = capture(SCENES / "demo_truth.xml", Path(folder) / "data", config)
        pictures = [np.array(mi.Bitmap(str(path))) / 255.0 for path in sorted(out.rglob("*.png"))]
    white = [p[..., :3] * p[..., 3:] + 1 - p[..., 3:] for p in pictures]
    text = "dogsplat capture scenes/demo_truth.xml: path-traced views from all around, here over white"
    write_rows("capture.png", [white[:8], [labelled(np.ones((1, 4 * WIDTH, 3)), text)]])


PARTS = {"sensors": sensors, "samples": samples, "backgrounds": backgrounds, "pose": pose, "capture": captured}


if __name__ == "__main__":
    mi.set_variant("llvm_ad_rgb")
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
