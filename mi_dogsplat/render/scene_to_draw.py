"""A Mitsuba scene that is to be drawn: loaded, with the sensor that sees it, and what is wrong with it in one line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import mitsuba as mi
import numpy as np

from ..datasets.scene_file import warn_of_unseen_splats
from ..plugin.denoising import AOV, CHANNELS
from ..plugin.film import pixel_format_of
from ..plugin.samples import MOST_PASSES
from ..support.errors import DataError, interruptible, undisguised
from ..support.scene_errors import scene_error
from ..support.scene_limits import MOST_SAMPLES
from ..support.scene_loading import load_file
from ..support.wording import counted
from .denoise import denoised, require_denoiser

TAKEN = ("path", "parallel", "optimize")  # arguments of ``mi.load_file``
_UNUSED = re.compile(r"unused parameters:\s+- \$(?P<name>.+)=")


@dataclass(frozen=True)
class SceneOptions:
    """How a scene is drawn.

    spp: samples per pixel; 0 is what the scene says.
    denoise: the picture of an integrator ``dogpath``, see ``denoise.py``.
    sensor: which one, in the order of the file, from 0.
    defined: values of parameters of the scene, which it calls ``$name``, by their names; None: none.
    """

    spp: int = 0
    denoise: bool = False
    sensor: int = 0
    defined: Mapping[str, str] | None = None


@dataclass(frozen=True, eq=False)
class SceneToDraw:
    """The ``scene`` of a file, the ``sensor`` that sees it and the ``integrator`` that draws it."""

    file: Path
    scene: Any
    sensor: Any
    integrator: Any
    options: SceneOptions

    def rendered(self, on_pass: Callable[[int, int], None] | None = None, seed: int = 0) -> Any:
        """What the integrator makes of it, a ``mi.Bitmap``: all channels of the film, and those of a denoiser. Of an
        integrator ``aov`` what ``mi.render`` returns lacks some.

        Integrators that splat call ``on_pass`` with the number of samples that each pixel has, and that of all. Raises
        ``DataError`` for what Mitsuba has to say about the scene.
        """
        with undisguised(on_pass) as told, mitsuba_errors(self.file), interruptible():
            if hasattr(self.integrator, "on_pass"):
                self.integrator.on_pass = told
            mi.render(self.scene, sensor=self.sensor, spp=self.options.spp, seed=cast(Any, seed))
            return self.sensor.film().bitmap()

    def without_noise(self, bitmap: Any) -> Any:
        """Such a bitmap without the noise that is to be smoothed and the channels that tell of it."""
        if not self.options.denoise:
            return bitmap
        names = self.integrator.aov_names()
        kept = [name for name in channel_names(bitmap) if name not in CHANNELS]
        return mi.Bitmap(denoised(pixels_of(bitmap), names), mi.Bitmap.PixelFormat.MultiChannel, kept)


def scene_to_draw(path: Path, options: SceneOptions) -> SceneToDraw:
    """The scene of a file, .xml, as it is to be drawn.

    Needs a Mitsuba variant. Raises ``DataError``, also for what Mitsuba has to say about the scene.
    """
    _require_spp(options.spp, MOST_SAMPLES)
    if not path.is_file():
        raise DataError(path, "no such file", "give a model .ply or a Mitsuba scene .xml")
    if options.denoise:
        require_denoiser("--denoise")
    with mitsuba_errors(path):
        scene = _loaded(path, options.defined or {})
        sensor = _sensor(scene, path, options.sensor)
        integrator = _integrator(scene, path, options)
        if options.denoise:
            _ask_for_guides(integrator, sensor.film())
        return SceneToDraw(path, scene, sensor, integrator, options)


def channel_names(bitmap: Any) -> list[str]:
    """Of a ``mi.Bitmap``, in order."""
    return [field.name for field in bitmap.struct_()]


def pixels_of(bitmap: Any) -> np.ndarray:
    """Those of a ``mi.Bitmap``, float32 [H, W, channels]."""
    return np.array(bitmap, np.float32).reshape(bitmap.height(), bitmap.width(), -1)


@contextmanager
def mitsuba_errors(path: Path) -> Iterator[None]:
    """What Mitsuba has to say about the scene of a file within, as a ``DataError``."""
    try:
        yield
    except (RuntimeError, ValueError) as error:  # plugins report wrong parameters and files with either
        if isinstance(error, DataError):
            raise
        raise scene_error(path, error, "Mitsuba cannot render it") from error


def _sensor(scene: Any, path: Path, number: int) -> Any:
    """The one with this number."""
    if not isinstance(scene, mi.Scene):
        raise RuntimeError("its root element is not <scene>")
    n_sensors = len(scene.sensors())
    if not n_sensors:
        raise RuntimeError("it has no sensor")
    if not 0 <= number < n_sensors:
        raise DataError("--sensor", f"{path} has {counted(n_sensors, 'sensor')}", f"give 0 to {n_sensors - 1}")
    return scene.sensors()[number]


def _integrator(scene: Any, path: Path, options: SceneOptions) -> Any:
    """That of the scene. Raises ``DataError`` for more samples than it takes."""
    from ..plugin.splat_integrator import SplatIntegrator  # of the active variant

    integrator = scene.integrator()
    if integrator is None:
        raise RuntimeError("it has no integrator")
    if isinstance(integrator, SplatIntegrator):
        _require_spp(options.spp, MOST_PASSES)
    else:
        warn_of_unseen_splats(path, options.defined)
    return integrator


def _require_spp(spp: int, most: int) -> None:
    """Raise ``DataError`` for numbers of samples that nobody can render."""
    if not 0 <= spp <= most:
        raise DataError("--spp", f"{spp} samples per pixel are not possible", f"give 1 to {most}, or 0 for the scene's")


def _loaded(path: Path, defined: Mapping[str, str]) -> Any:
    """What Mitsuba makes of a file. Raises ``DataError`` for definitions that the scene has no use for."""
    if taken := next((name for name in TAKEN if name in defined), None):
        remedy = "give the parameter of the scene another name"
        raise DataError("--define", f'Mitsuba keeps the name "{taken}" for itself', remedy)
    try:
        return load_file(path, defined)
    except RuntimeError as error:
        if (unused := _UNUSED.search(str(error))) is None:
            raise
        problem, remedy = f'{path} has no parameter "${unused["name"]}"', "leave it out, or correct its name"
        raise DataError("--define", problem, remedy) from error


def _ask_for_guides(integrator: Any, film: mi.Film) -> None:
    """Of a render that is to be denoised. Raises ``DataError`` where it cannot be."""
    if AOV not in getattr(integrator, "further_aovs", ()):
        remedy = 'give the scene <integrator type="dogpath"/>, or leave the flag out'
        raise DataError("--denoise", "is for the integrator dogpath, and the scene has another", remedy)
    if (found := pixel_format_of(film)) not in ("rgb", "rgba"):
        raise DataError("--denoise", f'needs colours, but the film is {found}', 'choose the "pixel_format" rgb')
    integrator.denoising = True
