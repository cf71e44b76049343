"""``dogsplat info --features``: what a model, scene, run or data set needs, at what cost, and what was left out."""

from __future__ import annotations

from pathlib import Path

from ..formats.read import read_model
from ..support.arguments import checks_arguments
from ..support.scene_errors import scene_error
from ..support.variants import require_arrays
from .features import choices_of_a_render, model_features, scene_features, splat_scene
from .info import kind_of
from .training_features import dataset_features, run_features

LEGEND = (
    "operations are instructions of the kernels; each: of a primitive, to project it; "
    "per pixel: of a primitive at a pixel that it meets, forward + derivative"
)


@checks_arguments
def describe_features(path: str | Path) -> list[str]:
    """Lines about what is at ``path``. Needs a Mitsuba variant. Raises ``DataError``, as ``info.describe`` does."""
    require_arrays()
    path = Path(path)
    kind = kind_of(path)
    if kind == "model":
        found = model_features([read_model(path).splats]) + choices_of_a_render()
    elif kind == "run":
        found = run_features(path)
    else:
        scene = splat_scene(path)
        try:
            found = scene_features(scene) if scene else dataset_features(path)
        except RuntimeError as error:  # of what it is drawn with
            raise scene_error(path, error, "cannot be drawn") from error
    return [f"{path}: what it needs and what is left out", *map(str, found), LEGEND]
