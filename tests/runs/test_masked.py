"""A run says how much its masks hide, and shows it."""

import json

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.render.mask_sheet import CELL, TINT
from mi_dogsplat.runs.run import train
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.config import TrainConfig
from PIL import Image


def test_the_masked_share_of_each_training_view_is_told_and_the_most_masked_is_shown_first(tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data")
    (tmp_path / "masks").mkdir()
    for name, share in (("1", 0.25), ("5", 0.5), ("0", 1.0)):  # the last is a test view
        mask = np.ones((40, 80))
        mask[:, : round(80 * share)] = 0
        write_png(tmp_path / "masks" / f"{name}.png", mask)
    out = tmp_path / "run"
    config = TrainConfig(str(data), steps=2, preset="3dgs", max_primitives=100, masks=str(tmp_path / "masks"))
    train(config, out)
    masked = json.loads((out / "metrics.json").read_text())["masked"]
    assert masked == pytest.approx({name: {"1": 0.25, "5": 0.5}.get(name, 0.0) for name in "1234567"}, abs=0.02)
    with Image.open(out / "masked.png") as image:
        sheet = np.asarray(image) / 255.0
    red = [(sheet[20:160, k * CELL : (k + 1) * CELL] @ (1, -0.5, -0.5) > TINT[0] / 4).mean() for k in range(2)]
    assert sheet.shape[1] == 2 * CELL and red == pytest.approx([0.5, 0.25], abs=0.05)
    assert "What the masks hide" in (out / "report.html").read_text()


def test_a_run_without_masks_says_nothing_of_them(tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data")
    metrics = train(TrainConfig(str(data), steps=2, preset="3dgs", max_primitives=100), tmp_path / "run")
    assert "masked" not in metrics and not (tmp_path / "run" / "masked.png").exists()
