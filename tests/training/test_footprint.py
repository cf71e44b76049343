"""What primitives leave of the memory for pairs, at every stage of a run: by what they have then."""

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, DOG, PLANES, SHIFTS, SLOPES
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.footprint import MARGIN, PER_FLOAT, PER_PRIMITIVE, PER_PRODUCT
from mi_dogsplat.training.strategy.row_activation import give_rows
from mi_dogsplat.training.train import Trainer

PLAIN = 14 + 12  # floats of a primitive at SH degree 1


@pytest.mark.parametrize("target", [0.05, 0.5, 0.99])
@pytest.mark.parametrize(
    ("preset", "groups", "floats", "joint"),
    [
        ("ours_preconditioned", (DOG, SLOPES, CUTS), 16, 21),
        ("ours_second_cuts", (DOG, SLOPES, *PLANES), 19, 24),
        ("ours_curvatures", (DOG, SLOPES, CURVATURES, *PLANES), 25, 24),
        ("ours_shifts", (DOG, SLOPES, CURVATURES, *PLANES, SHIFTS), 37, 24),
    ],
)
def test_pairs_get_what_the_primitives_there_are_leave_whatever_the_target(
    data, target, preset, groups, floats, joint
):
    """By hand, at the four stages of a run: at its start, pruned, with all rows, with the products of joint steps."""
    config = TrainConfig(str(data), preset=preset, steps=40, target=target, sh_degree=1, memory="1G")
    trainer = Trainer(config, load_dataset(data))
    memory, optimizer = trainer.memory, trainer.optimizer
    assert memory

    def require(floats: int, products: int = 0) -> None:
        held = optimizer.n * (PER_FLOAT * floats + PER_PRIMITIVE + PER_PRODUCT * products)
        assert trainer.options.isect_memory == pytest.approx(MARGIN * memory.total - memory.fixed - held, abs=1)

    require(PLAIN)
    optimizer.keep(np.arange(round(target * tiny_data.N_TRUTH)))
    require(PLAIN)
    for group in groups:
        give_rows(optimizer, group)
    require(PLAIN + floats)
    trainer.step_count = 39  # beyond the start of preconditioned steps
    trainer.step()
    require(PLAIN + floats, joint * (joint + 1) // 2)
    optimizer.keep(np.arange(2))
    require(PLAIN + floats, joint * (joint + 1) // 2)
