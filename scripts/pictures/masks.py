"""Makes docs/pictures/masked.png: photographs of the demo scene in which something stands in the way, and what
``dogsplat masks`` masks in them.

``python -m scripts.pictures.masks``; in the way is ../shared/data/models/playbot_lod2_sh2.ply ("PLAYBOT" by Stephane
Agullo, CC-BY-4.0). The photographs are path-traced, the rest takes some minutes of two cores.
"""

import tempfile
from pathlib import Path

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.masking.make import make_masks
from mi_dogsplat.render.framing import cameras_around
from mi_dogsplat.render.mask_sheet import COLUMNS, mask_sheet
from mi_dogsplat.render.picture import picture_of
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.drawing import drawn_as
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.config import TrainConfig

from benchmarks.training.cutouts import pictures_of, with_a_thing

from .panels import write_rows

ROOT = Path(__file__).parents[2]
MODEL = ROOT.parent / "shared" / "data" / "models" / "playbot_lod2_sh2.ply"
VIEWS, SIZE, EVERY = 40, (320, 240), 3  # one photograph of so many has something in the way


def main() -> None:
    mi.set_variant("llvm_ad_rgb")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_things(folder / "things")
        config = CaptureConfig(views=VIEWS, size=SIZE, spp=64, path="orbit", elevations=(25.0, 60.0), zoom=2.2)
        data = capture(ROOT / "scenes" / "demo_truth.xml", folder / "data", config)
        rng, things = np.random.default_rng(1), pictures_of(folder / "things")
        for path in sorted((data / "images").glob("*.png"))[1::EVERY]:
            write_png(path, with_a_thing(read_image(path)[..., :3], things, rng)[0])
        train(TrainConfig(str(data), steps=1500, max_primitives=15_000), folder / "run")
        found = make_masks(folder / "run" / "point_cloud.ply", data, folder / "masks")
        views = {view.name: view for view in load_dataset(data).train}
        shown = [views[name] for name in list(found.masked)[:COLUMNS]]
        masks = [read_image(folder / "masks" / f"{view.name}.png")[..., 0] < 0.5 for view in shown]
        page = mask_sheet((view.image, mask, view.name) for view, mask in zip(shown, masks, strict=True))
    write_rows("masked.png", [[page]])


def write_things(folder: Path) -> None:
    """Pictures with alpha of the model, from several sides."""
    read = read_model(MODEL)
    picture = picture_of(read.splats, 0.0, drawn_as(read.drawing))
    for k, camera in enumerate(cameras_around(read.splats, 6, read.drawing.up)):
        seen = picture(camera)
        straight = seen.color / np.maximum(seen.alpha[..., None], 1e-3)
        write_png(folder / f"{k}.png", np.concatenate([straight, seen.alpha[..., None]], axis=2))


if __name__ == "__main__":
    main()
