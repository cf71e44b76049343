"""What is frozen in training is recorded for a kind of step, not for a step."""

import pytest
from frozen_functions import forget, n_recordings
from launches import KernelWatch
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer

WARM_UP, STEPS = 6, 24
BY_CHANCE = 2  # where two arrays happen to be of one size, Dr.Jit takes that for another kind


@pytest.mark.parametrize("preset", ["3dgs", "ours_preconditioned"])
def test_another_view_with_another_number_of_isects_is_no_other_recording(data, preset):
    """Each would take longer than the kernels of a small model, and stay for the rest of the run."""
    forget()
    config = TrainConfig(str(data), preset=preset, steps=3000, sh_degree=1, max_primitives=100, target=50)
    trainer, isects = Trainer(config, load_dataset(data)), set()
    trainer.step_count = 2990 - STEPS - WARM_UP  # nothing changes in these steps
    with KernelWatch():
        for step in range(WARM_UP + STEPS):
            if step == WARM_UP:
                before = n_recordings()
            trainer.step()
            _, frame = trainer.render(trainer.optimizer.params, step % len(trainer.photographs))
            assert frame.view
            isects.add(frame.view.n_isects)
    assert len(isects) > 5 * BY_CHANCE and 3 < before <= n_recordings() <= before + BY_CHANCE
