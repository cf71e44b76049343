"""Icon and featured image for the page of the add-on on extensions.blender.org. Needs ../shared/data.

    python -m scripts.pictures.extension

Both are drawn by our integrator: the icon is a DoG primitive around a plain Gaussian, the other a captured model
(PLAYBOT by Stephane Agullo, CC BY 4.0).
"""

from pathlib import Path

import mi_dogsplat  # noqa: F401  before Mitsuba: it chooses the LLVM
import numpy as np
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant
from PIL import Image, ImageDraw, ImageFont

MODEL = Path("../shared/data/models/playbot_lod2_sh2.ply")
OUT = Path("docs/pictures")
ICON = 256  # pixels, what the platform asks
GLOW = 100  # pixels around the icon in the featured image, where nothing may cut its glow
FEATURED = 1920, 1080
ORANGE, BLUE, NIGHT, DUSK = (0.96, 0.47, 0.05), (0.25, 0.72, 1.0), (16, 18, 26), (52, 56, 72)
RING = 0.47  # the largest alpha of a DoG primitive with F = 0.5
C0 = 0.28209479177387814  # the constant basis function of SH


def logit(p: np.ndarray) -> np.ndarray:
    """Inverse of the sigmoid."""
    return np.log(p / (1 - p))


def symbol() -> Splats:
    """A ring, which a DoG primitive makes, around a Gaussian, two units in front of a camera at the origin."""
    scales = np.array([[0.34] * 3, [0.085] * 3])
    colors = np.array([ORANGE, BLUE])
    return Splats(
        means=np.array([[0, 0, 2.0], [0, 0, 1.9]]),
        log_scales=np.log(scales),
        quats=np.tile([0, 0, 0, 1.0], (2, 1)),
        logit_opacities=logit(np.array([0.995, 0.99])),
        sh_coeffs=((colors - 0.5) / C0)[:, None],
        dog_index=np.array([0], np.uint32),
        dog_logit_opacities=logit(np.array([0.99])),
        dog_log_scales=np.log([[0.5] * 3]),
    )


def drawn(splats: Splats, camera: Camera) -> Image.Image:
    """A model with transparency."""
    picture = render_picture(upload(splats), camera, RasterOptions(sh_degree=splats.sh_degree))
    alpha = np.asarray(picture.alpha)[..., None]
    rgba = np.concatenate([np.asarray(picture.color) / np.maximum(alpha, 1e-4), alpha], axis=-1)
    return Image.fromarray((rgba.clip(0, 1) * 255 + 0.5).astype(np.uint8))


def icon(size: int, margin: int = 0) -> Image.Image:
    """The symbol, the ring brought to full strength; its glow goes on into a margin."""
    side = size + 2 * margin
    made = drawn(symbol(), Camera(np.eye(4), 1.05 * size, 1.05 * size, side / 2, side / 2, side, side))
    red, green, blue, alpha = made.split()
    return Image.merge("RGBA", (red, green, blue, alpha.point(lambda value: min(round(value / RING), 255))))


def looking(position: np.ndarray, at: np.ndarray, up: np.ndarray, focal: float) -> Camera:
    """A camera of the featured image, whose middle is right of that of the picture."""
    forward = (at - position) / np.linalg.norm(at - position)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    turn = np.stack([right, np.cross(forward, right), forward])
    w2c = affine(turn, -turn @ position)
    width, height = FEATURED
    return Camera(w2c, focal, focal, 0.66 * width, height / 2, width, height)


def featured() -> Image.Image:
    """The model before dusk, and what this is."""
    width, height = FEATURED
    rise = np.linspace(0, 1, height)[:, None, None]
    sky = np.array(NIGHT) * (1 - rise) + np.array(DUSK) * rise
    image = Image.fromarray(np.broadcast_to(sky, (height, width, 3)).astype(np.uint8)).convert("RGBA")
    camera = looking(np.array([0.9, -1.3, -2.9]), np.array([0, -0.62, 0]), np.array([0, -1.0, 0]), 1.35 * height)
    image.alpha_composite(drawn(read_ply(MODEL), camera))
    image.alpha_composite(icon(ICON, GLOW), (110 - GLOW, 250 - GLOW))
    draw = ImageDraw.Draw(image)
    draw.text((120, 520), "DoG Splat", "white", ImageFont.load_default(124))
    draw.text((126, 690), "Gaussians and Differences\nof Gaussians: import,\nedit, render exactly", (205, 210, 222),
              ImageFont.load_default(46), spacing=14)  # fmt: skip
    return image.convert("RGB")


def main() -> None:
    """Write both."""
    set_variant("auto")
    icon(ICON).save(OUT / "extension_icon.png", optimize=True)
    featured().save(OUT / "extension_featured.webp", quality=88, method=6)


if __name__ == "__main__":
    main()
