"""Tables of paired differences, of equal bytes and equal time, and runs at more than one target."""

import csv
import json
import re
from typing import Any

import numpy as np
import pytest
from command_line import assert_one_line, run
from mi_dogsplat.cli import main
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.names import AT, at_target
from mi_dogsplat.compare.nearest import nearest, tables_of_equals
from mi_dogsplat.compare.overview import overview
from mi_dogsplat.compare.pairs import interval, margin, paired, seconds_to, table_of_pairs
from mi_dogsplat.compare.table import label
from mi_dogsplat.compare.ways import ways
from small_comparison import without_processes
from tiny_data import write_tiny_data


def row(label: str, psnr: list[float], megabytes=1.0, seconds=10.0, **others) -> dict[str, Any]:
    def numbers(value, size):
        return {"psnr": value, "megabytes": size, "train_seconds": seconds}

    runs = {str(seed): numbers(value, megabytes) for seed, value in enumerate(psnr)}
    summary = {name: {"value": float(np.mean([run[name] for run in runs.values()]))} for name in runs["0"]}
    known = {target: numbers(*pair) for target, pair in others.items()}
    more = {target: {"summary": {k: {"value": v} for k, v in found.items()}} for target, found in known.items()}
    return {"label": label, "runs": runs, "summary": summary, "others": more}


def test_intervals_are_those_of_student_and_one_difference_has_none():
    assert interval([0.5]) == (0.5, None)
    mean, half = interval([0.1, 0.3, 0.8])
    assert mean == pytest.approx(0.4)
    assert half == pytest.approx(4.302653 * np.std([0.1, 0.3, 0.8], ddof=1) / np.sqrt(3), rel=1e-6)  # t(2, 97.5 %)


def test_differences_are_of_equal_seeds():
    rows = {"ours": row("ours", [30.0, 31.0, 32.0]), "paper": row("paper", [29.0, 30.1])}
    assert paired(rows, "ours")["paper"][0] == pytest.approx(-0.95) and "ours" not in paired(rows, "ours")


def write_history(folder, points):
    folder.mkdir(parents=True)
    counts = [n[0] if n else 100 for _, _, *n in points]
    rows = [{"step": k, "seconds": t, "test_psnr": psnr} for k, (t, psnr, *_) in enumerate(points)]
    lines = [json.dumps(found | {"n": n}) for found, n in zip(rows, counts, strict=True)]
    (folder / "history.jsonl").write_text("\n".join(lines))


def test_the_time_to_a_quality_is_that_of_the_first_measurement_and_never_is_said(tmp_path):
    rows = {"paper": row("paper", [29.0]), "ours": row("ours", [30.0]), "dash": row("dash", [28.0])}
    pruned = [(5.0, 31.0, 1000), (10.0, 27.0), (20.0, 29.5), (30.0, 28.5), (40.0, 30.0)]  # 31 dB with ten times as many
    write_history(tmp_path / "seed_0/ours", pruned)
    write_history(tmp_path / "seed_0/paper", [(10.0, 27.0), (50.0, 29.0)])
    write_history(tmp_path / "seed_0/dash", [(10.0, 28.0)])
    assert seconds_to(tmp_path / "seed_0/ours", 29.0) == 20.0
    assert seconds_to(tmp_path / "seed_0/dash", 29.0) is None
    table = table_of_pairs(tmp_path, rows)
    assert table and (table["reference"], table["of"], table["level"]) == ("ours", "paper", "29.00 dB")
    assert [line[-1] for line in table["rows"]] == ["50", "20", "never"]
    assert [line[2] for line in table["rows"]] == ["one seed: no interval", "the reference", "one seed: no interval"]


def test_what_a_finished_run_measures_is_the_end_of_its_way(tmp_path):
    """--test-every need not divide the number of steps."""
    psnrs = {"3dgs": 28.0, "paper": 29.0, "ours": 30.0}
    rows = {name: row(name, [psnr]) for name, psnr in psnrs.items()}
    for name, psnr in psnrs.items():
        write_history(run := tmp_path / "seed_0" / name, [(60.0, 27.0), (120.0, None)])
        (run / "metrics.json").write_text(json.dumps({"test": {"psnr": psnr, "flip": 0.1}}))
    table = table_of_pairs(tmp_path, rows)
    assert table and [line[-1] for line in table["rows"]] == ["never", "120", "120"]
    found = overview(tmp_path, rows, {name: k for k, name in enumerate(psnrs)}, "test")
    assert found and len(found[1]) == 2
    for plot, end in zip(found[1], ("PSNR, dB 30", "FLIP 0.1"), strict=True):
        assert f"ours: test {end} after 2 min" in plot
    beside = ways(tmp_path, rows)
    assert beside and len(beside[1]) == 2
    for plot in beside[1]:
        curves = re.findall(r'<path class="c[12] line" d="([^"]+)"', plot)
        assert [len(re.findall("[ML]", curve)) for curve in curves] == [2, 2]  # points


