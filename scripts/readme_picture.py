"""Makes docs/pictures/demo.png after ``make demo``: path-traced truth and the trained splats from one camera."""

import sys
from pathlib import Path

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import mitsuba as mi
import numpy as np
from mi_dogsplat.pictures import write_png
from mi_dogsplat.srgb import linear_to_srgb

ROOT = Path(__file__).parents[1]
model = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "demo" / "run" / "point_cloud.ply"

mi.set_variant("llvm_ad_rgb")
truth = mi.load_file(str(ROOT / "scenes" / "demo_truth.xml"))
sensor = truth.sensors()[0]
film = {"type": "hdrfilm", "width": 640, "height": 480, "pixel_format": "rgba", "rfilter": {"type": "box"}}
pose = mi.traverse(sensor)["to_world"].matrix.numpy().reshape(4, 4)
view = {"type": "perspective", "fov": 38, "to_world": mi.ScalarTransform4f(pose), "film": mi.load_dict(film)}
splats = mi.load_dict(
    {
        "type": "scene",
        "integrator": {"type": "dogsplat"},
        "model": {"type": "dog", "filename": str(model)},
        "sky": {"type": "constant", "radiance": 1.0},
    }
)
traced = mi.render(truth, sensor=mi.load_dict(view), spp=256).numpy()
traced = linear_to_srgb(traced[..., :3] + 1 - traced[..., 3:])  # over white, as in training
splatted = linear_to_srgb(mi.render(splats, sensor=mi.load_dict(view)).numpy()[..., :3])
write_png(ROOT / "docs" / "pictures" / "demo.png", np.concatenate([traced, splatted], axis=1))
