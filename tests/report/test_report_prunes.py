"""Prunes in a report: found in the history, marked on every curve, listed with their reasons."""

import json
import re

import numpy as np
import pytest
from happenings import history_of
from html_pages import parsed, rows, section, words
from mi_dogsplat.report.plot import WIDTH, Mark, Series, line_plot
from mi_dogsplat.report.prunes import marks, prunes, with_drops
from mi_dogsplat.report.run_folder import read_run
from mi_dogsplat.report.write import write_report
from mi_dogsplat.training.events import DogActivated, OpacityReset, Pruned, Refined, ShDegree, row_of

PRUNES = {  # step: from, to, why
    150: (4000, 2200, "first check"),
    200: (2200, 1300, "L1 0.0190 <= 0.95 x 0.0204"),
    250: (1300, 400, "the window <closes>"),
}


@pytest.fixture
def run(tmp_path):
    """Three prunes, one of them beside other events; two checks that refined; DoG at once after the last prune."""
    history, n = [], 4000
    for step in range(10, 301, 10):
        row = {"step": step, "seconds": step / 10, "l1": 0.02, "n_dog": 0, "test_psnr": 25.0}
        if step in PRUNES:
            before, n, why = PRUNES[step]
            row |= row_of([OpacityReset(), Pruned(before, n, why, 0.021), ShDegree(1)])
        if step in (170, 220):
            row |= row_of([Refined("L1 0.0213 > 0.95 x 0.0215", 0.022)])
        if step == 260:
            row |= row_of([DogActivated(400)])
        history.append(row | {"n": n})
    (tmp_path / "history.jsonl").write_text("\n".join(map(json.dumps, history)))
    return tmp_path


def test_the_history_says_from_where_to_where_and_why(run):
    found = prunes(read_run(run))
    assert [(p.before, p.after, p.why) for p in found] == list(PRUNES.values())
    assert [10 * p.row + 10 for p in found] == list(PRUNES)


def test_every_curve_has_a_line_for_every_prune_and_for_the_activation(run):
    plots = re.findall(r"<svg.*?</svg>", write_report(run).read_text(), re.DOTALL)
    assert len(plots) == 6  # error, PSNR and count, against run time and against step
    for plot in plots:
        line = re.search(r'class="mark" d="([^"]*)"', plot)
        assert line is not None and line[1].count("M") == 4
        assert all(f">{label}</text>" in plot for label in ("1", "2", "3", "DoG"))


def test_a_mark_stands_at_the_row_of_its_event(run):
    history = read_run(run)
    x = history.column("step")
    assert marks(history, x) == [Mark("1", 150), Mark("2", 200), Mark("3", 250), Mark("DoG", 260)]


def test_the_count_falls_at_the_prune_not_over_the_rows_before_it(run):
    history = read_run(run)
    x, n = with_drops(history, history.column("step"), history.column("n"))
    assert len(x) == 30 + 3 and np.all(np.diff(x) >= 0)
    for step, (before, after, _) in PRUNES.items():
        assert n[x == step].tolist() == [before, after]


def test_the_table_lists_all_prunes_and_counts_the_checks_that_refined(run):
    training = section(parsed(write_report(run).read_text()), "How training went")
    assert training is not None and rows(training) == [
        ["", "step", "from", "to", "removed", "why"],
        ["1", "150", "4,000", "2,200", "45.0 %", "first check"],
        ["2", "200", "2,200", "1,300", "40.9 %", "L1 0.0190 <= 0.95 x 0.0204"],
        ["3", "250", "1,300", "400", "69.2 %", "the window <closes>"],
    ]
    assert "Checks that did not prune: 2." in words(training)


def test_checks_measure_an_error_where_they_decide_by_it(run):
    measured = "A check measures the mean L1 of the whole training set"
    assert measured in " ".join(write_report(run).read_text().split())
    history = [{key: value for key, value in row.items() if key != "train_l1"} for row in history_of(run)]
    (run / "history.jsonl").write_text("\n".join(map(json.dumps, history)))
    page = " ".join(write_report(run).read_text().split())
    assert measured not in page and "Every check prunes" in page


def test_the_whole_set_error_of_the_checks_is_drawn(run):
    plots = re.findall(r"<svg.*?</svg>", write_report(run).read_text(), re.DOTALL)
    assert all(plot.count('<circle class="c2 points"') == 5 for plot in plots[:2])


def test_a_run_without_prunes_has_neither_marks_nor_table(run):
    history = history_of(run)
    plain = [{key: row[key] for key in ("step", "seconds", "l1", "n")} for row in history]
    (run / "history.jsonl").write_text("\n".join(map(json.dumps, plain)))
    html = write_report(run).read_text()
    assert 'class="mark"' not in html and "Prunes" not in html


def test_labels_of_close_marks_do_not_overlap_and_every_line_is_drawn():
    x = np.linspace(0, 30_000, 50)
    close = [Mark(str(i + 1), 15_000.0 + 100 * i) for i in range(20)]
    svg = line_plot([Series("", x, x)], "step", "n", marks=[*close, Mark("DoG", 30_000.0)])
    line = re.search(r'class="mark" d="([^"]*)"', svg)
    assert line is not None and line[1].count("M") == 21
    top = re.search(r'middle" x="([\d.]+)" y="([\d.]+)">1</text>', svg)
    assert top is not None
    labels = re.findall(rf'middle" x="([\d.]+)" y="{top[2]}">(\w+)</text>', svg)
    assert 3 <= len(labels) < 20 and labels[0][1] == "1"
    ends = [(float(at) - 4.5 * len(label), float(at) + 4.5 * len(label)) for at, label in labels]
    assert all(right < left for (_, right), (left, _) in zip(ends, ends[1:], strict=False))
    assert ends[-1][1] <= WIDTH
