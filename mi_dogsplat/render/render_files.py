"""A model or a Mitsuba scene to a picture file; behind ``dogsplat render``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np

from ..engine.aovs import read_names
from ..formats.read import read_model, require_primitives
from ..scene.appearance import read_appearance
from ..support.arguments import checks_arguments
from ..support.errors import DataError, Wrong, writing
from ..support.files import replacing, require_place
from ..support.pictures import write_channels, write_exr, write_png
from ..support.variants import require_arrays, require_variant
from .picture import Picture, as_taken, picture_of, premultiplied
from .picture_memory import require_memory
from .picture_options import PictureOptions
from .scene_picture import channels_of, picture_of_scene, shown
from .scene_to_draw import SceneOptions
from .viewpoint import viewpoint

SUFFIXES = (".png", ".exr", ".npz")


@checks_arguments
def render_model(
    model: str | Path,
    out: str | Path,
    data: str | Path | None = None,
    camera: str | Path | None = None,
    aovs: str | None = None,
    options: PictureOptions = PictureOptions(),
    appearance: str | Path | None = None,
) -> None:
    """Render a model file to the picture file ``out``.

    PNG shows the model over the background; OpenEXR holds it alone, premultiplied, with alpha and the AOVs; NPZ has
    arrays ``color`` [H, W, 3], over black, ``alpha`` and ``depth`` [H, W], for other programs: sRGB values, or radiance
    where the model is linear.

    Args:
        model: the model.
        out: ends in one of ``SUFFIXES``.
        data, camera: from where it is seen (``viewpoint.py``).
        aovs: channels of an OpenEXR file, separated by commas (``aovs.py``); None is depth.
        options: how it is drawn; what they do not say, the file of the model does.
        appearance: file of what a run learned of its cameras (``scene/appearance.py``): shown as the camera took the
            view of this name, or would take another one; None shows the model itself.

    Needs a Mitsuba variant. Raises ``DataError``.
    """
    require_arrays()
    model, out = Path(model), Path(out)
    require_suffix(out)
    names = _aovs(out, aovs)
    read = read_model(model)
    require_primitives(model, read, "render")
    view, suffix = viewpoint(read.splats, data, camera, options, read.drawing), out.suffix.lower()
    options.require_for(view.drawn.linear)
    require_memory(out, view.camera.width, view.camera.height, suffix, "ask for a smaller picture, as by --downscale 2")
    background = view.background if suffix == ".png" else 0.0
    if appearance and view.drawn.linear:
        raise DataError("--appearance", "is for photographs, but the model holds linear radiance", "leave it out")
    numbers = read_appearance(Path(appearance)).numbers(view.camera, view.name) if appearance else None
    picture = picture_of(read.splats, background, view.drawn, names)(view.camera)
    if numbers is not None:
        picture = as_taken(picture, view.camera, numbers)
    with writing(out):
        if suffix == ".npz":
            _write_arrays(out, picture)
        elif suffix == ".exr":
            write_exr(out, {"color": premultiplied(picture, 0.0), **picture.aovs})
        else:
            write_png(out, picture.color)


@checks_arguments
def render_scene(
    path: str | Path,
    out: str | Path,
    spp: int = 0,
    on_pass: Callable[[int, int], None] | None = None,
    drawing: AbstractContextManager[None] | None = None,
    denoise: bool = False,
    sensor: int = 0,
    defined: Mapping[str, str] | None = None,
) -> None:
    """Render what a sensor of a Mitsuba scene sees, with the scene's own integrator.

    OpenEXR holds linear radiance and every channel of the film, PNG the colour as sRGB. Raises ``DataError``,
    also for what Mitsuba has to say about the scene.

    Args:
        path: the scene, .xml.
        on_pass: as of ``SceneToDraw.rendered``.
        out: the picture.
        spp, denoise, sensor, defined: as of ``SceneOptions``.
        drawing: entered while Mitsuba loads and draws, and left before the picture is written.
    """
    require_variant()
    path, out = Path(path), Path(out)
    require_suffix(out)
    if out.suffix.lower() == ".npz":
        raise DataError(out, "arrays are only written for models", "name a file that ends in .png or .exr")
    require_place(out)
    options = SceneOptions(spp, denoise, sensor, defined)
    with drawing or nullcontext():
        bitmap = picture_of_scene(path, options, on_pass, out.suffix.lower())
    if out.suffix.lower() == ".exr":
        with writing(out):
            write_channels(out, channels_of(bitmap))
        return
    image = shown(bitmap, path)
    with writing(out):
        write_png(out, image)


def require_suffix(out: Path) -> None:
    """Raise ``DataError`` unless the file name tells a picture format that can be written."""
    if out.suffix.lower() not in SUFFIXES:
        raise DataError(out, "no known picture format", f"name a file that ends in {', '.join(SUFFIXES)}")
    if out.is_dir():
        raise DataError(out, "is a folder", "name a file in it")


def _aovs(out: Path, aovs: str | None) -> list[str]:
    """AOVs to write beside colour and alpha."""
    suffix = out.suffix.lower()
    if suffix != ".exr":
        if aovs is not None:
            raise DataError("--aovs", f"{out} cannot hold them", "name a file that ends in .exr")
        return ["depth"] if suffix == ".npz" else []
    try:
        names = read_names("depth" if aovs is None else aovs)
    except Wrong as error:
        raise error.at("--aovs") from error
    return [name for name in names if name != "alpha"]  # the channel A, which every such file has


def _write_arrays(out: Path, picture: Picture) -> None:
    color = picture.color if picture.radiance is None else picture.radiance
    with replacing(out) as part, part.open("wb") as file:
        np.savez(file, color=color, alpha=picture.alpha, depth=np.asarray(picture.depth))
