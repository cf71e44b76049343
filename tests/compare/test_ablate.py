"""The ablation: the parts of the method as methods of a comparison, and what its command leaves behind."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from happenings import history_of, records
from html_pages import parsed, rows
from mi_dogsplat.cli import main
from mi_dogsplat.compare.execute import Means
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.numbers import collect, summary
from mi_dogsplat.compare.table import COLUMNS, cells, markdown
from mi_dogsplat.compare.tasks import Task, perform
from mi_dogsplat.runs.checkpoint import load_checkpoint
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.training.config import TrainConfig

NAMES = ("3dgs", "v1", "v3", "full")
STEPS = 60


@pytest.fixture(scope="module")
def folder(data, tmp_path_factory) -> Path:
    """What the command leaves, of two seeds. Tasks have no processes of their own: test_compare.py has such."""

    def here(task: Task, means: Means) -> None:
        perform(task, means.free)

    top = tmp_path_factory.mktemp("ablation")
    flags = f"--steps {STEPS} --sh-degree 1 --max-primitives 120 --target 0.25 --log-every 10".split()
    arguments = ["ablate", str(data), "-o", str(top / "out"), "--seeds", "0", "1", "--only", *NAMES]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mi_dogsplat.compare.execute.in_a_process", here)
        assert main([*arguments, *flags]) == 0
    return top / "out"


@pytest.fixture(scope="module")
def table(folder) -> dict:
    return json.loads((folder / "comparison.json").read_text())


@pytest.mark.slow
def test_all_variants_of_a_seed_go_on_from_one_start(folder):
    for seed in (0, 1):
        start = load_checkpoint(folder / "tiny" / f"seed_{seed}" / "start.npz")
        assert int(start["step"]) == 30  # the end of densification, half of the run
        n = np.size(start["optimizer.logit_opacities"])
        for name in NAMES:
            rows = history_of(folder / "tiny" / f"seed_{seed}" / name)
            assert rows[0]["step"] >= 30 and rows[-1]["step"] == STEPS
            prunes = records(rows, "pruned")
            assert bool(prunes) == (name != "3dgs")
            if prunes:
                assert prunes[0]["before"] == n and rows[-1]["n"] == round(0.25 * n)


def test_each_variant_is_what_its_recipe_says(folder, table):
    assert list(table["methods"]) == list(NAMES)  # in the order of METHODS, without those not asked for
    runs = folder / "tiny" / "seed_0"
    assert json.loads((runs / "v1" / "recipe.json").read_text())["recipe"]["score"]["kind"] == "opacity"
    assert METHODS["v1"].label in (runs / "v1" / "report.html").read_text(encoding="utf-8")
    assert read_ply(runs / "v1" / "point_cloud.ply").n_dog == 0
    activated = [row for row in history_of(runs / "full") if "psnr_before" in row]
    assert len(activated) == 1 and np.isfinite(activated[0]["test_psnr"])


def test_the_report_of_the_full_method_compares_it_with_the_variant_without_dog(folder):
    for seed in (0, 1):
        run = folder / "tiny" / f"seed_{seed}" / "full"
        profile = json.loads((run / "test" / "dog_profile.json").read_text())
        assert "V3" in profile["without"] and profile["with_dog"]["error"] != profile["without_dog"]["error"]
        assert "V3" in (run / "report.html").read_text(encoding="utf-8")


def test_the_table_is_the_mean_of_the_runs_and_is_on_disk(folder, table):
    row = table["methods"]["full"]["data"]["tiny"]
    values = [json.loads((folder / f"tiny/seed_{k}/full/metrics.json").read_text())["test"]["psnr"] for k in (0, 1)]
    assert row["summary"]["psnr"]["value"] == pytest.approx(np.mean(values))
    assert row["summary"]["psnr"]["spread"] == pytest.approx(abs(values[0] - values[1]) / 2)
    assert "activation_db" in row["summary"]
    assert "activation_db" not in table["methods"]["v1"]["data"]["tiny"]["summary"]
    text = (folder / "comparison.md").read_text()
    assert text == markdown(table, "tiny") and len(text.splitlines()) == 4 + len(NAMES)
    assert f"{np.mean(values):.2f} ± " in text


def test_the_page_shows_the_table_with_a_cell_for_every_number(folder, table):
    page = parsed((folder / "comparison.html").read_text(encoding="utf-8"))
    numbers = rows(next(page.iter("table")))[1:]
    assert numbers == [[METHODS[name].label, *(text for text, _ in cells(table, "tiny", name))] for name in NAMES]


def test_a_variant_trained_again_by_hand_loses_the_name_it_had_in_the_ablation(folder):
    run, label = folder / "tiny" / "seed_1" / "v1", METHODS["v1"].label
    assert label in (run / "report.html").read_text(encoding="utf-8")
    config = TrainConfig(**json.loads((run / "config.json").read_text()))
    train(replace(config, steps=20), run)
    assert label not in (run / "report.html").read_text(encoding="utf-8")
    assert not (run / "recipe.json").exists() and not (run / "render_ms.json").exists()


def test_times_are_medians_and_numbers_that_a_run_does_not_have_leave_their_cells_empty():
    times = {str(seed): {"train_seconds": seconds} for seed, seconds in enumerate((10.0, 12.0, 50.0))}
    assert summary(times) == {"train_seconds": {"value": 12.0, "spread": 20.0}}  # a mean would be 24
    full, part = {"0": {"psnr": 30.0, "n": 1234.0, "train_l1": 0.1}}, {"0": {"psnr": 29.0, "n": 1234.0}}
    assert summary(part) == {"psnr": {"value": 29.0, "spread": 0.0}, "n": {"value": 1234.0, "spread": 0.0}}
    rows = {
        name: {"label": name, "data": {"tiny": {"runs": runs, "summary": summary(runs)}}}
        for name, runs in (("v1", part), ("v2", full))
    }
    shown = [cell.strip() for cell in markdown({"methods": rows}, "tiny").splitlines()[4].strip("|").split("|")]
    assert shown == ["v1", "1,234", "29.00", ""]
    assert [heading for heading, *_ in COLUMNS.values()][0] == "primitives"


def test_an_empty_folder_has_no_rows(tmp_path):
    assert collect(tmp_path, METHODS) == {}
