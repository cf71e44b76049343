"""The small model by which masks are found before a training: it shows what the photographs have in common."""

from __future__ import annotations

from ..datasets import load_dataset
from ..training.config import TrainConfig
from .make import shrink_for

STEPS, PRIMITIVES = 3_500, 25_000  # which make a small model good enough, and are too few to learn what moved by heart
KEPT = (
    *("data", "split", "background", "antialiased", "near_clip", "near_zone", "masks", "white", "appearance"),
    *("data_on_disk", "initial_primitives", "seed", "variant", "memory", "up", "scale", "unit"),
)  # of the settings of the training that follows


def settings_of_first(config: TrainConfig) -> TrainConfig:
    """Settings of that model for a training with ``config``, on photographs as large as masks are looked for in.

    Raises ``DataError`` for data that cannot be read.
    """
    views = load_dataset(config.data, config.downscale, spp=1, on_disk=True, split=config.split).train
    return TrainConfig(
        **{name: getattr(config, name) for name in KEPT},
        steps=min(STEPS, config.steps),
        max_primitives=min(PRIMITIVES, config.max_primitives or PRIMITIVES),
        downscale=config.downscale * shrink_for(views),
    )
