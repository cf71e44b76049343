"""``dogsplat train --mask-moved``: a small model, masks by it, and the training with them, as one command."""

import json
import shutil
import signal

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.masking.first_model import PRIMITIVES, STEPS, settings_of_first
from mi_dogsplat.runs.checkpoint import CHECKPOINT
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.config import TrainConfig
from PIL import Image

N, PLACE = 12, (slice(8, 24), slice(12, 30))
FLAGS = ["--preset", "3dgs", "--steps", 100, "--sh-degree", 1, "--max-primitives", 200, "--log-every", 40]
FLAGS += ["--variant", "llvm_ad_rgb"]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Photographs of a model, with something yellow in the fifth."""
    folder = tiny_data.write_tiny_data(tmp_path_factory.mktemp("moved") / "data", N)
    pixels = read_image(folder / "images" / "4.png").copy()
    pixels[PLACE] = (0.9, 0.8, 0.1)
    write_png(folder / "images" / "4.png", pixels)
    return folder


def masked_in(path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image) < 128


@pytest.mark.parametrize("flags", [["--white", 2], ["--near-zone", 1e9], ["--memory", "150M"], ["--batch-views", 0]])
@pytest.mark.parametrize("search", [[], ["--mask-moved"]])
def test_what_a_training_refuses_leaves_no_folder_and_is_told_before_a_small_model_is_trained(
    capsys, data, tmp_path, flags, search
):
    assert_one_line(run(capsys, "train", data, "-o", tmp_path / "run", *FLAGS, *search, *flags), flags[0])
    assert not (tmp_path / "run").exists()


def test_what_only_the_large_training_refuses_is_told_before_a_small_model_is_trained(capsys, data, tmp_path):
    out = tmp_path / "stopped"
    (out / "checkpoint").mkdir(parents=True)
    for file in ("config.json", CHECKPOINT):
        (out / file).write_text("{}")
    assert_one_line(run(capsys, "train", data, "-o", out, *FLAGS, "--mask-moved"), f"{out}: holds a training that was")
    assert sorted(path.name for path in out.iterdir()) == ["checkpoint", "config.json"]

    large = ["--max-primitives", 10**9, "--initial-primitives", 10**5, "--memory", "450M"]
    (bare := tmp_path / "bare").mkdir()
    content = json.loads((data / "transforms.json").read_text())
    content.pop("ply_file_path")
    (bare / "transforms.json").write_text(json.dumps(content))
    shutil.copytree(data / "images", bare / "images")
    out = tmp_path / "large"
    assert_one_line(run(capsys, "train", bare, "-o", out, *FLAGS, *large, "--mask-moved"), "100,000 primitives needs")
    assert not out.exists()


def test_one_command_masks_what_moved_and_trains(capsys, data, tmp_path):
    out = tmp_path / "run"
    status, said, _ = run(capsys, "train", data, "-o", out, *FLAGS, "--mask-moved")
    assert status == 0
    assert masked_in(out / "masks" / "4.png")[PLACE].mean() > 0.6  # by a model of a hundred steps
    config = json.loads((out / "config.json").read_text())
    assert config["masks"] == str(out / "masks") and config["steps"] == 100 and config["preset"] == "3dgs"
    assert json.loads((out / "first" / "config.json").read_text())["masks"] is None
    assert (out / "masked.png").is_file() and (out / "point_cloud.ply").is_file()
    assert f"small model in {out / 'first'}" in said and f"{out / 'masks'}: " in said

    made = (out / "masks" / "4.png").stat().st_mtime_ns, (out / "first" / "metrics.json").stat().st_mtime_ns
    assert run(capsys, "train", data, "-o", out, *FLAGS, "--mask-moved", "--resume")[0] == 0
    again = (out / "masks" / "4.png").stat().st_mtime_ns, (out / "first" / "metrics.json").stat().st_mtime_ns
    assert again == made

    other = tiny_data.write_tiny_data(tmp_path / "other")
    status, _, error = run(capsys, "train", other, "-o", out, *FLAGS, "--mask-moved")
    assert status == 2 and f"{out / 'masks'}: exists, and is not an empty folder" in error
    assert run(capsys, "train", data, "-o", out, *FLAGS, "--masks", out / "masks")[0] == 0  # as they are, or repainted
    shutil.rmtree(out / "masks")
    assert run(capsys, "train", other, "-o", out, *FLAGS, "--mask-moved")[0] == 0
    assert len(list((out / "masks").iterdir())) == 8  # those of the other photographs, and none of before


@pytest.mark.parametrize("stage", ["first", "masks"])
def test_what_was_stopped_goes_on(capsys, data, tmp_path, monkeypatch, stage):
    out, calls = tmp_path / "run", []
    with monkeypatch.context() as patched:
        if stage == "first":
            from mi_dogsplat.training.train import Trainer

            def step(trainer, *arguments, own=Trainer.step, **named):
                calls.append(1)
                if len(calls) == 50:
                    signal.raise_signal(signal.SIGINT)
                return own(trainer, *arguments, **named)

            patched.setattr(Trainer, "step", step)
        else:
            patched.setattr("mi_dogsplat.masking.make.on_photograph", lambda *_: signal.raise_signal(signal.SIGINT))
        status, _, error = run(capsys, "train", data, "-o", out, *FLAGS, "--mask-moved")
    assert status == 130 and not (out / "masks").exists() and not (out / "config.json").exists()
    status, said, _ = run(capsys, "train", data, "-o", out, *FLAGS, "--mask-moved", "--resume")
    assert status == 0 and (out / "masks").is_dir() and (out / "point_cloud.ply").is_file()
    assert ("first training a small model" in said) == (stage == "first")


def test_masks_of_somebody_else_are_not_replaced(capsys, data, tmp_path):
    out = tmp_path / "run"
    assert run(capsys, "train", data, "-o", out, *FLAGS)[0] == 0
    (out / "masks").mkdir()
    (out / "masks" / "mine.png").write_text("painted for hours")
    status, said, error = run(capsys, "train", data, "-o", out, *FLAGS, "--mask-moved")
    assert "training a small model" not in said  # it is told before the work
    assert status == 2 and f"{out / 'masks'}: exists, and is not an empty folder" in error
    assert (out / "masks" / "mine.png").read_text() == "painted for hours"


def test_the_small_model_is_of_small_photographs_and_keeps_what_is_said_of_the_data(tmp_path):
    tiny_data.write_tiny_data(tmp_path)
    content = json.loads((tmp_path / "transforms.json").read_text())
    for frame in content["frames"]:
        path = tmp_path / frame["file_path"]
        with Image.open(path) as image:
            image.resize((1_600, 1_200)).save(path)
    scale = 1_600 / tiny_data.WIDTH
    content |= {"w": 1_600, "h": 1_200, "fl_x": scale * content["fl_x"], "fl_y": scale * content["fl_y"]}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    config = TrainConfig(
        str(tmp_path), preset="3dgs", downscale=2, seed=3, split="validation", appearance=True, near_clip=0.1,
        max_primitives=10**6, refine_poses=True,
    )  # fmt: skip
    small = settings_of_first(config)
    assert (small.steps, small.max_primitives, small.downscale, small.preset) == (STEPS, PRIMITIVES, 4, "ours")
    assert (small.seed, small.split, small.appearance, small.near_clip) == (3, "validation", True, 0.1)
    assert not small.refine_poses
    short = settings_of_first(TrainConfig(str(tmp_path), steps=100, max_primitives=50, downscale=8))
    assert (short.steps, short.max_primitives, short.downscale) == (100, 50, 8)
