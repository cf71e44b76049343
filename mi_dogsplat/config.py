"""All settings of a training run; the comment of a field is the help text of its flag."""

from __future__ import annotations

from dataclasses import dataclass

REFERENCE_STEPS = 30_000  # the schedule that the milestones below are written for


@dataclass(frozen=True)
class TrainConfig:
    """A run is reproducible from this, the data and the versions in ``metrics.json``."""

    data: str  # data set: COLMAP folder, transforms*.json folder, or Mitsuba scene XML
    preset: str = "3dgs"  # recipe: 3dgs (the published baseline)
    steps: int = REFERENCE_STEPS  # training steps; every milestone of the 30,000-step schedule scales along
    downscale: int = 1  # shrink the images by this whole factor, once, at load
    max_primitives: int | None = None  # never hold more primitives than this
    sh_degree: int = 3  # highest degree of view-dependent colour, 0 to 3
    background: str = "auto"  # black, white, or auto: white for images with alpha, else black
    antialiased: bool = False  # compensate opacities for the screen-space low-pass filter
    near_clip: float = 0.2  # primitives nearer to the camera plane are dropped, world units
    initial_primitives: int = 20_000  # random start when the data has no points
    seed: int = 0  # seed of every random choice
    variant: str = "auto"  # Mitsuba variant; auto takes cuda_ad_rgb where there is a GPU, else llvm_ad_rgb
    log_every: int = 50  # steps between rows of history.jsonl
    test_every: int = 0  # steps between quick PSNR measurements on the test views; 0: one in ten of the run

    def milestone(self, step: int) -> int:
        """A step of the 30,000-step schedule, scaled to this run; at least 1."""
        return max(1, round(step * self.steps / REFERENCE_STEPS))
