"""Folders of comparisons with files that a broken disk or an editor has damaged: one line that names the file."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from mi_dogsplat.compare.compare import compare
from mi_dogsplat.compare.crops import crops
from mi_dogsplat.compare.execute import Outcome
from mi_dogsplat.compare.folders import claim
from mi_dogsplat.compare.method_runs import is_complete, recipe_of
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.table import cells, collect_all, columns
from mi_dogsplat.compare.tasks import Task, perform
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from small_comparison import SETTINGS

METRICS = {
    "test": {"psnr": 30.0, "ssim": 0.9, "flip": 0.1},
    "train": {"l1": 0.01},
    "views": {"0": {"psnr": 30.0}},
    **{"n": 100, "n_dog": 0, "train_seconds": 1.0, "render_ms": 2.0, "peak_memory_mb": 3.0, "bytes": 4000},
}
VIEW = SimpleNamespace(name="0")
HALF = '{"psnr": 3'


@pytest.fixture
def out(tmp_path) -> Path:
    """A comparison of two methods on one data set, without pictures."""
    claim(tmp_path / "tiny", TrainConfig("", **SETTINGS))
    for name in ("3dgs", "ours"):
        files = {"metrics.json": METRICS, "recipe.json": recipe_of(METHODS[name])}
        files |= {"render_ms.json": {"render_ms": 2.5}, "lpips.json": {"lpips": 0.2}}
        run = tmp_path / "tiny" / "seed_0" / name
        run.mkdir(parents=True)
        for file, content in files.items():
            (run / file).write_text(json.dumps(content))
    return tmp_path


def test_whole_files_are_read(out):
    assert collect_all(out, {})["methods"]["ours"]["data"]["tiny"]["runs"]["0"]["lpips"] == 0.2
    assert is_complete(out / "tiny/seed_0/ours", METHODS["ours"])


def test_a_run_at_another_target_ends_where_the_method_has_no_run_at_that_of_the_comparison(out, monkeypatch):
    """As where that has failed, or is still busy on another worker."""
    (out / "comparison.json").write_text("{}")
    (out / "tiny" / "seed_0" / "ours").rename(out / "tiny" / "seed_0" / "ours@0.1")
    told = []
    outcome = Outcome(Task("train", str(out / "tiny"), 0, ("ours@0.1",)), None)
    outcomes = (one for one in [outcome])  # which can be closed
    monkeypatch.setattr("mi_dogsplat.compare.compare.one_after_another", lambda *_: outcomes)
    monkeypatch.setattr("mi_dogsplat.compare.compare.claim", lambda *_: None)
    monkeypatch.setattr("mi_dogsplat.compare.compare.load_dataset", lambda *_, **__: Mock(train=[], test=[VIEW]))
    compare(TrainConfig("", **SETTINGS), [str(out / "tiny")], out, [0], ("ours",), targets=(0.1,), progress=told.append)
    assert told == ["1/3 tiny, seed 0: ours@0.1: 30.00 dB, 100 primitives, 1 s"]


def test_a_number_that_one_seed_of_two_has_measured_has_no_spread(out):
    """As LPIPS where a comparison was cut off before those of the second seed."""
    shutil.copytree(out / "tiny" / "seed_0", out / "tiny" / "seed_1")
    (out / "tiny" / "seed_1" / "ours" / "lpips.json").unlink()
    found = collect_all(out, {})
    at = columns(found, "tiny").index("lpips"), columns(found, "tiny").index("psnr")
    shown = [[cells(found, "tiny", name)[column][0] for column in at] for name in ("3dgs", "ours")]
    assert shown == [["0.200 ± 0.000", "30.00 ± 0.00"], ["0.200", "30.00 ± 0.00"]]


@pytest.mark.parametrize("change", [{"revision": 7}, {"recipe": {"sh_every": 7}}, None], ids=str)
def test_a_run_of_what_a_method_was_before_is_not_told_as_one_of_it(out, change):
    run = out / "tiny" / "seed_0" / "ours"
    at_target = out / "tiny" / "seed_0" / "3dgs@0.1"
    at_target.mkdir()
    for name in ("metrics.json", "render_ms.json"):
        (at_target / name).write_text((run / name).read_text())
    recipe = run / "recipe.json"
    if change is None:
        recipe.unlink()
    else:
        recipe.write_text(json.dumps(recipe_of(METHODS["ours"]) | change))
    found = collect_all(out, {})["methods"]
    assert list(found) == ["3dgs"] and not found["3dgs"]["data"]["tiny"]["others"]


@pytest.mark.parametrize("text", [HALF, "[1]", ""])
@pytest.mark.parametrize("name", ["config.json", *(f"seed_0/ours/{n}.json" for n in ("metrics", "render_ms", "lpips"))])
def test_the_table_names_the_damaged_file(out, name, text):
    (out / "tiny" / name).write_text(text)
    with pytest.raises(DataError, match=f"{name}: .*; restore"):
        collect_all(out, {})


def test_the_table_names_what_metrics_lack(out):
    (out / "tiny/seed_0/ours/metrics.json").write_text(json.dumps(METRICS | {"train": {}}))
    with pytest.raises(DataError, match="metrics.json: has no 'l1'; restore"):
        collect_all(out, {})


@pytest.mark.parametrize("text", [HALF, "[1]"])
def test_so_do_the_recipe_the_settings_and_the_crops(out, text):
    folder, config = out / "tiny", TrainConfig("", **SETTINGS)
    for name in ("config.json", "seed_0/3dgs/metrics.json", "seed_0/3dgs/recipe.json"):
        (folder / name).write_text(text)
    with pytest.raises(DataError, match=r"recipe.json: .*; restore"):
        is_complete(folder / "seed_0" / "3dgs", METHODS["3dgs"])
    with pytest.raises(DataError, match=r"config.json: .*; restore"):
        claim(folder, config)
    with pytest.raises(DataError, match=r"config.json: .*; restore"):
        perform(Task("start", str(folder), 0), {})
    rows = {name: {"label": name, "runs": {"0": {}}} for name in ("3dgs", "ours")}
    with pytest.raises(DataError, match=r"metrics.json: .*; restore"):
        crops(folder, rows)


def test_a_comparison_that_goes_on_says_so_before_its_first_task(data, out, monkeypatch):
    (out / "comparison.json").write_text("{}")
    for config in out.glob("*/config.json"):
        config.unlink()
    monkeypatch.setattr("mi_dogsplat.compare.execute.in_a_process", lambda *_: pytest.fail("a task has begun"))
    with pytest.raises(DataError, match="other contents"):
        compare(TrainConfig("", **SETTINGS), [str(data)], out, [0], ("3dgs",))
    (out / "tiny" / "config.json").write_text(HALF)
    with pytest.raises(DataError, match="config.json: not valid JSON"):
        compare(TrainConfig("", **SETTINGS), [str(data)], out, [0], ("3dgs",))
