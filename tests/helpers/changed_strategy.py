"""Another rule of densification for a trainer that is there already."""

from dataclasses import replace
from typing import Any

from mi_dogsplat.training.strategy.densify import Densification
from mi_dogsplat.training.train import Trainer


def change_densification(trainer: Trainer, **numbers: Any) -> None:
    """Put other numbers into it; what it remembers stays."""
    trainer.strategies = [replace(s, **numbers) if isinstance(s, Densification) else s for s in trainer.strategies]