def test_a_method_without_a_seed_of_the_reference_is_not_called_the_reference(tmp_path):
    psnrs = {"ours": {"0": 30.0, "1": 31.0}, "a": {"2": 29.0}}
    rows: dict = {name: row(name, list(values.values())) for name, values in psnrs.items()}
    rows["a"]["runs"] = {"2": rows["a"]["runs"]["0"]}
    for name, values in rows.items():
        for seed in values["runs"]:
            write_history(tmp_path / f"seed_{seed}" / name, [(60.0, 29.0)])
    table = table_of_pairs(tmp_path, rows)
    assert table and [line[1:3] for line in table["rows"]] == [["", "the reference"], ["", "no seed in common"]]


def test_seeds_are_named_where_rows_do_not_have_the_same():
    def table(**seeds: str) -> dict:
        rows = {name: {"label": name, "data": {"d": {"runs": dict.fromkeys(some)}}} for name, some in seeds.items()}
        return {"methods": rows}

    assert label(table(a="01", b="01"), "d", "a") == "a"
    assert label(table(a="01", b="0"), "d", "b") == "b (1 seed)"
    assert label(table(a="01", b="02"), "d", "b") == "b (seeds 0, 2)"


def test_another_target_is_in_the_name_of_a_method_exactly():
    assert [at_target("ours", target) for target in (0.05, 20_000, 1e6)] == ["ours@0.05", "ours@20000", "ours@1e+06"]
    for target in (1_234_567.0, 1_234_568, 0.1234567):
        assert float(at_target("ours", target).partition(AT)[2]) == target


def test_beginnings_that_are_far_below_the_best_are_not_drawn(tmp_path):
    rows = {"ours": row("ours", [30.0]), "mcmc": row("mcmc", [25.0])}
    write_history(tmp_path / "seed_0/ours", [(60.0, 28.0), (120.0, 30.0)])
    write_history(tmp_path / "seed_0/mcmc", [(30.0, 6.0), (60.0, 22.5), (120.0, 25.0)])
    found = overview(tmp_path, rows, {"ours": 1, "mcmc": 2}, "test")
    assert found and found[0] == "0" and len(found[1]) == 1  # no FLIP was measured
    ticks = [float(text) for text in re.findall(r'text-anchor="end"[^>]+dy="4">([0-9.]+)<', found[1][0])]
    assert min(ticks) >= 22 and max(ticks) <= 31
    assert "mcmc: test PSNR, dB 25 after 2 min" in found[1][0]


def test_a_difference_within_its_interval_is_a_tie(tmp_path):
    psnrs = {"ours": [30.0, 31.0, 32.0], "a": [30.1, 30.9, 32.1], "b": [29.0, 30.1, 31.0]}
    rows = {name: row(name, values) for name, values in psnrs.items()}
    for name, one in rows.items():
        for seed in one["runs"]:
            write_history(tmp_path / f"seed_{seed}" / name, [(1.0, 1.0)])
    table = table_of_pairs(tmp_path, rows)
    assert table and [line[2] for line in table["rows"]] == ["the reference", "a tie", "worse"]


def test_the_margin_is_told_by_its_parts_where_all_have_a_row():
    psnrs = {"paper": 29.0, "ours": 30.5, "paper_equal": 30.0, "ours_published": 28.9}
    rows = {name: row(name, [psnr]) for name, psnr in psnrs.items()}
    words = margin(rows)
    assert "all of it +1.50 dB" in words and "step sizes +1.00 dB" in words and "schedule -0.10 dB" in words
    assert margin({name: found for name, found in rows.items() if name != "ours_published"}) == ""


