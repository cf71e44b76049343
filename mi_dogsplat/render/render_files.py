"""A model or a Mitsuba scene to a picture file; behind ``dogsplat render``."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..engine.aovs import options_for, read_names
from ..engine.parameters import upload
from ..engine.rasterize import RasterOptions
from ..formats.read import read_model
from ..scene.appearance import read_appearance
from ..scene.camera_file import read_camera
from ..scene.cameras import Camera
from ..scene.drawing import Drawing, drawn_as
from ..scene.splats import Splats
from ..support.errors import DataError, interruptible
from ..support.files import replacing
from ..support.pictures import write_channels, write_exr, write_png
from ..support.scene_errors import scene_error
from ..support.srgb import linear_to_srgb
from .framing import NEAR_SHARE, automatic_camera, robust_sphere
from .picture import Picture, as_taken, background_color, premultiplied, render_picture
from .picture_options import PictureOptions

SUFFIXES = (".png", ".exr", ".npz")
MAX_NAMES = 5  # views that an error message lists


@dataclass(frozen=True)
class Viewpoint:
    """From where a model is looked at, and over what."""

    camera: Camera
    near_clip: float  # world units
    background: float  # grey level, 0..1
    antialiased: bool = False
    linear: bool = False  # colours of the primitives are linear radiance
    white: float = 1.0  # which of it is shown as white
    name: str | None = None  # of the view of a data set that it is


def viewpoint(
    splats: Splats,
    data: str | Path | None = None,
    camera: str | Path | None = None,
    options: PictureOptions = PictureOptions(),
    drawing: Drawing = Drawing(),
) -> Viewpoint:
    """Where a model is looked at from.

    Args:
        splats: the model.
        data: a data set.
        camera: the name of one of its views, or a camera file (``camera_file.py``); None is the first test view of the
            data, or without data a camera that frames the model.
        options: ``downscale`` shrinks the picture; ``near_clip`` is smaller where a model is framed and small itself.
        drawing: what the file of the model says, for what the options do not say.

    Raises ``DataError``.
    """
    found, has_alpha, name = _camera(splats, data, camera, options.downscale, drawing.up)
    drawn = drawn_as(options.drawing, drawing)
    near_clip = drawn.near_clip
    if not (camera or data):
        near_clip = min(near_clip, NEAR_SHARE * robust_sphere(splats)[1])
    background = background_color(options.background, has_alpha)
    return Viewpoint(found, near_clip, background, drawn.antialiased, drawn.linear, drawn.white, name)


def picture_of(
    splats: Splats,
    background: float,
    near_clip: float,
    *,
    antialiased: bool = False,
    linear: bool = False,
    white: float = 1.0,
    aovs: Sequence[str] = (),
) -> Callable[[Camera], Picture]:
    """Renderer of a model, which may be empty and is uploaded once.

    Args:
        background: grey level behind, 0..1.
        near_clip: world units.
        antialiased: as in ``RasterOptions``.
        linear, white: as in ``render_picture``.
        aovs: names as in ``aovs.py``, which the pictures carry.
    """
    params = upload(splats)
    options = options_for(aovs, RasterOptions(sh_degree=splats.sh_degree, antialiased=antialiased))
    how = {"linear": linear, "white": white}
    return lambda camera: render_picture(params, camera, options, background, near_clip, aovs, **how)


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

    PNG shows the model over the background; OpenEXR holds it alone, premultiplied, with alpha and the AOVs; NPZ the
    same as arrays ``color`` [H, W, 3], ``alpha`` and ``depth`` [H, W], for other programs.

    Args:
        model: the model.
        out: ends in one of ``SUFFIXES``.
        data, camera: from where it is seen (``viewpoint``).
        aovs: channels of an OpenEXR file, separated by commas (``aovs.py``); None is depth.
        options: how it is drawn; what they do not say, the file of the model does.
        appearance: file of what a run learned of its cameras (``scene/appearance.py``): shown as the camera took the
            view of this name, or would take another one; None shows the model itself.

    Needs a Mitsuba variant. Raises ``DataError``.
    """
    model, out = Path(model), Path(out)
    require_suffix(out)
    names = _aovs(out, aovs)
    read = read_model(model)
    view, suffix = viewpoint(read.splats, data, camera, options, read.drawing), out.suffix.lower()
    background = view.background if suffix == ".png" else 0.0
    how = {"antialiased": view.antialiased, "linear": view.linear, "white": view.white}
    if appearance and view.linear:
        raise DataError("--appearance", "is of photographs, and the model holds linear radiance", "leave it out")
    numbers = read_appearance(Path(appearance)).numbers(view.camera, view.name) if appearance else None
    picture = picture_of(read.splats, background, view.near_clip, **how, aovs=names)(view.camera)
    if numbers is not None:
        picture = as_taken(picture, view.camera, numbers)
    if suffix == ".npz":
        _write(out, lambda: _write_arrays(out, picture))
    elif suffix == ".exr":
        _write(out, lambda: write_exr(out, {"color": premultiplied(picture, 0.0), **picture.aovs}))
    else:
        _write(out, lambda: write_png(out, picture.color))


