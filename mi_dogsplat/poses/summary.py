"""What was found, in numbers (``summary.json``) and in words."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ..support.errors import DataError
from ..support.files import read_json, write_json
from ..support.wording import counted, duration
from .advice import Advice, Outcome
from .photographs import Photograph
from .world import Placed

SUMMARY = "summary.json"
MOST_NAMES = 5

S = TypeVar("S", bound="Stored")


@dataclass(frozen=True)
class Stored:
    """A summary in the folder of the data set that it is of."""

    @classmethod
    def read(cls: type[S], folder: Path) -> S:
        """That of a data set. Raises ``DataError``."""
        remedy = "remove the folder, and start again"
        try:
            return cls(**read_json(folder / SUMMARY, remedy))
        except TypeError as error:
            raise DataError(folder / SUMMARY, f"is not a summary ({error})", remedy) from error

    def write(self, folder: Path) -> None:
        """Write it into the folder of its data set."""
        write_json(folder / SUMMARY, dataclasses.asdict(self))


@dataclass(frozen=True)
class Summary(Stored):
    """``error``: mean reprojection error in pixels; ``cameras``: a line each; ``without_pose``: names of images;
    ``up_from``: how up was found; ``scale``: metres of a unit, None where nobody knows; ``advice``: see ``advice.py``;
    ``seconds`` by stage, of this start and those before."""

    n_images: int
    n_registered: int
    n_points: int
    error: float
    observations: float
    cameras: list[str]
    n_masks: int
    without_pose: list[str]
    advice: list[str]
    seconds: dict[str, float]
    up_from: str = "as the cameras were held"
    scale: float | None = None

    def lines(self) -> list[str]:
        """Sentences for people."""
        lines = [
            f"{self.n_registered} of {self.n_images} images have a pose; {counted(self.n_points, 'point')}, "
            f"reprojection error {self.error:.2f} px, {self.observations:.0f} observations per image"
        ]
        lines += [f"camera: {camera}" for camera in self.cameras]
        unit = "arbitrary; --scale makes it a metre" if self.scale is None else "a metre"
        lines.append(f"up is -y, {self.up_from}; the unit is {unit}")
        if self.n_masks:
            lines.append(f"{counted(self.n_masks, 'mask')}; train with --masks and the folder masks/ here")
        if self.without_pose:
            named = ", ".join(self.without_pose[:MOST_NAMES])
            more = len(self.without_pose) - MOST_NAMES
            lines.append(f"without a pose: {named}" + (f" and {more} more" if more > 0 else ""))
        lines += [f"warning: {sentence}" for sentence in self.advice]
        stages = ", ".join(f"{name} {duration(seconds)}" for name, seconds in self.seconds.items())
        return [*lines, f"time: {stages}"]


def summary_of(
    model: Any, photographs: Sequence[Photograph], n_masks: int, placed: Placed, advice: Sequence[Advice],
    seconds: dict[str, float],
) -> Summary:  # fmt: skip
    """Of the model of pycolmap's that is the data set."""
    registered = _registered(model)
    return Summary(
        n_images=len(photographs),
        n_registered=len(registered),
        n_points=model.num_points3D(),
        error=float(model.compute_mean_reprojection_error()),
        observations=float(model.compute_mean_observations_per_reg_image()),
        cameras=list(dict.fromkeys(camera_line(camera) for _, camera in sorted(model.cameras.items()))),
        n_masks=n_masks,
        up_from=placed.up_from,
        scale=placed.world.scale,
        without_pose=[p.name for p in photographs if p.name not in registered],
        advice=[str(a) for a in advice],
        seconds=seconds,
    )


def outcome_of(models: Sequence[Any], photographs: Sequence[Photograph], feature_size: int) -> Outcome:
    """What advice is given on: of all ``models`` of pycolmap's, the first is kept. ``feature_size``: longest side of
    the images in which features were sought, where they are larger."""
    kept, *others = map(_registered, models)
    apart = tuple(n for n in (len(other - kept) for other in others) if n)
    shrunk = min(1.0, feature_size / max(max(p.width, p.height) for p in photographs))
    cameras = [camera for _, camera in sorted(models[0].cameras.items())]
    guessed = tuple(field_of_view(camera) for camera in cameras if not camera.has_prior_focal_length)
    error = float(models[0].compute_mean_reprojection_error())
    return Outcome(len(photographs), len(kept), apart, error * shrunk, guessed)


def _registered(model: Any) -> set[str]:
    """Names of the images that have a pose in a model."""
    return {image.name for image in model.images.values() if image.has_pose}


def camera_line(camera: Any) -> str:
    """``SIMPLE_RADIAL 4032x3024, focal length 3021 px (67° wide, 53° high), lens -0.012`` of one of pycolmap's."""
    focal, lens = camera.mean_focal_length(), [f"{camera.params[i]:.3g}" for i in camera.extra_params_idxs()]
    size = f"{camera.model_name} {camera.width}x{camera.height}"
    wide, high = (_field_of_view(camera, side) for side in (camera.width, camera.height))
    line = f"{size}, focal length {focal:.0f} px ({wide:.0f}° wide, {high:.0f}° high)"
    return line + (f", lens {' '.join(lens)}" if lens else "")


def field_of_view(camera: Any) -> float:
    """Along the longer side, in degrees, by the focal length alone."""
    return _field_of_view(camera, max(camera.width, camera.height))


def _field_of_view(camera: Any, side: int) -> float:
    half = side / 2 / camera.mean_focal_length()
    return math.degrees(2 * (half if "FISHEYE" in camera.model_name else math.atan(half)))
