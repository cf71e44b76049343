"""What primitives leave of the memory for pairs, at every stage of a run: by what they have then."""

from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets import Dataset, View, load_dataset
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, DOG, PLANES, SHIFTS, SLOPES
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.memory_budget import MARGIN, PER_FLOAT, PER_PRIMITIVE, PER_PRODUCT
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


@pytest.mark.parametrize("n", [5400, 5600])  # below and above a size to which an array is rounded up
def test_on_a_gpu_no_array_is_larger_than_foreseen(n):
    backend = dr.backend_v(mi.Float)
    if backend == dr.JitBackend.LLVM:
        pytest.skip("on CPUs resident memory counts: tests/support/test_memory.py")
    rng, camera = np.random.default_rng(0), Camera(np.eye(4), 60.0, 60.0, 32.0, 24.0, 64, 48)
    points, colors = rng.uniform([-1, -0.8, 2], [1, 0.8, 4], (n, 3)).astype(np.float32), np.ones((n, 3), np.float32)
    view = View("view", camera, rng.random((48, 64, 3), np.float32))
    dr.flush_malloc_cache()
    dr.sync_thread()
    dr.detail.malloc_clear_statistics()
    before = dr.detail.malloc_watermark(backend)
    data = Dataset(Path("random"), [view], [], points, colors, False)
    trainer = Trainer(TrainConfig("random", "3dgs", memory="1G"), data)
    trainer.step_count = 4000  # from here on with all SH degrees
    for _ in range(3):
        trainer.step()
    memory = trainer.memory
    assert memory and memory.pairs
    foreseen = memory.fixed + n * memory.each(memory.pairs / n)
    assert 0.5 * foreseen < dr.detail.malloc_watermark(backend) - before < foreseen
