"""All settings of a training run; the comment of a field is the help text of its flag."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import DataError

REFERENCE_STEPS = 30_000  # the schedule that the milestones below are written for
CHOICES = {"preset": ("3dgs",), "background": ("black", "white", "auto")}
RANGES = {
    "steps": (1, math.inf),
    "downscale": (1, math.inf),
    "max_primitives": (1, math.inf),
    "max_world_scale": (1e-9, math.inf),
    "sh_degree": (0, 3),
    "near_clip": (0, 1e30),
    "initial_primitives": (1, math.inf),
    "seed": (0, math.inf),
    "log_every": (1, math.inf),
    "test_every": (0, math.inf),
}


@dataclass(frozen=True)
class TrainConfig:
    """A run is reproducible from this, the data and the versions in ``metrics.json``.

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    data: str  # data set: COLMAP folder, transforms*.json folder, or Mitsuba scene XML
    preset: str = "3dgs"  # recipe: 3dgs (the published baseline)
    steps: int = REFERENCE_STEPS  # training steps; every milestone of the 30,000-step schedule scales along
    downscale: int = 1  # shrink the images by this whole factor, once, at load
    max_primitives: int | None = None  # never hold more primitives than this
    max_world_scale: float = 0.1  # remove larger primitives, times the camera extent; inf helps forward-facing captures
    sh_degree: int = 3  # highest degree of view-dependent colour, 0 to 3
    background: str = "auto"  # black, white, or auto: white for images with alpha, else black
    antialiased: bool = False  # compensate opacities for the screen-space low-pass filter
    near_clip: float = 0.2  # primitives nearer to the camera plane are dropped, world units
    initial_primitives: int = 20_000  # random start when the data has no points
    seed: int = 0  # seed of every random choice
    variant: str = "auto"  # Mitsuba variant; auto takes cuda_ad_rgb where there is a GPU, else llvm_ad_rgb
    log_every: int = 50  # steps between rows of history.jsonl
    test_every: int = 0  # steps between quick PSNR measurements on the test views; 0: eight times a run

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                _refuse(name, f'"{getattr(self, name)}" is unknown', "use " + " or ".join(choices))
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if value is None and name == "max_primitives":
                continue
            if not low <= value <= high:  # NaN is in no range
                wanted = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
                _refuse(name, f"{value} is out of range", f"use {wanted}")

    def milestone(self, step: int) -> int:
        """A step of the 30,000-step schedule, scaled to this run; at least 1."""
        return max(1, round(step * self.steps / REFERENCE_STEPS))


def _refuse(name: str, problem: str, remedy: str) -> None:
    raise DataError("--" + name.replace("_", "-"), problem, remedy)