def render_scene(
    path: str | Path, out: str | Path, spp: int = 0, on_pass: Callable[[int, int], None] | None = None
) -> None:
    """Render the first sensor of a Mitsuba scene with the scene's own integrator.

    OpenEXR holds linear radiance and every channel of the film, PNG the colour as sRGB. Raises ``DataError``,
    also for what Mitsuba has to say about the scene.

    Args:
        path: the scene, .xml.
        out: the picture.
        spp: samples per pixel; 0 is what the scene says.
        on_pass: called with the number of samples that each pixel has, and that of all, by integrators that splat.
    """
    from ..plugin.splat_integrator import SplatIntegrator  # of the active variant

    path, out = Path(path), Path(out)
    require_suffix(out)
    if spp < 0:
        raise DataError("--spp", f"{spp} samples per pixel are not possible", "give 1 or more")
    if not path.is_file():
        raise DataError(path, "no such file", "give a model .ply or a Mitsuba scene .xml")
    try:
        scene = mi.load_file(str(path))
        if not isinstance(scene, mi.Scene):
            raise RuntimeError("its root is no scene")
        if not scene.sensors():
            raise RuntimeError("it has no sensor")
        integrator = scene.integrator()
        if isinstance(integrator, SplatIntegrator):
            integrator.on_pass = on_pass
        with interruptible():
            mi.render(scene, spp=spp)
        bitmap = scene.sensors()[0].film().bitmap()
    except (RuntimeError, ValueError) as error:  # plugins report wrong parameters and files with either
        raise scene_error(path, error, "Mitsuba cannot render it") from error
    if out.suffix.lower() == ".npz":
        raise DataError(out, "arrays hold pictures of models only", "name a file that ends in .png or .exr")
    if out.suffix.lower() == ".exr":
        planes = np.array(bitmap).reshape(bitmap.height(), bitmap.width(), -1)  # [H, W, channels]
        named = {field.name: planes[..., k] for k, field in enumerate(bitmap.struct_())}
        _write(out, lambda: write_channels(out, named))
        return
    if bitmap.pixel_format() == mi.Bitmap.PixelFormat.MultiChannel:  # AOVs came along
        bitmap = dict(bitmap.split())["<root>"]
    linear = np.array(bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))  # [H, W, 3]
    if np.isnan(linear).any():
        raise DataError(path, "its render holds NaN", "correct the scene, or write .exr to see where they are")
    _write(out, lambda: write_png(out, linear_to_srgb(linear)))


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
            raise DataError("--aovs", f"{out} has no room for them", "name a file that ends in .exr")
        return ["depth"] if suffix == ".npz" else []
    try:
        names = read_names("depth" if aovs is None else aovs)
    except ValueError as error:
        raise DataError("--aovs", *str(error).split("; ")) from error
    return [name for name in names if name != "alpha"]  # the channel A, which every such file has


def _camera(
    splats: Splats, data: str | Path | None, camera: str | Path | None, downscale: int, up_axis: str | None
) -> tuple[Camera, bool, str | None]:
    """The camera to render from, whether the images of its data set have alpha, and the name of the view that it is."""
    if camera and Path(camera).suffix.lower() == ".json":
        return _downscaled(read_camera(camera), downscale), False, None
    if not data:
        if camera:
            remedy = "add --data DATA whose view it is, or name a camera file"
            raise DataError("--camera", f'"{camera}" is no .json file', remedy)
        return _downscaled(automatic_camera(splats, up_axis), downscale), False, None
    from ..datasets import load_dataset  # here: it needs the extra "train", a model alone does not

    dataset = load_dataset(data, downscale)
    views = {view.name: view for view in dataset.test + dataset.train}
    name = str(camera) if camera else next(iter(views))
    if name not in views:
        near = difflib.get_close_matches(name, views, MAX_NAMES, cutoff=0.3) or list(views)[:MAX_NAMES]
        listed = ", ".join(near)
        raise DataError("--camera", f'"{name}" is no view of {data}', f"it has {len(views)}, such as {listed}")
    return views[name].camera, dataset.has_alpha, name


def _downscaled(camera: Camera, downscale: int) -> Camera:
    try:
        return camera.downscaled(downscale)
    except ValueError as error:
        raise DataError("--downscale", str(error), "use a smaller number") from error


def _write_arrays(out: Path, picture: Picture) -> None:
    with replacing(out) as part, part.open("wb") as file:
        np.savez(file, color=picture.color, alpha=picture.alpha, depth=np.asarray(picture.depth))


def _write(out: Path, write: Callable[[], None]) -> None:
    """Run ``write``; raises ``DataError`` if the file cannot be written."""
    try:
        write()
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise DataError(out, problem, "check that the folder exists and is writable") from error
