"""A run and a comparison measured on validation views say so, and never see a test view."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command_line import assert_one_line
from command_line import run as dogsplat
from html_pages import parsed, words
from mi_dogsplat.compare.compare import compare
from mi_dogsplat.compare.folders import claim
from mi_dogsplat.runs.run import train
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from small_comparison import without_processes
from tiny_data import write_tiny_data

SETTINGS: dict[str, Any] = {"steps": 30, "sh_degree": 1, "log_every": 10, "max_primitives": 100, "target": 0.5}


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """Eight views, of which the test view is no picture."""
    folder = write_tiny_data(tmp_path_factory.mktemp("data"))
    (folder / "images" / "0.png").write_bytes(b"no picture")
    return folder


def test_a_run_measures_validation_views_and_says_so(data, tmp_path):
    metrics = train(TrainConfig(str(data), preset="3dgs", split="validation", **SETTINGS), tmp_path)
    assert list(metrics["views"]) == ["1"] and metrics["test"]["psnr"] == metrics["views"]["1"]["psnr"]
    assert json.loads((tmp_path / "config.json").read_text())["split"] == "validation"
    text = words(parsed((tmp_path / "report.html").read_text()))
    assert "Validation PSNR" in text and "Validation views" in text
    assert "Test PSNR" not in text and "Test views" not in text


def test_a_comparison_measures_validation_views_and_says_so(data, tmp_path):
    config = TrainConfig("", split="validation", **SETTINGS)
    with without_processes():
        table = compare(config, [str(data)], tmp_path / "out", [0], ["3dgs"])
    assert table["failed"] == {} and table["config"][data.name]["split"] == "validation"
    metrics = json.loads((tmp_path / "out" / data.name / "seed_0" / "3dgs" / "metrics.json").read_text())
    assert list(metrics["views"]) == ["1"]
    text = words(parsed((tmp_path / "out" / "comparison.html").read_text()))
    assert "Measured on validation views" in text and "validation PSNR" in text and "est PSNR" not in text


def test_a_comparison_from_before_there_was_a_split_goes_on(tmp_path):
    config = TrainConfig("data", **SETTINGS)
    claim(tmp_path, config)
    path = tmp_path / "config.json"
    path.write_text(json.dumps({k: v for k, v in json.loads(path.read_text()).items() if k != "split"}))
    with pytest.raises(DataError, match="other settings: split was test and is validation now"):
        claim(tmp_path, replace(config, split="validation"))
    claim(tmp_path, config)
    assert json.loads(path.read_text())["split"] == "test"


def test_a_split_that_there_is_not_is_one_line(data, tmp_path, capsys):
    result = dogsplat(capsys, "train", data, "-o", tmp_path / "run", "--split", "training")
    assert_one_line(result, "--split", "training", "use test or validation")
