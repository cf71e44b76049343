"""From where a model is looked at, and over what: by a view of a data set, a camera file, or its own extent."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path

from ..scene.camera_file import read_camera
from ..scene.cameras import Camera
from ..scene.drawing import Drawing, DrawnAs, drawn_as
from ..scene.splats import Splats
from ..support.errors import DataError
from .framing import automatic_camera, drawn_without_data
from .picture import background_color
from .picture_options import PictureOptions

MAX_NAMES = 5  # views that an error message lists


@dataclass(frozen=True)
class Viewpoint:
    """From where a model is looked at, over what, and how it is drawn."""

    camera: Camera
    background: float  # grey level, 0..1
    drawn: DrawnAs
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
        camera: the name of one of its views or of its image (``view_meant``), or a camera file (``camera_file.py``);
            None is the first test view of the data, or without data a camera that frames the model.
        options: ``downscale`` shrinks the picture; without data a ``near_clip`` of None is smaller where a model is
            small (``drawn_without_data``).
        drawing: what the file of the model says, for what the options do not say.

    Raises ``DataError``.
    """
    found, has_alpha, name = _camera(splats, data, camera, options.shrink, drawing.up)
    said = options.drawing, drawing
    drawn = drawn_as(*said) if data else drawn_without_data(splats, *said, chosen=camera is not None)
    return Viewpoint(found, background_color(options.background, has_alpha), drawn, name)


def _camera(
    splats: Splats, data: str | Path | None, camera: str | Path | None, downscale: int, up_axis: str | None
) -> tuple[Camera, bool, str | None]:
    """The camera to render from, whether the images of its data set have alpha, and the name of the view that it is."""
    if camera and Path(camera).suffix.lower() == ".json":
        if data:
            raise DataError("--data", "is for views by name, but --camera names a file", "leave one of them out")
        return _downscaled(read_camera(camera), downscale), False, None
    if not data:
        if camera:
            remedy = "add --data DATA whose view it is, or name a camera file"
            raise DataError("--camera", f'"{camera}" is not a .json file', remedy)
        return _downscaled(automatic_camera(splats, up_axis), downscale), False, None
    from ..datasets import load_dataset  # here: it needs the extra "train", a model alone does not
    from ..datasets.dataset import view_meant

    dataset = load_dataset(data, downscale, spp=1, on_disk=True)  # their cameras are asked for, and no picture
    views = {view.name: view for view in dataset.test + dataset.train}
    told, folder = str(camera or next(iter(views))), Path(data)
    name = view_meant(told, views, folder if folder.is_dir() else folder.parent)
    if name is None:
        near = difflib.get_close_matches(told, views, MAX_NAMES, cutoff=0.3) or list(views)[:MAX_NAMES]
        listed = ", ".join(near)
        raise DataError("--camera", f'"{told}" is not a view of {data}', f"it has {len(views)}, such as {listed}")
    return views[name].camera, dataset.has_alpha, name


def _downscaled(camera: Camera, downscale: int) -> Camera:
    try:
        return camera.downscaled(downscale)
    except ValueError as error:
        raise DataError("--downscale", str(error), "use a smaller number") from error
