"""``dogsplat info --features``: what is at a place, what it needs, what that costs, and what is left out."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi

from ..scene.ply import read_ply
from ..support.errors import DataError
from .features import choices_of_a_render, model_features, scene_features
from .info import kind_of
from .training_features import dataset_features, run_features

LEGEND = (
    "operations are instructions of the kernels; each: of a primitive, to project it; "
    "per pixel: of a primitive at a pixel that it meets, forward + derivative"
)


def describe_features(path: str | Path) -> list[str]:
    """Lines about what is at ``path``. Needs a Mitsuba variant. Raises ``DataError``, as ``info.describe`` does."""
    path = Path(path)
    kind = kind_of(path)
    if kind == "model":
        found = model_features([read_ply(path)]) + choices_of_a_render()
    elif kind == "run":
        found = run_features(path)
    else:
        scene = _splat_scene(path)
        found = scene_features(scene) if scene else dataset_features(path)
    return [f"{path}: what it needs and what is left out", *map(str, found), LEGEND]


def _splat_scene(path: Path) -> mi.Scene | None:
    """The Mitsuba scene at ``path`` if it is one of ``dog`` shapes and the ``dogsplat`` integrator."""
    from ..integrator import DogSplatIntegrator  # of the active variant
    from ..shape_dog import DogShape

    if path.suffix != ".xml":
        return None
    try:
        scene = mi.load_file(str(path))
    except Exception as error:  # Mitsuba raises several kinds, all of them with a message to show
        raise DataError(path, f"Mitsuba cannot load it ({error})", "correct the scene") from error
    if not isinstance(scene, mi.Scene) or not isinstance(scene.integrator(), DogSplatIntegrator):
        return None
    return scene if any(isinstance(shape, DogShape) for shape in scene.shapes()) else None
