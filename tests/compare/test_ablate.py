"""The ablation: one start for all variants, nothing done twice, and a table that is the mean of its runs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.ablation.ablate import ablate
from mi_dogsplat.ablation.page import ablation_page
from mi_dogsplat.ablation.table import COLUMNS, cell, collect, markdown, summary
from mi_dogsplat.ablation.variants import VARIANTS
from mi_dogsplat.cli.arguments import ABLATION
from mi_dogsplat.runs.checkpoint import load_checkpoint
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from tiny_data import write_tiny_data

NAMES = ("3dgs", "v1", "v3", "full")


@pytest.fixture(scope="module")
def ablation(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ablation")
    write_tiny_data(folder / "data")
    config = TrainConfig(
        str(folder / "data"), preset="3dgs", steps=60, sh_degree=1, max_primitives=120, target=0.25, log_every=10
    )
    lines: list[str] = []
    table = ablate(config, folder / "out", [0, 1], NAMES, lines.append)
    return config, folder / "out", table, lines


def history(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "history.jsonl").read_text(encoding="utf-8").splitlines()]


def test_all_variants_of_a_seed_go_on_from_one_start(ablation):
    config, out, _, _ = ablation
    for seed in (0, 1):
        start = load_checkpoint(out / f"seed_{seed}" / "start.npz")
        assert int(start["step"]) == 30  # the end of densification, half of the run
        n = np.size(start["optimizer.logit_opacities"])
        for name in NAMES:
            rows = history(out / f"seed_{seed}" / name)
            assert rows[0]["step"] >= 30 and rows[-1]["step"] == config.steps
            first_prune = next((row for row in rows if "pruned_from" in row), None)
            assert (first_prune is None) == (name == "3dgs")
            if first_prune:
                assert first_prune["pruned_from"] == n
                assert rows[-1]["n"] == round(0.25 * n)


def test_each_variant_is_what_its_recipe_says(ablation):
    _, out, table, _ = ablation
    assert list(table["variants"]) == list(NAMES)  # in the order of VARIANTS, without those not asked for
    folder = out / "seed_0"
    assert json.loads((folder / "v1" / "recipe.json").read_text())["recipe"]["score"]["kind"] == "opacity"
    assert VARIANTS["v1"].label in (folder / "v1" / "report.html").read_text(encoding="utf-8")
    assert read_ply(folder / "v1" / "point_cloud.ply").n_dog == 0
    activated = [row for row in history(folder / "full") if "psnr_before" in row]
    assert len(activated) == 1 and np.isfinite(activated[0]["test_psnr"])
    assert tuple(VARIANTS) == ABLATION  # what the command line offers without importing Mitsuba


def test_the_report_of_the_full_method_compares_it_with_the_variant_without_dog(ablation):
    _, out, _, _ = ablation
    for seed in (0, 1):
        profile = json.loads((out / f"seed_{seed}" / "full" / "test" / "dog_profile.json").read_text())
        assert "V3" in profile["without"] and profile["with_dog"]["error"] != profile["without_dog"]["error"]
        assert "V3" in (out / f"seed_{seed}" / "full" / "report.html").read_text(encoding="utf-8")


def test_the_table_is_the_mean_of_the_runs_and_is_on_disk(ablation):
    _, out, table, _ = ablation
    assert json.loads((out / "ablation.json").read_text()) == table
    row = table["variants"]["full"]
    values = [json.loads((out / f"seed_{k}/full/metrics.json").read_text())["test"]["psnr"] for k in (0, 1)]
    assert row["summary"]["psnr"]["value"] == pytest.approx(np.mean(values))
    assert row["summary"]["psnr"]["spread"] == pytest.approx(abs(values[0] - values[1]) / 2)
    assert "activation_db" in row["summary"] and "activation_db" not in table["variants"]["v1"]["summary"]
    text = (out / "ablation.md").read_text()
    assert text == markdown(table)
    assert len(text.splitlines()) == 2 + len(NAMES)
    assert f"{np.mean(values):.2f} ± " in text


def test_the_page_shows_the_table_and_a_plot_for_each_variant_but_the_baseline(ablation):
    _, out, table, _ = ablation
    html = (out / "ablation.html").read_text(encoding="utf-8")
    assert html.count("<svg") == len(NAMES) - 1 and "http" not in html.replace("http://www.w3.org", "")
    for row in table["variants"].values():
        assert row["label"] in html
        for name in COLUMNS:
            assert cell(row, name) in html


def test_a_page_without_the_baseline_has_the_table_alone(ablation):
    _, out, table, _ = ablation
    only = {"config": table["config"], "variants": {"v1": table["variants"]["v1"]}}
    html = ablation_page(out, only)
    assert "<svg" not in html and table["variants"]["v1"]["label"] in html


def test_what_is_complete_is_not_repeated_and_a_seed_can_be_added(ablation):
    config, out, before, first_lines = ablation
    assert sum("densifying" in line for line in first_lines) == 2
    lines: list[str] = []
    table = ablate(config, out, [0, 1, 2], ["v1"], lines.append)
    assert [line.split(":")[0] for line in lines if ":" in line] == ["seed 2", "seed 2"]
    assert set(table["variants"]["v1"]["runs"]) == {"0", "1", "2"}
    assert table["variants"]["full"]["runs"].keys() == before["variants"]["full"]["runs"].keys()


def test_a_variant_trained_again_by_hand_loses_the_name_it_had_in_the_ablation(ablation):
    config, out, _, _ = ablation
    folder = out / "seed_1" / "v1"
    label = VARIANTS["v1"].label
    assert label in (folder / "report.html").read_text(encoding="utf-8")
    train(replace(config, steps=20), folder)
    assert label not in (folder / "report.html").read_text(encoding="utf-8")
    assert not (folder / "recipe.json").exists() and not (folder / "render_ms.json").exists()


def test_a_folder_with_other_settings_or_other_contents_is_refused(ablation, tmp_path):
    config, out, _, _ = ablation
    other = TrainConfig(**{**vars(config), "steps": 61})
    with pytest.raises(DataError, match="other settings"):
        ablate(other, out, [0], ["v1"])
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(DataError, match="other contents"):
        ablate(config, tmp_path, [0], ["v1"])
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_numbers_that_a_run_does_not_have_leave_their_cells_empty():
    runs = {"0": {"psnr": 30.0, "n": 1234.0}}
    times = {str(seed): {"train_seconds": seconds} for seed, seconds in enumerate((10.0, 12.0, 50.0))}
    assert summary(times) == {"train_seconds": {"value": 12.0, "spread": 20.0}}  # a mean would be 24
    assert summary(runs) == {"psnr": {"value": 30.0, "spread": 0.0}, "n": {"value": 1234.0, "spread": 0.0}}
    table = {"variants": {"v1": {"label": "V1", "runs": runs, "summary": summary(runs)}}}
    cells = [cell.strip() for cell in markdown(table).splitlines()[-1].strip("|").split("|")]
    assert cells[:3] == ["V1", "1", "30.00"] and len(cells) == 2 + len(COLUMNS)
    assert cells.count("") == len(COLUMNS) - 2 and "1,234" in cells


def test_an_empty_folder_has_no_rows(tmp_path):
    assert collect(tmp_path, list(VARIANTS)) == {}
