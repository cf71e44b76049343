"""Seeds of ten and more come after those of one digit, wherever a comparison sorts them or shows the first."""

import json

import pytest
from mi_dogsplat.compare.crops import crops
from mi_dogsplat.compare.folders import claim
from mi_dogsplat.compare.method_runs import recipe_of
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.names import seed_order
from mi_dogsplat.compare.overview import overview
from mi_dogsplat.compare.table import collect_all
from mi_dogsplat.compare.ways import ways
from mi_dogsplat.training.config import TrainConfig
from small_comparison import SETTINGS

METRICS = {
    "test": {"psnr": 30.0, "ssim": 0.9, "flip": 0.1},
    "train": {"l1": 0.01},
    "views": {"0": {"psnr": 30.0}},
    **{"n": 100, "n_dog": 0, "train_seconds": 1.0, "render_ms": 2.0, "peak_memory_mb": 3.0, "bytes": 4000},
}
ROW = {"step": 50, "seconds": 1.0, "l1": 0.1, "n": 100, "test_psnr": 30.0, "test_flip": 0.1}
SEEDS = ["0_copy", "10", "100", "2", "3"]  # as text they are in order


@pytest.fixture
def out(tmp_path):
    claim(tmp_path / "tiny", TrainConfig("", **SETTINGS))
    for seed in SEEDS:
        for name in ("3dgs", "ours", "ours@0.2"):
            run = tmp_path / "tiny" / f"seed_{seed}" / name
            run.mkdir(parents=True)
            (run / "metrics.json").write_text(json.dumps(METRICS))
            (run / "recipe.json").write_text(json.dumps(recipe_of(METHODS[name.partition("@")[0]])))
            (run / "history.jsonl").write_text(json.dumps(ROW) + "\n")
    return tmp_path


def test_seeds_are_sorted_as_numbers():
    assert sorted(SEEDS, key=seed_order) == ["2", "3", "10", "100", "0_copy"]


def test_the_table_has_its_seeds_in_order(out):
    of_data = collect_all(out, {})["methods"]["ours"]["data"]["tiny"]
    assert list(of_data["runs"]) == ["2", "3", "10", "100", "0_copy"]
    assert list(of_data["others"]["0.2"]["runs"]) == list(of_data["runs"])


def test_what_shows_one_seed_shows_the_first(out):
    rows = {name: {"label": name, "runs": dict.fromkeys(SEEDS, {})} for name in ("3dgs", "ours")}
    found = crops(out / "tiny", rows)
    assert found and found.seed == "2"
    for drawn in (ways(out / "tiny", rows), overview(out / "tiny", rows, {"3dgs": 1, "ours": 2}, "test")):
        assert drawn and drawn[0] == "2"