def test_the_nearest_run_is_that_of_the_nearest_ratio_and_nothing_is_interpolated():
    ours = row("ours", [30.0], megabytes=2.0)
    paper = row("paper", [29.0], megabytes=0.9, seconds=4346.0, **{"0.2": (29.7, 1.9), "0.4": (29.9, 4.1)})
    rows = {"ours": ours, "paper": paper}
    assert nearest(paper, "megabytes", 2.0) == "0.2" and nearest(paper, "megabytes", 1.0) == ""
    by_size, by_time = tables_of_equals(rows, 0.1)
    assert by_size["rows"] == [["ours", "0.1", "2.00", "1.00", "30.00"], ["paper", "0.2", "1.90", "0.95", "29.70"]]
    assert by_time["rows"][1][:4] == ["paper", "0.1", "4,346", "434.60"]


def test_targets_of_a_million_are_told_in_full():
    paper = row("paper", [29.0], 1.0, 10.0, **{"1e+06": (29.7, 1.9)})
    rows = {"ours": row("ours", [30.0], megabytes=2.0), "paper": paper}
    by_size, by_time = tables_of_equals(rows, 1_234_567.0)
    assert [line[1] for line in by_size["rows"]] == ["1,234,567", "1,000,000"]
    assert [line[1] for line in by_time["rows"]] == ["1,234,567", "1,234,567"]


def test_only_what_keeps_all_primitives_is_said_to_have_them():
    rows = {name: row(name, [30.0]) for name in METHODS}
    by_size, _ = tables_of_equals(rows, 0.1)
    assert [line[0] for line in by_size["rows"] if line[1] == "all primitives"] == ["3dgs", "3dgs_equal", "3dgs_early"]


def test_more_targets_are_below_the_cap_and_others_than_the_target(tmp_path, monkeypatch, capsys):
    asked = []

    def compared(*_, targets: list[float], **__) -> dict:
        asked.append(targets)
        return {"failed": {}}

    monkeypatch.setattr("mi_dogsplat.compare.compare.compare", compared)
    command = ["compare", tmp_path, "-o", tmp_path / "out", "--max-primitives", "300", "--target", "30%"]
    assert_one_line(run(capsys, *command, "--more-targets", "400"), "--more-targets: 400 primitives are not fewer than")
    assert run(capsys, *command, "--more-targets", "0.5", "0.3", "200")[0] == 0
    assert asked == [[0.5, 200]]


@pytest.mark.slow
def test_more_targets_are_runs_of_their_own_of_compact_methods(tmp_path):
    data = write_tiny_data(tmp_path / "tiny")
    flags = "--steps 60 --sh-degree 1 --max-primitives 120 --target 0.25 --log-every 10".split()
    only = ["--only", "3dgs", "opacity", "3dgs_capped", "released_40k", "--more-targets", "0.5"]
    with without_processes():
        assert main(["compare", str(data), "-o", str(tmp_path / "out"), *only, *flags]) == 0
    table = json.loads((tmp_path / "out" / "comparison.json").read_text())
    of = {name: found["data"]["tiny"] for name, found in table["methods"].items()}
    assert set(of) == {"3dgs", "opacity", "3dgs_capped", "released_40k"} and not of["3dgs"]["others"]
    n = of["3dgs"]["runs"]["0"]["n"]
    assert of["opacity"]["runs"]["0"]["n"] == round(0.25 * n)
    assert of["opacity"]["others"]["0.5"]["runs"]["0"]["n"] == round(0.5 * n)
    with open(tmp_path / "out" / "comparison.csv", encoding="utf-8", newline="") as file:
        names = [line["method"] for line in csv.DictReader(file)]
    again = ("3dgs_capped", "opacity", "released_40k")
    assert sorted(names) == sorted(["3dgs", *again, *(f"{name}@0.5" for name in again)])
    measured = json.loads((tmp_path / "out" / "tiny" / "seed_0" / "opacity@0.5" / "render_ms.json").read_text())
    assert sorted(measured["in_turn_with"]) == sorted(names)  # their FPS stand in one column
    history = (tmp_path / "out" / "tiny" / "seed_0" / "released_40k" / "history.jsonl").read_text().splitlines()
    first, last = (json.loads(line)["step"] for line in (history[0], history[-1]))
    assert 30 < first <= 40 and last == 80  # from the start of the others, a third more steps than they have
    page = (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8")
    assert "Equal bytes" in page and "Equal time" in page


@pytest.mark.parametrize("target", ["0", "1.5", "-3"])
def test_targets_that_are_none_are_refused_in_one_line(tmp_path, capsys, target):
    assert main(["compare", str(tmp_path), "-o", str(tmp_path / "out"), "--more-targets", target]) == 2
    assert f"--more-targets: {float(target):g} is not a target" in capsys.readouterr().err
