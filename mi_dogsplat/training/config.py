"""All settings of a training run; the comment of a field is the help text of its flag."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ..support.errors import DataError
from ..support.memory import bytes_of
from .presets import RECIPES

FROM_RECIPE: Any = None  # a default that the preset decides on when the configuration is made
CHOICES = {"preset": tuple(RECIPES), "background": ("black", "white", "auto", "random")}
RANGES = {
    "steps": (1, math.inf),
    "downscale": (1, math.inf),
    "max_primitives": (1, math.inf),
    "max_world_scale": (1e-9, math.inf),
    "sh_degree": (0, 3),
    "near_clip": (0, 1e30),
    "near_zone": (0, 1e30),
    "initial_primitives": (1, math.inf),
    "seed": (0, math.inf),
    "log_every": (1, math.inf),
    "test_every": (0, math.inf),
    "checkpoint_seconds": (0, math.inf),
}
FREE = ("checkpoint_seconds", "memory")  # may change from one start of a run to the next, as no result depends on them


@dataclass(frozen=True)
class TrainConfig:
    """A run is reproducible from this, the data and the versions in ``metrics.json``.

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    data: str  # data set: COLMAP folder, transforms*.json folder, or Mitsuba scene XML
    preset: str = "ours"  # recipe: ours; paper or released (the method as printed, as in its code); 3dgs (baseline)
    steps: int = FROM_RECIPE  # training steps; the whole schedule scales along (default: the preset's)
    target: float = 0.1  # primitives left after pruning: below 1 a ratio, else a count
    downscale: int = 1  # shrink the images by this whole factor, once, at load
    max_primitives: int | None = None  # never hold more primitives than this
    max_world_scale: float = FROM_RECIPE  # remove larger primitives, times the camera extent (default: the preset's)
    sh_degree: int = 3  # highest degree of view-dependent colour, 0 to 3
    background: str = "auto"  # black, white, auto: white for images with alpha, else black; random: another each step
    antialiased: bool = False  # compensate opacities for the screen-space low-pass filter
    near_clip: float = 0.2  # primitives nearer to the camera plane are dropped, world units
    near_zone: float = 0.0  # remove primitives nearer than this to a training camera, world units; 0: none
    masks: str | None = None  # folder of masks, named as the images: black pixels do not count
    exposure: bool = False  # learn a colour transform per training image (no test view gets one)
    data_on_disk: bool = False  # decode images when they are due, a few ahead, instead of holding all of them
    initial_primitives: int = 20_000  # random start when the data has no points
    seed: int = 0  # seed of every random choice
    variant: str = "auto"  # Mitsuba variant; auto takes cuda_ad_rgb where there is a GPU, else llvm_ad_rgb
    log_every: int = 50  # steps between rows of history.jsonl
    test_every: int = 0  # steps between measurements of PSNR and FLIP on the test views; 0: eight times a run
    memory: str | None = None  # train within this, as 8G (default: what is free on the CPU; no limit on a GPU)
    checkpoint_seconds: float = 60.0  # time between checkpoints; longer where they would take a fiftieth of the time
    model: str | None = None  # start from this model .ply, of whatever SH degree, at the pruning of the recipe

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                _refuse(name, f'"{getattr(self, name)}" is unknown', "use " + " or ".join(choices))
        self._fill_from_recipe()
        if self.memory is not None:
            try:
                bytes_of(self.memory)
            except ValueError as error:
                _refuse("memory", str(error), "use a number with K, M, G or T, as 8G")
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if value is None and name == "max_primitives":
                continue
            if not low <= value <= high:  # NaN is in no range
                wanted = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
                _refuse(name, f"{value} is out of range", f"use {wanted}")
        if not (0 < self.target < 1 or (self.target >= 1 and float(self.target).is_integer())):
            _refuse("target", f"{self.target:g} is no target", "use a ratio below 1 or a whole number of primitives")
        if self.max_primitives is not None and self.target >= self.max_primitives:
            problem = f"{self.target:g} primitives are not fewer than --max-primitives {self.max_primitives}"
            _refuse("target", problem, "use a smaller target or a larger cap")

    def _fill_from_recipe(self) -> None:
        recipe = RECIPES[self.preset]
        if self.model is not None:
            if not recipe.pruning:
                pruning = " or ".join(name for name in RECIPES if RECIPES[name].pruning)
                _refuse("preset", f'"{self.preset}" does not prune', f"use {pruning}")
            recipe = recipe.from_pruning()
        if self.steps is None:
            object.__setattr__(self, "steps", recipe.reference_steps)
        if self.max_world_scale is None:
            object.__setattr__(self, "max_world_scale", recipe.densification.max_world_scale)


def _refuse(name: str, problem: str, remedy: str) -> None:
    raise DataError("--" + name.replace("_", "-"), problem, remedy)
