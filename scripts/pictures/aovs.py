"""Makes docs/pictures/aovs.png: what the AOVs of the integrator show of one model, side by side.

``python -m scripts.pictures.aovs [MODEL]``; the default model is ../shared/data/models/playbot_lod2_sh2.ply ("PLAYBOT"
by Stephane Agullo, CC-BY-4.0). It has no DoG primitive: for the share of DoG every fifth one is made one.
"""

import sys
from pathlib import Path

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.aovs import AOVS, options_for
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.framing import automatic_camera
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.render.picture import Picture, render_picture
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.pictures import heat_map

from .panels import write_rows

ROOT = Path(__file__).parents[2]
MODEL = ROOT.parent / "shared" / "data" / "models" / "playbot_lod2_sh2.ply"
SIDE = 360  # pixels of a picture
BACKGROUND = 0.08  # grey; darker than any colour map in use


def main() -> None:
    splats = read_ply(sys.argv[1] if len(sys.argv) > 1 else MODEL)
    mi.set_variant("llvm_ad_rgb")
    camera = square(automatic_camera(splats))
    picture, share = view(splats, camera), view(with_dog(splats), camera).aovs["dog_share.Y"]
    depth, median, index, count = (picture.aovs[name] for name in ("depth.Z", "median_depth.Z", "index.I", "count.I"))
    normal = np.stack([picture.aovs[f"normal.{axis}"] for axis in "XYZ"], -1)
    seen, n = picture.alpha > 0.5, splats.n_splats
    low, high = np.quantile(depth[seen], [0.005, 0.995])
    colors = np.random.default_rng(0).uniform(0.2, 1, (n, 3))

    def near(z: np.ndarray) -> np.ndarray:
        """Depth as brightness, the farthest dark but not black."""
        return heat_map(1 - 0.9 * (z - low) / (high - low))

    depths = f".Z, {low:.1f} (bright) to {high:.1f}"
    tiles = [
        labelled(picture.color, f"colour of {n:,} primitives"),
        labelled(np.repeat(picture.alpha[..., None], 3, -1), "alpha"),
        labelled(where(seen, near(depth)), "depth" + depths),
        labelled(where(seen & (median > 0), near(median)), "median_depth" + depths),
        labelled(where(seen, 0.5 + 0.5 * normal), "normal.X .Y .Z, world space"),
        labelled(where(index >= 0, colors[index.astype(int)]), f"index.I, {len(np.unique(index)) - 1:,} primitives"),
        labelled(where(count > 0, heat_map(count / count.max())), f"count.I, 0 to {count.max():.0f}"),
        labelled(where(count > 0, heat_map(share)), "dog_share.Y, 0 to 1; every fifth is DoG"),
    ]
    write_rows("aovs.png", [tiles[:4], tiles[4:]])


def square(camera: Camera) -> Camera:
    """The middle of the picture, ``SIDE`` pixels wide."""
    scale = SIDE / camera.height
    return Camera(camera.w2c, camera.fx * scale, camera.fy * scale, SIDE / 2, SIDE / 2, SIDE, SIDE)


def view(splats: Splats, camera: Camera) -> Picture:
    options = options_for(AOVS, RasterOptions(sh_degree=splats.sh_degree))
    return render_picture(upload(splats), camera, options, BACKGROUND, DrawnAs(near_clip=0.01), AOVS)


def with_dog(splats: Splats) -> Splats:
    """Every fifth primitive gets a narrower pseudo-Gaussian, .6 of its size and .3 of its opacity."""
    index = np.arange(0, splats.n_splats, 5)
    plain = {name: value for name, value in vars(splats).items() if not name.startswith("dog_")}
    opacities = np.full(len(index), np.log(0.3 / 0.7))
    return Splats(
        **plain, dog_index=index, dog_logit_opacities=opacities, dog_log_scales=np.full((len(index), 3), np.log(0.6))
    )


def where(mask: np.ndarray, picture: np.ndarray) -> np.ndarray:
    return np.where(mask[..., None], picture, BACKGROUND)


if __name__ == "__main__":
    main()
