"""A Mitsuba scene to a picture, as one of its sensors and its own integrator see it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..datasets.scene_file import warn_of_unseen_splats
from ..plugin.denoising import AOV, CHANNELS
from ..plugin.film import pixel_format_of
from ..support.errors import DataError, interruptible, undisguised
from ..support.scene_errors import as_mitsuba_reads, scene_error
from ..support.threads import threads_to_load
from ..support.wording import counted
from .denoise import denoised, require_denoiser
from .picture_memory import require_memory

TAKEN = ("path", "parallel", "optimize")  # arguments of ``mi.load_file``
_UNUSED = re.compile(r"unused parameters:\s+- \$(?P<name>.+)=")


def picture_of_scene(
    path: Path,
    spp: int,
    on_pass: Callable[[int, int], None] | None,
    denoise: bool,
    sensor: int,
    defined: Mapping[str, str] | None,
    suffix: str,
) -> Any:
    """The ``mi.Bitmap`` of a scene, with all channels of its film; type stubs lack what is used of it.

    Args:
        path: the scene, .xml.
        spp: samples per pixel; 0 is what the scene says.
        on_pass: called with the number of samples that each pixel has, and that of all, by integrators that splat.
        denoise: the picture of an integrator ``dogpath``, see ``denoise.py``.
        sensor: which one, in the order of the file, from 0.
        defined: values of parameters of the scene, which it calls ``$name``, by their names.
        suffix: of the file that is to be made of it, by which its memory is estimated.

    Needs a Mitsuba variant. Raises ``DataError``, also for what Mitsuba has to say about the scene.
    """
    if spp < 0:
        raise DataError("--spp", f"{spp} samples per pixel are not possible", "give 1 or more")
    if not path.is_file():
        raise DataError(path, "no such file", "give a model .ply or a Mitsuba scene .xml")
    if denoise:
        require_denoiser("--denoise")
    file = as_mitsuba_reads(path)
    with undisguised(on_pass) as told:
        try:
            scene = _loaded(file, defined or {})
            film = _film(scene, file, sensor)
            integrator = _integrator(scene, file, told, defined)
            width, height = map(int, film.crop_size())
            require_memory(file, width, height, suffix, "make its film smaller")
            if denoise:
                _ask_for_guides(integrator, film)
            with interruptible():
                image = mi.render(scene, sensor=sensor, spp=spp)
            return _smoothed(image, integrator) if denoise else film.bitmap()
        except (RuntimeError, ValueError) as error:  # plugins report wrong parameters and files with either
            if isinstance(error, DataError):
                raise
            raise scene_error(path, error, "Mitsuba cannot render it") from error


def _film(scene: Any, file: str, sensor: int) -> Any:
    """Of the sensor with this number."""
    if not isinstance(scene, mi.Scene):
        raise RuntimeError("its root is no scene")
    n_sensors = len(scene.sensors())
    if not n_sensors:
        raise RuntimeError("it has no sensor")
    if not 0 <= sensor < n_sensors:
        raise DataError("--sensor", f"{file} has {counted(n_sensors, 'sensor')}", f"give 0 to {n_sensors - 1}")
    return scene.sensors()[sensor].film()


def _integrator(scene: Any, file: str, on_pass: Any, defined: Mapping[str, str] | None) -> Any:
    """That of the scene, which tells of its samples where it splats."""
    from ..plugin.splat_integrator import SplatIntegrator  # of the active variant

    integrator = scene.integrator()
    if integrator is None:
        raise RuntimeError("it has no integrator")
    if isinstance(integrator, SplatIntegrator):
        integrator.on_pass = on_pass
    else:
        warn_of_unseen_splats(Path(file), defined)
    return integrator


def _smoothed(image: Any, integrator: Any) -> Any:
    """The ``mi.Bitmap`` of a render without its noise and the channels that tell of it."""
    names = integrator.aov_names()
    kept = [*"RGBA"[: image.shape[-1] - len(names)], *(name for name in names if name not in CHANNELS)]
    return mi.Bitmap(denoised(np.array(image), names), mi.Bitmap.PixelFormat.MultiChannel, kept)


def _loaded(file: str, defined: Mapping[str, Any]) -> Any:
    """What Mitsuba makes of a file. Raises ``DataError`` for definitions that the scene has no use for."""
    if taken := next((name for name in TAKEN if name in defined), None):
        remedy = "give the parameter of the scene another name"
        raise DataError("--define", f'Mitsuba keeps the name "{taken}" for itself', remedy)
    try:
        with threads_to_load():
            return mi.load_file(file, **defined)
    except RuntimeError as error:
        if (unused := _UNUSED.search(str(error))) is None:
            raise
        problem, remedy = f'{file} has no parameter "${unused["name"]}"', "leave it out, or correct its name"
        raise DataError("--define", problem, remedy) from error


def _ask_for_guides(integrator: Any, film: mi.Film) -> None:
    """Of a render that is to be denoised. Raises ``DataError`` where it cannot be."""
    if AOV not in getattr(integrator, "further_aovs", ()):
        remedy = 'give the scene <integrator type="dogpath"/>, or leave the flag out'
        raise DataError("--denoise", "is for the integrator dogpath, and the scene has another", remedy)
    if (found := pixel_format_of(film)) not in ("rgb", "rgba"):
        raise DataError("--denoise", f'is for colours, and the film is {found}', 'choose the "pixel_format" rgb')
    integrator.denoising = True
