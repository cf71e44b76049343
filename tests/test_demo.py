"""``make demo`` from end to end, at a fraction of its cost."""

import json
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.demo import PICTURE_SIZE, main


@pytest.mark.slow
def test_the_demo_ends_with_a_compact_model_beside_the_truth(tmp_path: Path, capsys):
    arguments = ["-o", str(tmp_path), "--steps", "300", "--target", "1500", "--views", "12", "--size", "96"]
    assert main(arguments) == 0
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["n"] <= 1500 and metrics["n_dog"] > 0 and metrics["test"]["psnr"] > 20
    picture = read_image(tmp_path / "demo.png")
    width, height = PICTURE_SIZE
    assert picture.shape == (height, 2 * width, 3)
    truth, model = picture[:, :width], picture[:, width:]
    assert truth.std() > 0.1 and np.abs(truth - model).mean() < 0.08
    assert np.abs(truth - model[:, ::-1]).mean() > 1.3 * np.abs(truth - model).mean()  # the same view, not turned
    assert "report.html" in capsys.readouterr().out
    assert main([*arguments, "--views", "13"]) == 2
    assert "views was 12 and is 13 now" in capsys.readouterr().err
