"""Slopes and cuts in the table of a comparison: a column for each, where a method gives some to primitives."""

import json
from pathlib import Path

import pytest
from mi_dogsplat.compare.folders import claim
from mi_dogsplat.compare.method_runs import recipe_of
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.names import ABLATION, chosen
from mi_dogsplat.compare.table import collect_all, columns, markdown
from mi_dogsplat.training.config import TrainConfig
from small_comparison import SETTINGS

METRICS = {
    "test": {"psnr": 30.0, "ssim": 0.9, "flip": 0.1},
    "train": {"l1": 0.01},
    **{"n": 1200, "n_dog": 7, "train_seconds": 1.0, "render_ms": 2.0, "peak_memory_mb": 3.0, "bytes": 4000},
}
ROWS = {
    "ours": {},
    "ours_slopes": {"n_slopes": 1111},
    "ours_cuts": {"n_slopes": 1112, "n_cuts": 1113},
    "ours_second_cuts": {"n_slopes": 1114, "n_cuts": 1115, "n_second_cuts": 1116},
    "ours_curvatures": {"n_slopes": 1117, "n_curvatures": 1118, "n_cuts": 1119, "n_second_cuts": 1120},
    "ours_shifts": {"n_slopes": 1121, "n_curvatures": 1122, "n_cuts": 1123, "n_second_cuts": 1124, "n_shifts": 1125},
}


def comparison(out: Path, names) -> dict:
    claim(out / "tiny", TrainConfig("", **SETTINGS))
    for name in names:
        run = out / "tiny" / "seed_0" / name
        run.mkdir(parents=True)
        (run / "metrics.json").write_text(json.dumps(METRICS | ROWS[name]))
        (run / "recipe.json").write_text(json.dumps(recipe_of(METHODS[name])))
    return collect_all(out, {})


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (["ours"], []),
        (["ours", "ours_slopes"], ["n_slopes"]),
        (list(ROWS)[:3], ["n_slopes", "n_cuts"]),
        (list(ROWS)[:4], ["n_slopes", "n_cuts", "n_second_cuts"]),
        (list(ROWS)[:5], ["n_slopes", "n_curvatures", "n_cuts", "n_second_cuts"]),
        (list(ROWS), ["n_slopes", "n_curvatures", "n_cuts", "n_second_cuts", "n_shifts"]),
    ],
)
def test_a_column_is_there_where_a_method_has_such_rows(tmp_path, names, shown):
    table = comparison(tmp_path, names)
    assert columns(table, "tiny")[: len(shown) + 4] == ["n", "n_dog", *shown, "megabytes", "psnr"]
    second, text = "n_second_cuts" in shown, markdown(table, "tiny")
    if "n_shifts" in shown:
        assert "| with slopes | with curvatures | with a cut | with a second cut | with shifts |" in text
        assert "| ours, with shifts | 1,200 | 7 | 1,121 | 1,122 | 1,123 | 1,124 | 1,125 |" in text
        assert "| ours, with curvatures | 1,200 | 7 | 1,117 | 1,118 | 1,119 | 1,120 |  |" in text
    elif "n_curvatures" in shown:
        assert "| with slopes | with curvatures | with a cut | with a second cut |" in text
        assert "| ours, with second cuts | 1,200 | 7 | 1,114 |  | 1,115 | 1,116 |" in text
        assert "| ours, with curvatures | 1,200 | 7 | 1,117 | 1,118 | 1,119 | 1,120 |" in text
    elif "n_cuts" in shown:
        assert "| primitives | of them DoG | with slopes | with a cut |" + " with a second cut |" * second in text
        assert "| ours, with slopes and cuts | 1,200 | 7 | 1,112 | 1,113 |" + "  |" * second in text
        assert "| ours, with slopes | 1,200 | 7 | 1,111 |  |" + "  |" * second in text
        assert ("| ours, with second cuts | 1,200 | 7 | 1,114 | 1,115 | 1,116 |" in text) == second


def test_an_ablation_goes_on_to_shifts_and_so_do_all_sets():
    ours = ("ours", "ours_slopes", "ours_cuts", "ours_preconditioned", "ours_second_cuts", "ours_curvatures",
            "ours_shifts")  # fmt: skip
    assert ABLATION[-7:] == ours
    assert all(tuple(chosen([words])[-7:]) == ours for words in ("published", "equal", "ablation"))
