"""What is due after the last step happens once, and is in the history once, however often a run is resumed."""

from collections.abc import Callable

import numpy as np
import pytest
from happenings import history_of, records
from mi_dogsplat.runs import run
from mi_dogsplat.runs.checkpoint import Checkpoints, save_checkpoint
from mi_dogsplat.training.config import TrainConfig


def save_before_the_end(checkpoints: Checkpoints, state: Callable[[], dict[str, np.ndarray]]) -> None:
    """As if the run were killed with what follows the last step in its history, and not in its checkpoint."""
    if state()["ended"]:
        raise KeyboardInterrupt
    save_checkpoint(checkpoints.path, state())


@pytest.mark.parametrize("killed", [False, True])
def test_a_run_that_is_resumed_at_its_end_has_its_last_event_once(data, tmp_path, monkeypatch, killed):
    monkeypatch.setattr(run, "finish", lambda *given: {})  # takes long
    config = TrainConfig(str(data), preset="3dgs", steps=1, sh_degree=0, test_every=9, refine_poses=True)
    if killed:
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(Checkpoints, "save", save_before_the_end)
            run.train(config, tmp_path)
    for resume in (killed, True, True):
        run.train(config, tmp_path, resume=resume)
        assert len(records(history_of(tmp_path), "poses_refined")) == 1
