"""Images of linear light, raw photographs or OpenEXR, as structure from motion and a training on radiance take them.

Structure from motion sees what a screen would show of them. The exposures that raw photographs were taken with are
divided out, and those of one device share a white balance, so that a surface has one radiance in all of them.
"""

from __future__ import annotations

import math
import shutil
from collections import defaultdict
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePath

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags

from ..datasets.auto_exposure import MAX_VIEWS, white_of_lights
from ..datasets.exr import SUFFIX, is_exr, read_exr
from ..datasets.images import TURNS, header, image_size, straight_color
from ..support.cores import usable_cores
from ..support.files import replacing
from ..support.pictures import write_radiance
from ..support.srgb import displayed, luminance
from .exif import Exif, exif_of_upright
from .photographs import Photograph, camera_of, require_own_names, solid_name
from .raw_files import FULL, Balance, RawHeader, develop, is_raw, read_header
from .resampled import write_resampled

AT_ONCE = 2  # images: LibRaw has threads of its own, and a large photograph takes a gigabyte
ENOUGH = 500_000  # pixels of an image, of which a percentile is taken
XMP = 700  # the tag of TIFF


def is_light(path: Path) -> bool:
    """Whether a file is called like an image of linear light."""
    return is_raw(path) or is_exr(path)


def radiance_name(name: str) -> str:
    """The OpenEXR file of an image that structure from motion knows by this name."""
    return PurePath(name).with_suffix(SUFFIX).as_posix()


def prepare_light(
    sources: Mapping[str, Path], shown: Path, radiance: Path | None, progress: Callable[[int, int], None]
) -> list[Photograph]:
    """Write what a screen shows of each image into ``shown``, and its light into ``radiance``, unless they are there.

    In the order of the names, which change as in ``prepare``. Without ``radiance`` no light is written. Files of
    OpenEXR are copied as they are. Raises ``DataError`` for a file that cannot be read.
    """
    require_own_names(sources, shown)
    headers = {path: read_header(path) for path in sources.values() if is_raw(path)}
    development = Development(headers, list(sources.values()))
    made = [_Made.of(solid_name(name), source, shown, radiance) for name, source in sources.items()]
    white = None if all(m.is_there() for m in made) else development.white  # for all, before there are threads
    photographs: list[Photograph] = []
    with ThreadPoolExecutor(min(AT_ONCE, usable_cores())) as pool:
        for photograph in pool.map(lambda m: _prepared(m, development, white), made):
            photographs.append(photograph)
            progress(len(photographs), len(made))
    return photographs


@dataclass(frozen=True)
class _Made:
    """What is made of an image: the file ``shown``, called ``name`` in its folder, and ``radiance``, or None."""

    source: Path
    name: str
    shown: Path
    radiance: Path | None

    @staticmethod
    def of(name: str, source: Path, shown: Path, radiance: Path | None) -> _Made:
        clear = is_exr(source) and header(source)[1]
        name = PurePath(name).with_suffix(".png" if clear else ".jpg").as_posix()
        return _Made(source, name, shown / name, None if radiance is None else radiance / radiance_name(name))

    def is_there(self) -> bool:
        return all(file is None or file.is_file() for file in (self.shown, self.radiance))


@dataclass(frozen=True)
class Development:
    """How all images of a capture become light: ``headers`` are of those ``files`` that are raw."""

    headers: Mapping[Path, RawHeader]
    files: list[Path]

    @cached_property
    def balances(self) -> dict[Path, Balance]:
        """White balances: the median of those that a device chose."""
        members = defaultdict(list)
        for path, said in self.headers.items():
            members[_device(said)].append(path)
        chosen = {}
        for paths in members.values():
            red, green, blue = np.median([self.headers[path].balance for path in paths], axis=0).tolist()
            chosen |= dict.fromkeys(paths, (red, green, blue))
        return chosen

    @cached_property
    def gains(self) -> dict[Path, float]:
        """What makes up for the exposure of each raw photograph: 1 for the median. Where one does not say its exposure,
        or not all of it that another says, 1 for all."""
        exposures = {path: said.exposure for path, said in self.headers.items() if said.exposure}
        if len(exposures) < len(self.headers) or len({said.said for said in self.headers.values()}) > 1:
            return dict.fromkeys(self.headers, 1.0)
        usual = float(np.median(list(exposures.values()))) if exposures else 1.0
        return {path: usual / exposure for path, exposure in exposures.items()}

    @cached_property
    def white(self) -> float:
        """The light that a screen is to show as white, as a training on linear radiance chooses it."""
        seen = self.files[:: -(-len(self.files) // MAX_VIEWS)]
        return white_of_lights(np.concatenate([_luminances(self.light(path, half=True)) for path in seen]))

    def light(self, path: Path, half: bool = False) -> NDArray[np.float32]:
        """[H, W, 3], or [H, W, 4] premultiplied; ``half`` the size, if it is raw. Raises ``DataError``."""
        if is_exr(path):
            return read_exr(path)
        return develop(path, self.balances[path], half) * np.float32(self.gains[path])

    def saturation(self, path: Path) -> float:
        """The value of a channel from which on the sensor of a raw photograph was full."""
        return FULL * self.gains[path]


def _luminances(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """[*] of some pixels of an image, as many as a percentile needs."""
    step = max(1, round(math.sqrt(light.shape[0] * light.shape[1] / ENOUGH)))
    return luminance(light[::step, ::step, :3]).ravel()


def _device(header: RawHeader) -> tuple:
    return tuple(header.tags.get(tag) for tag in (ExifTags.Base.Make, ExifTags.Base.Model))


def _prepared(made: _Made, development: Development, white: float | None) -> Photograph:
    if white is not None and not made.is_there():
        light = development.light(made.source)
        if made.radiance is not None and is_exr(made.source):
            with replacing(made.radiance) as part:
                shutil.copyfile(made.source, part)
        elif made.radiance is not None:
            write_radiance(made.radiance, light, development.saturation(made.source))
        write_resampled(_on_screen(light, white), made.shown)
    size = image_size(made.shown)
    exif = _exif(development.headers.get(made.source), size)
    return Photograph(made.name, *size, camera_of(exif.device, size), exif.focal, None, exif.down)


def _on_screen(light: NDArray[np.float32], white: float) -> NDArray[np.float32]:
    """Display values, premultiplied where there is alpha."""
    if light.shape[2] == 3:
        return displayed(light, white)
    alpha = light[..., 3:]
    return np.concatenate([displayed(straight_color(light[..., :3], alpha), white) * alpha, alpha], axis=2)


def _exif(header: RawHeader | None, size: tuple[int, int]) -> Exif:
    if header is None:
        return Exif("", None, None)
    tags = header.tags
    return exif_of_upright(tags, size, tags.get(XMP), TURNS.get(tags.get(ExifTags.Base.Orientation, 1)))
