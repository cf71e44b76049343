"""What a viewport asks for: a picture at once, from a camera of its own, which the next request may interrupt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..support.errors import DataError
from .request import FORMAT, SOURCE, Request, read_fields


@dataclass(frozen=True)
class ViewRequest(Request):
    """A picture for a viewport.

    share: of the primitives, the most important ones, where there is no scene. background: behind splats alone, sRGB
    values, or radiance where the model is linear; None: nothing. linear: splats alone as linear radiance, not as sRGB
    values. clip: near and far end of what is seen of a scene, world units. samples: of a scene; 0 is a picture by the
    light of a lamp at the camera, without noise.
    """

    share: float = 1.0
    background: tuple[float, float, float] | None = None
    linear: bool = False
    clip: tuple[float, float] = (0.01, 1e4)


def read_view_request(content: Any) -> ViewRequest:
    """A request from JSON. Raises ``DataError`` for what cannot be drawn."""
    request = read_fields(content, ViewRequest)
    if request.camera is None or not (request.model or request.scene):
        raise DataError(SOURCE, 'has no "camera", or neither "model" nor "scene"', FORMAT)
    if request.passes:
        raise DataError(SOURCE, "a picture for a viewport has no passes", 'ask for "out" as .npz')
    return request
