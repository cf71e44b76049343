"""The views of a data set from their images: read once, averaged to the working size, checked against their cameras.

- **Lens distortion** is removed at full size, before downscaling (``lens.py``).
- An image that was calibrated turned, as its EXIF orientation asks for, shows as a size mismatch, and the message then
  names the tag (``images.py`` ignores it).
- **Downscaling** by K averages K x K blocks of premultiplied values (exact box filter); a remainder at the
  right and bottom is cut off, so that intrinsics are divided by exactly K.
- Either all images of a data set are linear (``exr.py``), or none is.
- A pixel is **saturated** if any of those that it is made of is: of its true mean the photograph has a lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..scene.cameras import Camera
from ..support.cores import usable_cores
from ..support.errors import DataError
from ..support.files import encoded_name
from ..support.memory import available_memory
from ..support.wording import counted, file_size
from .dataset import Recording, View, held
from .exr import is_exr
from .images import box_downscale, header, is_file, is_opaque, is_turned, read_image, saturation
from .lens import Lens, Undistortion, undistortion

JPEG = (".jpg", ".jpeg")  # neither alpha nor more than 8 bits: pixels that stay as they are take 3 bytes (``held``)
BYTES_KEPT, BYTES_READ = 12, 24  # per pixel: of a float32 image, and while one is decoded


@dataclass(frozen=True, eq=False)
class ViewSource:
    """A view before its image is read; ``camera`` and ``lens`` are those of the image at full size. Views of one
    ``rig_frame`` were taken by a rig at one moment."""

    name: str
    image_path: Path
    camera: Camera
    lens: Lens = Lens()
    rig_frame: int | None = None


def rig_frames(sources: Sequence[ViewSource]) -> dict[str, int]:
    """The rig frame of each view that has one, by its name."""
    return {source.name: source.rig_frame for source in sources if source.rig_frame is not None}


def require_files(paths: Sequence[Path]) -> None:
    """Raise ``DataError`` that names the first missing image and how many are missing."""
    missing = [path for path in paths if not is_file(path)]
    for path in missing:
        encoded_name(path.name, path)
    if missing:
        raise DataError(
            missing[0],
            f"image not found ({len(missing)} of {len(paths)} are missing)",
            "put the images where the data set names them, or remove the entries",
        )


def load_views(
    sources: Sequence[ViewSource], downscale: int, prescaled: bool = False, on_disk: bool = False
) -> tuple[list[View], bool]:
    """Read all images: (views, has_alpha). Order is kept.

    ``on_disk``: only their headers are read now, and pixels until one is found that is not opaque.

    ``prescaled``: the files already are ``downscale`` times smaller than their cameras (an ``images_4``
    folder); their rounded sizes are accepted and the intrinsics scaled by the exact ratio of each axis. An
    alpha channel that is 1 everywhere is dropped; where only some images have one, the rest get ones. Images of linear
    radiance have a ``white`` of 1. Raises ``DataError`` for a file that cannot be read, a size that is not the
    camera's, and for images of which only some are linear.
    """
    return (_on_disk if on_disk else _in_memory)(sources, downscale, prescaled, _white(sources))


def _on_disk(
    sources: Sequence[ViewSource], downscale: int, prescaled: bool, white: float | None
) -> tuple[list[View], bool]:
    """Views that read their images when these are asked for; only headers are read now."""
    headers = [header(source.image_path) for source in sources]
    pairs = zip(sources, headers, strict=True)
    has_alpha = any(alpha and not is_opaque(source.image_path) for source, (_, alpha) in pairs)

    def view_of(source: ViewSource, size: tuple[int, int]) -> View:
        def read() -> Recording:
            return _with_channels(_load_view(source, downscale, prescaled).recording, has_alpha)

        camera, straight = _camera_of(source, downscale, prescaled, size)
        return View(source.name, camera, read, straight, white)

    return [view_of(source, size) for source, (size, _) in zip(sources, headers, strict=True)], has_alpha


def _in_memory(
    sources: Sequence[ViewSource], downscale: int, prescaled: bool, white: float | None
) -> tuple[list[View], bool]:
    """Views with their images, as bytes where these hold all that there is of them."""

    def load(source: ViewSource) -> View:
        view = _load_view(source, downscale, prescaled)
        return view if white else held(view)

    workers = min(8, usable_cores())
    as_in_file = downscale == 1 or prescaled
    _require_memory(sources, downscale, as_in_file, workers)
    with ThreadPoolExecutor(workers) as pool:  # Pillow decodes without holding the GIL
        views = list(pool.map(load, sources))
    has_alpha = any(_transparent(view) for view in views)

    def with_channels(view: View) -> View:
        if view.pixels is not None and not has_alpha:
            return view
        recording = _with_channels(view.recording, has_alpha)
        whole = View(view.name, view.camera, recording, view.straight, white)
        return whole if white else held(whole)

    return [with_channels(view) for view in views], has_alpha


def _white(sources: Sequence[ViewSource]) -> float | None:
    """1 where all images are linear, None where all are display-referred."""
    linear = [is_exr(source.image_path) for source in sources]
    if any(linear) and not all(linear):
        path = sources[linear.index(False)].image_path
        raise DataError(path, "is display-referred, and other images are linear OpenEXR", "use one kind for all images")
    return 1.0 if any(linear) else None


def _transparent(view: View) -> bool:
    return view.pixels is None and view.image.shape[2] == 4 and view.image[..., 3].min() < 1


def _require_memory(sources: Sequence[ViewSource], downscale: int, as_in_file: bool, workers: int) -> None:
    """Raise ``DataError`` unless there is memory for the images: better than to be killed for it."""
    pixels = [source.camera.width * source.camera.height for source in sources]
    as_bytes = [as_in_file and source.lens.straight and source.image_path.suffix.lower() in JPEG for source in sources]
    kept = sum(n * (3 if small else BYTES_KEPT) for n, small in zip(pixels, as_bytes, strict=True))
    needed = kept / downscale**2 + BYTES_READ * workers * max(pixels, default=0)
    free = available_memory()
    if free is not None and needed > free:
        images = counted(len(pixels), "image")
        problem = f"{images} would take {file_size(needed)} of memory, and {file_size(free)} are free"
        factor = math.ceil(downscale * math.sqrt(needed / free))
        raise DataError(sources[0].image_path.parent, problem, f"shrink them: --downscale {factor} or more")


def _load_view(source: ViewSource, downscale: int, prescaled: bool) -> View:
    pixels = read_image(source.image_path)  # [H, W, C]
    camera, straight = _camera_of(source, downscale, prescaled, (pixels.shape[1], pixels.shape[0]))
    full = _saturated(pixels, saturation(source.image_path))
    if straight:
        pixels = straight.image(pixels, unlimited=is_exr(source.image_path))
        full = None if full is None else straight.image(full, unlimited=True)  # which does not ring far away
    recording = Recording(pixels, None if full is None else full[..., 0] > 0)
    return View(source.name, camera, recording if prescaled else shrunk(recording, downscale), straight)


def _saturated(pixels: np.ndarray, level: float | None) -> np.ndarray | None:
    """[H, W, 1], 1 where a channel of a pixel [H, W, C] reaches the ``level``, else 0; None where none does."""
    if level is None or not (full := pixels[..., :3].max(axis=2, keepdims=True) >= level).any():
        return None
    return full.astype(np.float32)


def shrunk(recording: Recording, k: int) -> Recording:
    """A photograph with means over k x k pixels for each, which are saturated where any of these is."""
    if k == 1:
        return recording
    full = recording.saturated
    full = None if full is None else box_downscale(full[..., None], k)[..., 0] > 0
    return Recording(box_downscale(recording.image, k), full)


def _camera_of(
    source: ViewSource, downscale: int, prescaled: bool, size: tuple[int, int]
) -> tuple[Camera, Undistortion | None]:
    """Camera of a loaded view, from the size of its file, and how its lens is removed before downscaling."""
    camera, path, (width, height) = source.camera, source.image_path, size
    if prescaled:
        off = max(abs(width * downscale - camera.width), abs(height * downscale - camera.height))
        if off >= downscale:
            raise _wrong_size(path, width, height, f"1/{downscale} of {camera.width}x{camera.height}")
        camera = camera.resized(width, height)
    elif size != (camera.width, camera.height):
        raise _wrong_size(path, width, height, f"{camera.width}x{camera.height}")
    straight = None
    if not source.lens.straight:
        try:
            straight = undistortion(camera, source.lens)
        except ValueError as error:
            raise DataError(path, str(error), "correct the distortion coefficients") from error
        camera = straight.camera
    try:
        return camera if prescaled else camera.downscaled(downscale), straight
    except ValueError as error:
        raise DataError(path, str(error), "choose a smaller downscale factor") from error


def _with_channels(recording: Recording, has_alpha: bool) -> Recording:
    """The photograph with exactly 4 channels where the data set has alpha, else exactly 3."""
    image = recording.image
    if has_alpha and image.shape[2] == 3:
        image = np.concatenate([image, np.ones_like(image[..., :1])], axis=2)
    return replace(recording, image=image if has_alpha else np.ascontiguousarray(image[..., :3]))


def _wrong_size(path: Path, width: int, height: int, expected: str) -> DataError:
    remedy = "use the images the cameras were calibrated with"
    if is_turned(path):
        remedy += " (its EXIF orientation is ignored: apply it to the pixels if they were calibrated turned)"
    return DataError(path, f"the image is {width}x{height}, its camera says {expected}", remedy)
