"""Short trainings whose poses are refined."""

from pathlib import Path
from typing import Any

from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.strategy.pose_refinement import Poses
from mi_dogsplat.training.train import Trainer

VIEWS = 7  # of the tiny data, for training


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {
        "preset": "3dgs", "steps": 60, "sh_degree": 1, "max_primitives": 100, "log_every": 10, "refine_poses": True,
    }  # fmt: skip
    return TrainConfig(str(data), **(base | changes))


def poses_of(trainer: Trainer) -> Poses:
    return trainer.states["poserefinement"]


def stepped(trainer: Trainer, steps: int) -> Trainer:
    for _ in range(steps):
        trainer.step()
    return trainer
