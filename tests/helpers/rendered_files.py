"""Pictures of models in files, written as the command does, and read."""

import numpy as np
import OpenEXR
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.render.render_files import render_model
from PIL import Image


def render(model, out, data=None, camera=None, aovs=None, **options) -> None:
    render_model(model, out, data, camera, aovs, PictureOptions(**options))


def read_png(path) -> np.ndarray:
    return np.asarray(Image.open(path))


def read_exr(path) -> dict[str, np.ndarray]:
    return {name: channel.pixels for name, channel in OpenEXR.File(str(path)).channels().items()}
