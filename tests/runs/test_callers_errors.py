"""What a function raises that the caller of a training gave: it is neither bad input nor a full disk."""

import pytest
from mi_dogsplat.runs import run
from mi_dogsplat.training.config import TrainConfig


@pytest.mark.parametrize("error", [ConnectionResetError, FloatingPointError])
@pytest.mark.parametrize("at", ["step", "l1", "measured"])  # as it begins, a row of the history, when it is done
def test_what_the_callers_function_raises_is_blamed_on_nothing_else(data, tmp_path, monkeypatch, error, at):
    monkeypatch.setattr(run, "finish", lambda *given: {})  # takes long

    def progress(row):
        if at in row:
            raise error("the caller's own")

    config = TrainConfig(str(data), preset="3dgs", steps=1, sh_degree=0, test_every=9)
    with pytest.raises(error, match="^the caller's own$"):
        run.train(config, tmp_path, progress)
    run.train(config, tmp_path, resume=True)
