"""Of a recipe: what its primitives get when the pruning is over, and how many of them there are then."""

from __future__ import annotations

from collections.abc import Sequence

from ..scene.row_groups import DOG, RowGroup
from .config import TrainConfig
from .memory_budget import Later
from .optimizer.preconditioning import n_products
from .presets import Recipe


def later_rows(config: TrainConfig, recipe: Recipe, held: Sequence[RowGroup], n: int) -> Later:
    """What primitives get when the pruning is over, beside rows ``held`` from the start by ``n`` primitives.

    How many are left by then is known of a ratio, and of a count where a model or a cap says of how many.
    """
    given = [group for group in ([DOG] if recipe.dog else []) + [*recipe.given_groups] if group not in held]
    left = 1.0
    if recipe.pruning:
        target = 0.0 if config.target_bytes else float(config.target)
        most = n if config.model else config.max_primitives
        left = target if target < 1 else min(1.0, target / most) if most else 0.0
    return Later(given, n_products([*held, *given]) if recipe.preconditioning else 0, left)
