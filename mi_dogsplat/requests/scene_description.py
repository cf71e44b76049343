"""A Mitsuba scene as JSON: the dictionary of ``mi.load_dict``, with what JSON has no type for.

A transform is ``{"matrix": rows}``, of four rows (or three, for textures). The values of ``filename`` are relative to
the file. There is one sensor, with a film of rgba, and no integrator: that, and the splats, are added here.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..plugin.denoising import AOV
from ..plugin.film import pixel_format_of
from ..render.denoise import require_denoiser
from ..scene.drawing import Drawing, DrawnAs, drawn_as
from ..scene.splats import DENSE, Splats
from ..support.errors import DataError
from ..support.files import read_json
from ..support.scene_errors import scene_error
from ..support.scene_loading import load_dict
from .masks import camera_masks, hides_lamps, is_masked
from .objects import objects_shine
from .request import Request

STRAIGHT = "mask", "thindielectric"  # BSDFs that light passes without being bent
FORMAT = 'write the dictionary of a Mitsuba scene, its transforms as {"matrix": [[...], ...]}'


def load_scene(request: Request, splats: mi.Shape | None, sensor: mi.Sensor | None = None) -> mi.Scene:
    """The scene of a request with the model in it, and with a sensor where that is given.

    Raises ``DataError``, also in variants that are not RGB.
    """
    assert request.scene
    if not mi.is_rgb:  # films of one channel have no alpha, and radiance of several wavelengths is no colour
        problem = f"is drawn in colour with alpha, which the variant {mi.variant()} has not"
        raise DataError(request.scene, problem, "use llvm_ad_rgb or cuda_ad_rgb")
    if request.denoise:
        require_denoiser('"denoise"')
    content = read_json(request.scene, FORMAT)
    if not isinstance(content, dict):
        raise DataError(request.scene, "is not a JSON object", FORMAT)
    try:
        described = _decoded(content, request.scene.resolve().parent)
        masked = is_masked(request) or (hides_lamps(request) and objects_shine(described))
        straight = _lets_straight(described)
        ours_alone = masked or straight or request.denoise  # what Mitsuba's own integrators cannot do
        if splats is None and ours_alone:
            splats = no_splats()
        described |= {"type": "scene", "integrator": _integrator(request, number_of(splats) > 0 or ours_alone)}
        if splats is not None:
            described["splats"] = splats
        if sensor is not None:
            described["sensor"] = sensor
        scene = load_dict(request.scene, described)
        make_opaque(scene)
    except DataError:
        raise
    except (RuntimeError, ValueError, TypeError) as error:
        raise scene_error(request.scene, error, "Mitsuba cannot load it") from error
    if len(scene.sensors()) != 1:
        raise DataError(request.scene, f"has {len(scene.sensors())} sensors", "give it one")
    if (found := pixel_format_of(scene.sensors()[0].film())) != "rgba":  # what answers have, colour and alpha
        raise DataError(request.scene, f"has a film of {found}", 'give it the "pixel_format" rgba')
    integrator: Any = scene.integrator()
    if request.transparent and straight:
        integrator.see_through = True
    if masked:
        integrator.masks = camera_masks(request, scene, number_of(splats))
    return scene


def make_opaque(scene: mi.Scene) -> None:
    """Make the numbers of sensors and emitters opaque: a lamp moves and a lens focuses without a compiler.

    Mitsuba does so itself for most. It leaves out where a rectangle is, aperture and focus of a thin lens, and the
    scale of an environment map. The values stay the same, so nothing that follows from them has to be made again.
    """
    lamps = [shape for shape in scene.shapes() if shape.is_emitter()]
    for part in (*scene.sensors(), *lamps, *scene.emitters()):
        params: Any = mi.traverse(part)
        dr.make_opaque([params[name] for name in params.keys()])


def files_of(path: Path) -> list[Path]:
    """What a scene names beside itself: meshes, pictures. Raises ``DataError`` where it is no JSON."""

    def named(value: Any) -> Iterator[Path]:
        if isinstance(value, dict):
            if isinstance(value.get("filename"), str):
                yield path.resolve().parent / value["filename"]
            value = list(value.values())
        for item in value if isinstance(value, list) else ():
            yield from named(item)

    return sorted(set(named(read_json(path, FORMAT))))


def no_splats() -> Any:
    """A model without primitives, for integrators that ask for one."""
    empty = Splats.empty(0)
    return mi.load_dict({"type": "dog", **{name: mi.TensorXf(getattr(empty, name)) for name in DENSE}})


def number_of(splats: Any | None) -> int:
    """Of the primitives of a shape, if there is one."""
    return 0 if splats is None else splats.means.shape[0]


def drawn_of(request: Request, splats: Any | None) -> DrawnAs:
    """How the splats of a shape, if there is one, are drawn: as the request says, else as their file does."""
    return drawn_as(request.drawing, Drawing() if splats is None else splats.drawing)


def hides_background(request: Request) -> bool:
    """Whether the environment is hidden together with the lamps, so that it has to be put behind the picture."""
    return request.hide_lamps and not request.transparent


def _integrator(request: Request, ours: bool) -> dict[str, Any]:
    """Path tracing; ``ours``: through splats, as cameras see otherwise than light does, or with what a denoiser needs.

    And where light passes surfaces straight: shadow rays of Mitsuba's ``path`` and ``prb`` end there.
    """
    common = {"max_depth": request.max_depth, "hide_emitters": hides_lamps(request)}
    if not ours:
        return {"type": "path" if request.transparent else "prb", **common}
    asked = {"aovs": AOV} if request.denoise else {}
    return {"type": "dogpath", **common, **asked, "mesh_shadows": request.mesh_shadows, **request.drawing.said()}


def _lets_straight(described: dict[str, Any]) -> bool:
    """Whether light passes straight through a material."""
    plugins = [value for value in described.values() if isinstance(value, dict)]
    return described.get("type") in STRAIGHT or any(_lets_straight(plugin) for plugin in plugins)


def _decoded(value: Any, folder: Path) -> Any:
    """What ``mi.load_dict`` takes."""
    if value is None:
        raise ValueError("a value is null")  # load_dict would end the process
    if isinstance(value, list):
        return [_decoded(item, folder) for item in value]
    if not isinstance(value, dict):
        return value
    if set(value) == {"matrix"}:
        matrix: Any = np.array(value["matrix"], np.float64)
        return mi.ScalarTransform3f(matrix) if matrix.shape == (3, 3) else mi.ScalarTransform4f(matrix)
    if empty := [name for name, item in value.items() if item is None]:
        raise ValueError(f'"{empty[0]}" is null')
    decoded = {name: _decoded(item, folder) for name, item in value.items()}
    if "filename" in decoded:
        decoded["filename"] = str(folder / decoded["filename"])
    return decoded
