"""A run that was stopped goes on from its checkpoint as if nothing had happened."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import run
from mi_dogsplat.errors import DataError
from mi_dogsplat.training.checkpoint import load_checkpoint, save_checkpoint
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.optimizer import SplatOptimizer
from tiny_data import write_tiny_data

STEPS = 60


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return write_tiny_data(tmp_path_factory.mktemp("data"))


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "3dgs", "steps": STEPS, "sh_degree": 1, "log_every": 10, "max_primitives": 100}
    return TrainConfig(str(data), **(base | changes))


def stop_after(step: int):
    def progress(row: dict) -> None:
        if row["step"] > step:
            raise KeyboardInterrupt

    return progress


def rows_of(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "history.jsonl").read_text().splitlines()]


def test_a_resumed_run_ends_where_an_uninterrupted_one_does(data, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "CHECKPOINT_SECONDS", 0.0)
    config = config_of(data)
    run.train(config, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run.train(config, tmp_path / "parts", stop_after(34))
    # a row that came after the checkpoint, and half a row: what a kill leaves
    with open(tmp_path / "parts" / "history.jsonl", "a") as history:
        history.write('{"step": 39, "seconds": 1, "n": 1, "n_dog": 0}\n{"step": 4')
    run.train(config, tmp_path / "parts", resume=True)

    whole, parts = rows_of(tmp_path / "whole"), rows_of(tmp_path / "parts")
    assert [row["step"] for row in parts] == [row["step"] for row in whole]
    # Sums of atomics depend on the order of threads: a gradient on the threshold may fall on the other side of it.
    np.testing.assert_allclose([row["n"] for row in parts], [row["n"] for row in whole], atol=1)
    l1 = [[row["l1"] for row in rows if "l1" in row] for rows in (whole, parts)]
    np.testing.assert_allclose(*l1, rtol=1e-3)
    seconds = [row["seconds"] for row in parts]
    assert seconds == sorted(seconds)


def test_resuming_needs_the_same_settings(data, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "CHECKPOINT_SECONDS", 0.0)
    run.train(config_of(data), tmp_path)
    with pytest.raises(DataError, match="seed was 0 and is 1 now"):
        run.train(config_of(data, seed=1), tmp_path, resume=True)


def test_resuming_without_a_checkpoint_says_so(data, tmp_path):
    with pytest.raises(DataError, match="there is no checkpoint"):
        run.train(config_of(data), tmp_path / "new", resume=True)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not a zip", b"\x00" * 200])
def test_a_damaged_checkpoint_says_so(tmp_path, content):
    (tmp_path / "state.npz").write_bytes(content)
    with pytest.raises(DataError, match="not a readable checkpoint"):
        load_checkpoint(tmp_path / "state.npz")


def test_a_truncated_checkpoint_says_so(tmp_path):
    path = tmp_path / "state.npz"
    save_checkpoint(path, {"a": np.arange(1000.0)})
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DataError, match="not a readable checkpoint"):
        load_checkpoint(path)


def test_a_checkpoint_of_another_kind_of_run_says_so(data, tmp_path):
    (tmp_path / "checkpoint").mkdir()
    (tmp_path / "config.json").write_text("{}")
    save_checkpoint(tmp_path / "checkpoint" / "state.npz", {"a": np.arange(3)})
    with pytest.raises(DataError, match="does not fit this run"):
        run.train(config_of(data), tmp_path, resume=True)


def test_primitives_that_can_never_be_seen_are_left_out_of_the_model(data, tmp_path, monkeypatch):
    original = SplatOptimizer.to_splats

    def with_ghosts(self):
        splats = original(self)
        splats.logit_opacities[:5] = -20
        return splats

    monkeypatch.setattr(SplatOptimizer, "to_splats", with_ghosts)
    metrics = run.train(config_of(data, steps=10), tmp_path)
    assert metrics["n"] == rows_of(tmp_path)[-1]["n"] - 5
