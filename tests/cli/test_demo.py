"""``make demo`` from end to end, at a fraction of its cost."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.demo import side_by_side, tour
from mi_dogsplat.demo.__main__ import main
from mi_dogsplat.support.errors import DataError


@pytest.mark.slow
def test_the_demo_ends_with_a_compact_model_beside_the_truth(tmp_path: Path, capsys, monkeypatch):
    spp, (width, height) = 16, (320, 240)
    monkeypatch.setattr(tour, "CaptureConfig", lambda **settings: replace(CaptureConfig(**settings), spp=spp))
    monkeypatch.setattr(side_by_side, "PICTURE_SIZE", (width, height))
    monkeypatch.setattr(side_by_side, "PICTURE_SPP", spp)
    arguments = ["-o", str(tmp_path), "--steps", "150", "--target", "1500", "--views", "12", "--size", "96"]
    assert main(arguments) == 0
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["n"] <= 1500 and metrics["n_dog"] > 0 and metrics["test"]["psnr"] > 20
    picture = read_image(tmp_path / "demo.png")
    assert picture.shape[0] > height and picture.shape[1:] == (2 * width, 3)
    labels, picture = picture[height:], picture[:height]
    assert labels[:, :width].min() < 0.2 and labels[:, width:].min() < 0.2  # both halves say what they are
    truth, model = picture[:, :width], picture[:, width:]
    error, if_empty, if_turned = (np.abs(truth - other).mean() for other in (model, 1.0, model[:, ::-1]))
    assert error < 0.5 * if_empty and error < 0.7 * if_turned  # the same view of something like it
    assert "report.html" in capsys.readouterr().out
    assert main([*arguments, "--views", "13"]) == 2
    assert "views was 12 and is 13 now" in capsys.readouterr().err


def test_the_bar_of_the_training_has_ended_before_the_model_is_measured(tmp_path: Path, capsys, monkeypatch):
    told, goes_on = [], []

    def train(config, out, progress, resume):
        goes_on.append(resume)
        progress({"step": 300, "n": 7, "l1": 0.1})
        progress({"step": 300, "n": 7, "measured": 1})
        told.extend(capsys.readouterr())
        raise DataError(out, "is not measured here", "end")

    monkeypatch.setattr(tour, "capture", lambda *_: None)
    monkeypatch.setattr(tour, "train", train)
    assert main(["-o", str(tmp_path), "--steps", "300", "--variant", "llvm_ad_rgb"]) == 2
    assert told[0].splitlines()[-1] == "all steps are done; measuring 1 test view and writing the report"
    assert "300/300" in told[1] and "300/300" not in capsys.readouterr().err
    (tmp_path / "run" / "checkpoint").mkdir(parents=True)
    (tmp_path / "run" / "checkpoint" / "state.npz").touch()
    assert main(["-o", str(tmp_path), "--variant", "llvm_ad_rgb"]) == 2
    assert goes_on == [False, True]  # what was stopped is not begun anew


@pytest.mark.parametrize("flag", ["--steps", "--target"])
def test_numbers_that_cannot_be_trained_with_show_before_anything_is_traced(flag, tmp_path: Path, capsys, monkeypatch):
    monkeypatch.setattr(tour, "capture", lambda *_: pytest.fail("too late"))
    assert main(["-o", str(tmp_path), flag, "0", "--variant", "llvm_ad_rgb"]) == 2
    assert capsys.readouterr().err.startswith("demo: --")


def test_the_scene_is_found_in_a_wheel_and_in_a_checkout_and_missed_in_one_line(tmp_path: Path, monkeypatch):
    assert tour.scene_file() == tour.CHECKED_OUT / "demo_truth.xml"
    monkeypatch.setattr(tour, "PACKAGED", tmp_path)
    (tmp_path / "demo_truth.xml").touch()
    assert tour.scene_file() == tmp_path / "demo_truth.xml"
    monkeypatch.setattr(tour, "PACKAGED", tmp_path / "no")
    monkeypatch.setattr(tour, "CHECKED_OUT", tmp_path / "no")
    with pytest.raises(DataError, match="demo_truth.xml: no such file; install mi_dogsplat again"):
        tour.scene_file()


def test_a_variant_that_cannot_be_had_is_one_line(capsys, tmp_path: Path):
    assert main(["-o", str(tmp_path / "out"), "--variant", "vulkan"]) == 2
    assert capsys.readouterr().err.startswith('demo: --variant: "vulkan" cannot be used')
    assert not any(tmp_path.iterdir())
