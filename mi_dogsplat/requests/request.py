"""What another program asks for: splats alone by a camera, or a whole scene.

.. code-block:: json

    {"model": "model.ply", "camera": {"w2c": [], "fx": 500, "width": 640, "height": 480}, "passes": ["depth"]}
    {"model": "model.ply", "scene": "scene.json", "samples": 64, "max_depth": 8}

``camera`` is that of a camera file; ``scene`` is described in ``scene_description.py`` and needs no model.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

from ..scene.camera_file import camera_from_json
from ..scene.cameras import Camera
from ..scene.drawing import Drawing
from ..support.errors import DataError
from .fields import KINDS

PASSES = ("depth", "normal", "object", "matte")
SOURCE = "request"  # what error lines name
FORMAT = 'write {"model": PLY, "camera": {...}} or {"scene": JSON, "samples": N}, as docs/blender_details.md says'
RequestKind = TypeVar("RequestKind", bound="Request")


@dataclass(frozen=True)
class Request:
    """One picture.

    model: primitives, in world space; None: a scene without splats. camera: for splats alone. orthographic: it sees
    along parallel rays, and its focal lengths are pixels per unit. film: of a camera that sees a part of a picture, all
    of it: (left, top, right, bottom) in pixels of the camera; splats look as they do there, whose shapes are held near
    the sides of a picture. None: the camera sees all. scene: a description with sensor, surfaces and lights. near_clip,
    antialiased: None is as the file of the model says. counts: how many primitives each object of the model has, one
    after the other. passes: of ``PASSES``. transparent: nothing is shown behind a scene. hide_lamps: the camera does
    not see shapes that emit light and are no objects by their ids, though surfaces reflect them; neither does that of a
    transparent scene. max_depth: of light paths, as in Mitsuba's ``path``. mesh_shadows: surfaces of a scene cast
    shadows onto the splats, see ``dogpath``. holdout, indirect_only: numbers of objects that cut a hole into the
    picture, and that the camera looks through; both are there for light. denoise: a scene, when all samples are there.
    """

    model: Path | None = None
    camera: Camera | None = None
    orthographic: bool = False
    film: tuple[float, float, float, float] | None = None
    scene: Path | None = None
    near_clip: float | None = None
    antialiased: bool | None = None
    counts: tuple[int, ...] = ()
    passes: tuple[str, ...] = ()
    samples: int = 16
    max_depth: int = 8
    seed: int = 0
    transparent: bool = False
    hide_lamps: bool = False
    mesh_shadows: bool = False
    denoise: bool = False
    holdout: tuple[int, ...] = ()
    indirect_only: tuple[int, ...] = ()

    @property
    def drawing(self) -> Drawing:
        """What it says on how the model is drawn."""
        return Drawing(self.antialiased, self.near_clip)


def read_request(content: Any) -> Request:
    """A request from JSON. Raises ``DataError`` for what cannot be drawn."""
    request = read_fields(content, Request)
    if (request.camera is None) == (request.scene is None) or (request.camera and request.model is None):
        raise DataError(SOURCE, 'has to have either "model" and "camera", or "scene"', FORMAT)
    if request.orthographic and request.scene:
        raise DataError(SOURCE, '"orthographic" is for "camera"', 'give the sensor of "scene" the type orthographic')
    if request.samples < 1:
        raise DataError(SOURCE, '"samples" is 0', "give at least 1")
    return request


def read_fields(content: Any, kind: type[RequestKind]) -> RequestKind:
    """A request of some kind, each field by itself; null is as if it were not there. Raises ``DataError``."""
    if not isinstance(content, dict):
        raise DataError(SOURCE, "is not a JSON object", FORMAT)
    if unknown := sorted(content.keys() - {field.name for field in fields(kind)}):
        raise DataError(SOURCE, f'"{unknown[0]}" means nothing', FORMAT)
    values = {name: value for name, value in content.items() if value is not None}
    for name, value in values.items():
        if name in KINDS and not KINDS[name].holds(value):
            raise DataError(SOURCE, f'"{name}" is {json.dumps(value)}', f"give {KINDS[name].name}")
        if isinstance(value, list):
            values[name] = tuple(value)
    values |= {name: Path(values[name]) for name in ("model", "scene") if name in values}
    try:
        if "camera" in values:
            values["camera"] = camera_from_json(values["camera"], mirror=True)
    except (ValueError, TypeError, OverflowError) as error:
        raise DataError(SOURCE, str(error), FORMAT) from error
    request = kind(**values)
    if strange := [name for name in request.passes if name not in PASSES]:
        raise DataError(SOURCE, f'unknown pass "{strange[0]}"', f"ask for {', '.join(PASSES)}")
    return request
