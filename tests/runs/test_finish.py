"""The end of a run: metrics.json is its last file, by which others tell a run that is complete."""

import json
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets.world import World, read_world
from mi_dogsplat.report.run_folder import METRICS, MISFITS, MODEL, REFINED, REPORT, read_run
from mi_dogsplat.report.write import report_page
from mi_dogsplat.runs import finish as finish_module
from mi_dogsplat.runs.run import train
from mi_dogsplat.runs.stopping import Stopped
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.train import Trainer
from refined_poses import VIEWS, config_of


class Killed(BaseException):
    """Nothing catches it."""


@pytest.mark.parametrize("last", ["write_poses", "write_misfits", "write_report", "write_json"])
def test_a_run_that_is_killed_at_its_end_is_not_taken_for_complete_and_resumed(data, tmp_path, monkeypatch, last):
    def killed(*_):
        raise Killed

    config, out = config_of(data, steps=2), tmp_path / "run"
    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(finish_module, last, killed)
        train(config, out)
    assert not (out / METRICS).exists()
    metrics = train(config, out, resume=True)
    assert json.loads((out / METRICS).read_text()) == metrics
    assert all((out / name).exists() for name in (MISFITS, REPORT, Path(REFINED) / "transforms.json"))
    assert (out / REPORT).read_text() == report_page(read_run(out))  # it was there before the metrics


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_stops_a_run_while_it_is_measured_learns_that_its_training_is_saved(data, tmp_path, monkeypatch, number):
    with monkeypatch.context() as patch, pytest.raises(Stopped, match="--resume") as stopped:
        patch.setattr(finish_module, "write_misfits", lambda *_: signal.raise_signal(number))
        train(config_of(data, steps=2), tmp_path)
    assert stopped.value.signal_number == number and not (tmp_path / METRICS).exists()
    rows: list[dict] = []
    train(config_of(data, steps=2), tmp_path, rows.append, resume=True)
    assert [row["step"] for row in rows] == [2, 2] and "measured" in rows[-1]


def test_a_run_of_which_nothing_can_be_seen_writes_no_empty_model(data, tmp_path, monkeypatch):
    faded = replace(tiny_data.truth(), logit_opacities=np.full(tiny_data.N_TRUTH, -20.0))
    monkeypatch.setattr(Trainer, "model", lambda _: faded)
    with pytest.raises(DataError, match="the model in training: every primitive has faded.*; check that its images"):
        train(config_of(data, steps=2), tmp_path / "run")
    assert not any((tmp_path / "run" / name).exists() for name in (MODEL, METRICS))


def test_refined_poses_have_the_up_and_the_unit_of_the_run(data, tmp_path):
    """So that a training from them is upright and in metres, too."""
    train(config_of(data, steps=2, up="0.1,-0.9,0.4", unit=0.25), tmp_path)
    assert read_world(tmp_path / REFINED) == World(read_run(tmp_path).config["up"], 0.25) != World()


def test_poses_that_cannot_be_written_are_when_there_is_room(data, tmp_path, monkeypatch):
    def full(*_):
        raise OSError("no space left")

    with monkeypatch.context() as patch:
        patch.setattr(finish_module, "write_poses", full)
        with pytest.raises(DataError, match="no space left.*--resume goes on from the checkpoint"):
            train(config_of(data, steps=2), tmp_path)
    assert len(train(config_of(data, steps=2), tmp_path, resume=True)["poses"]) == VIEWS
    assert (tmp_path / REFINED / "transforms.json").is_file()
