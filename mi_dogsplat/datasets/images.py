"""Reading images once: premultiplied, box-averaged to the working size, checked against their cameras.

- **Lens distortion** is removed at full size, before downscaling (``lens.py``).
- **EXIF orientation is ignored.** Structure from motion calibrates the stored pixel grid, so turning the
  image would break its camera. A file that was calibrated turned shows as a size mismatch, and the message
  then names the tag.
- **Downscaling** by K averages K x K blocks of premultiplied values (exact box filter); a remainder at the
  right and bottom is cut off, so that intrinsics are divided by exactly K.
- **OpenEXR** holds linear radiance (``exr.py``); all images of a data set are linear then, or none is.
- 16-bit grey PNG keeps its depth; 16-bit colour PNG is read with 8 bits, which is what Pillow offers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from ..scene.cameras import Camera
from ..support.cores import usable_cores
from ..support.errors import DataError
from ..support.memory import available_memory
from ..support.wording import file_size
from .claimed_size import require_photograph
from .dataset import ByteView, DiskView, View, held
from .exr import exr_header, is_exr, read_exr
from .lens import Lens, Undistortion, undistortion

EXIF_ORIENTATION = 274
FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "PPM", "GIF")  # others start programs, or trust the file's name
JPEG = (".jpg", ".jpeg")  # neither alpha nor more than 8 bits: pixels that stay as they are take 3 bytes (``ByteView``)
BYTES_KEPT, BYTES_READ = 12, 24  # per pixel: of a float32 image, and while one is decoded
Image.init()  # makes all formats known: by itself Pillow does so when the first few have failed
UNREADABLE = (
    OSError,
    SyntaxError,
    ValueError,
    Image.DecompressionBombError,
)  # what Pillow raises for bad files


@dataclass(frozen=True, eq=False)
class ViewSource:
    """A view before its image is read; ``camera`` and ``lens`` are those of the image at full size."""

    name: str
    image_path: Path
    camera: Camera
    lens: Lens = Lens()


def require_files(paths: Sequence[Path]) -> None:
    """Raise ``DataError`` that names the first missing image and how many are missing."""
    missing = [path for path in paths if not is_file(path)]
    if missing:
        raise DataError(
            missing[0],
            f"image not found ({len(missing)} of {len(paths)} are missing)",
            "put the images where the data set names them, or remove the entries",
        )


def is_file(path: Path) -> bool:
    """``path.is_file()``, and False for what can be no file: a name of 300 characters, or one in a loop of links."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def open_image(path: Path) -> Image.Image:
    """An image whose pixels are not read yet. Raises one of ``UNREADABLE``, also for a decompression bomb."""
    image = Image.open(path, formats=FORMATS)
    try:
        require_photograph(image.width, image.height, path.stat().st_size)
    except ValueError:
        image.close()
        raise
    return image


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) of an image from its header alone. Raises ``DataError``."""
    return _header(path)[0]


def load_views(
    sources: Sequence[ViewSource], downscale: int, prescaled: bool = False, on_disk: bool = False
) -> tuple[list[View], bool]:
    """Read all images: (views, has_alpha). Order is kept.

    ``on_disk``: only their headers are read now (``DiskView``), and pixels until one is found that is not opaque.

    ``prescaled``: the files already are ``downscale`` times smaller than their cameras (an ``images_4``
    folder); their rounded sizes are accepted and the intrinsics scaled by the exact ratio of each axis. An
    alpha channel that is 1 everywhere is dropped; where only some images have one, the rest get ones. Images of linear
    radiance have a ``white`` of 1. Raises ``DataError`` for a file that cannot be read, a size that is not the
    camera's, and for images of which only some are linear.
    """
    white = _white(sources)

    def load(source: ViewSource) -> View:
        return _load_view(source, downscale, prescaled)

    if on_disk:
        headers = [_header(source.image_path) for source in sources]
        pairs = zip(sources, headers, strict=True)
        any_alpha = any(alpha and not _opaque(source.image_path) for source, (_, alpha) in pairs)

        def view_of(source: ViewSource, size: tuple[int, int]) -> View:
            camera, straight = _camera_of(source, downscale, prescaled, size)
            return DiskView(source.name, camera, lambda: _with_channels(load(source).image, any_alpha), straight, white)

        return [view_of(source, size) for source, (size, _) in zip(sources, headers, strict=True)], any_alpha

    workers = min(8, usable_cores())
    as_in_file = downscale == 1 or prescaled
    _require_memory(sources, downscale, as_in_file, workers)
    with ThreadPoolExecutor(workers) as pool:  # Pillow decodes without holding the GIL
        views = list(pool.map(lambda source: load(source) if white else held(load(source)), sources))
    has_alpha = any(_transparent(view) for view in views)

    def with_channels(view: View) -> View:
        if isinstance(view, ByteView) and not has_alpha:
            return view
        whole = View(view.name, view.camera, _with_channels(view.image, has_alpha), view.straight, white)
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
    return not isinstance(view, ByteView) and view.image.shape[2] == 4 and view.image[..., 3].min() < 1


def _require_memory(sources: Sequence[ViewSource], downscale: int, as_in_file: bool, workers: int) -> None:
    """Raise ``DataError`` unless there is memory for the images: better than to be killed for it."""
    pixels = [source.camera.width * source.camera.height for source in sources]
    as_bytes = [as_in_file and source.lens.straight and source.image_path.suffix.lower() in JPEG for source in sources]
    kept = sum(n * (3 if small else BYTES_KEPT) for n, small in zip(pixels, as_bytes, strict=True))
    needed = kept / downscale**2 + BYTES_READ * workers * max(pixels, default=0)
    free = available_memory()
    if free is not None and needed > free:
        problem = f"{len(pixels)} images need {file_size(needed)} of memory, and {file_size(free)} are free"
        factor = math.ceil(downscale * math.sqrt(needed / free))
        raise DataError(sources[0].image_path.parent, problem, f"shrink them: --downscale {factor} or more")


def box_downscale(image: np.ndarray, k: int) -> np.ndarray:
    """Mean over k x k blocks: [H, W, C] -> float32 [H // k, W // k, C]."""
    height, width = image.shape[0] // k, image.shape[1] // k
    blocks = image[: height * k, : width * k].reshape(height, k, width, k, -1)  # [H/k, k, W/k, k, C]
    return blocks.mean(axis=(1, 3), dtype=np.float32)


def read_image(path: Path) -> np.ndarray:
    """Display values of an image file, or linear radiance of OpenEXR: float32 [H, W, 3], or [H, W, 4] premultiplied.

    Raises ``DataError``.
    """
    if is_exr(path):
        return read_exr(path)
    try:
        with open_image(path) as image:
            if image.mode == "F":
                raise ValueError("floating-point pixels have no display range")
            if image.mode.startswith("I"):  # 16-bit grey
                grey = np.asarray(image, dtype=np.float32) / 65535  # [H, W]
                return np.repeat(grey[..., None], 3, axis=2)
            alpha = "A" in image.getbands() or "transparency" in image.info
            pixels = (
                np.asarray(image.convert("RGBA" if alpha else "RGB"), dtype=np.float32) / 255
            )  # [H, W, 3 or 4]
    except UNREADABLE as error:
        raise _corrupt(path, error) from error
    if pixels.shape[2] == 4:
        pixels[..., :3] *= pixels[..., 3:]
    return pixels


def _load_view(source: ViewSource, downscale: int, prescaled: bool) -> View:
    pixels = read_image(source.image_path)  # [H, W, C]
    camera, straight = _camera_of(source, downscale, prescaled, (pixels.shape[1], pixels.shape[0]))
    if straight:
        pixels = straight.image(pixels)
    pixels = pixels if prescaled or downscale == 1 else box_downscale(pixels, downscale)
    return View(source.name, camera, pixels, straight)


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


def _header(path: Path) -> tuple[tuple[int, int], bool]:
    """((width, height), whether there is an alpha channel) of an image from its header alone. Raises ``DataError``."""
    if is_exr(path):
        return exr_header(path)
    try:
        with open_image(path) as image:
            return image.size, "A" in image.getbands() or "transparency" in image.info
    except UNREADABLE as error:
        raise _corrupt(path, error) from error


def _opaque(path: Path) -> bool:
    """Whether an image with an alpha channel does without. Raises ``DataError``."""
    if is_exr(path):
        return bool((read_exr(path)[..., 3] == 1).all())
    try:
        with open_image(path) as image:
            return image.convert("RGBA").getchannel("A").getextrema() == (255, 255)
    except UNREADABLE as error:
        raise _corrupt(path, error) from error


def _with_channels(image: np.ndarray, has_alpha: bool) -> np.ndarray:
    """The image with exactly 4 channels where the data set has alpha, else exactly 3."""
    if has_alpha and image.shape[2] == 3:
        return np.concatenate([image, np.ones_like(image[..., :1])], axis=2)
    return image if has_alpha else np.ascontiguousarray(image[..., :3])


def _wrong_size(path: Path, width: int, height: int, expected: str) -> DataError:
    turned = not is_exr(path) and _is_turned(path)
    remedy = "use the images the cameras were calibrated with"
    if turned:
        remedy += " (its EXIF orientation is ignored: apply it to the pixels if they were calibrated turned)"
    return DataError(path, f"the image is {width}x{height}, its camera says {expected}", remedy)


def _is_turned(path: Path) -> bool:
    with open_image(path) as image:
        return image.getexif().get(EXIF_ORIENTATION, 1) != 1


def _corrupt(path: Path, error: Exception) -> DataError:
    return DataError(path, f"cannot be read as an image ({error})", "replace the file or remove its entry")
