"""The comparison: one start and one budget for all, nothing done twice, and no failure that stops the others."""

import contextlib
import csv
import json
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from html_pages import parsed, rows, words
from mi_dogsplat.compare import cluster
from mi_dogsplat.compare.compare import compare
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.page import comparison_page, pareto
from mi_dogsplat.compare.table import COLUMNS, MEAN, collect_all, latex
from mi_dogsplat.compare.tasks import Task, perform, tasks_of
from mi_dogsplat.measure.lpips import Lpips
from mi_dogsplat.runs.checkpoint import Checkpoints, load_checkpoint
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.given_rows import GIVEN
from mi_dogsplat.training.train import Trainer
from PIL import Image
from small_comparison import NAMES, SETTINGS, without_processes
from small_vgg import install, small_weights
from tiny_data import HEIGHT, WIDTH, write_tiny_data


@pytest.fixture(scope="module")
def comparison(data, tmp_path_factory):
    lines: list[str] = []
    out = tmp_path_factory.mktemp("comparison") / "out"
    with without_processes():
        table = compare(TrainConfig("", **SETTINGS), [str(data)], out, [0], NAMES, progress=lines.append)
    return out, table, lines


def test_all_methods_end_with_the_same_number_of_primitives_but_the_baseline(comparison):
    out, table, _ = comparison
    n = np.size(load_checkpoint(out / "tiny" / "seed_0" / "start.npz")["optimizer.logit_opacities"])
    counts = {name: row["data"]["tiny"]["runs"]["0"]["n"] for name, row in table["methods"].items()}
    assert counts == {"3dgs": n} | {name: round(0.25 * n) for name in NAMES[1:]} and not table["failed"]
    first = {name: (out / "tiny/seed_0" / name / "history.jsonl").read_text().splitlines()[0] for name in NAMES}
    assert all((json.loads(first[name])["step"] >= 30) == METHODS[name].from_the_start for name in NAMES)


def test_the_table_has_what_the_runs_measured(comparison):
    out, table, _ = comparison
    assert json.loads((out / "comparison.json").read_text()) == table == collect_all(out, {})
    run = out / "tiny" / "seed_0" / "ours"
    metrics = json.loads((run / "metrics.json").read_text())
    numbers = table["methods"]["ours"]["data"]["tiny"]["runs"]["0"]
    for name in ("psnr", "ssim", "flip"):
        assert numbers[name] == metrics["test"][name]
    assert numbers["megabytes"] == (run / "point_cloud.ply").stat().st_size / 1e6
    assert numbers["peak_memory_mb"] == metrics["peak_memory_mb"]
    in_turn = json.loads((run / "render_ms.json").read_text())
    assert numbers["fps"] == pytest.approx(1000 / in_turn["render_ms"]) and in_turn["in_turn_with"] == sorted(NAMES)


def test_the_csv_has_a_line_per_run_and_latex_a_line_per_method_with_the_best_compact_one_in_bold(comparison):
    out, table, _ = comparison
    with open(out / "comparison.csv", encoding="utf-8", newline="") as file:
        rows = {row["method"]: row for row in csv.DictReader(file)}
    psnr = {name: float(rows[name]["psnr"]) for name in NAMES}
    assert psnr == {name: row["data"]["tiny"]["runs"]["0"]["psnr"] for name, row in table["methods"].items()}
    lines = {line.split(" & ")[0]: line for line in latex(table, "tiny").splitlines() if " & " in line}
    best = max(NAMES[1:], key=lambda name: psnr[name])
    for name in NAMES:
        label = METHODS[name].label.replace("%", r"\%")
        assert (f"\\textbf{{{psnr[name]:.2f}}}" in lines[label]) == (name == best)
        assert lines[label].count(" & ") == lines["method"].count(" & ")
    assert (out / "comparison.tex").read_text() == latex(table, "tiny")


def test_the_page_needs_nothing_but_itself_and_has_every_plot_and_a_crop_of_every_method(comparison):
    out, table, _ = comparison
    html = (out / "comparison.html").read_text(encoding="utf-8")
    page = parsed(html)
    for word in ("http", "<script", "<link", "url("):
        assert word not in html
    assert html.count('role="img"') == 2 + 4 + len(NAMES) - 1
    sources = [image.attrib["src"] for image in page.iter("img")]
    assert len(sources) == 2 + len(NAMES) and all(source.startswith("data:image/") for source in sources)
    labels = [row["label"] for row in table["methods"].values()]
    captions = [words(caption) for caption in page.iter("figcaption")]
    assert captions[:2] == ["Ground truth, whole view", "Ground truth"]
    assert [caption.rpartition(", ")[0] for caption in captions[2:]] == labels
    numbers, *others, sources_of = (rows(found) for found in page.iter("table"))
    assert all([line[0] for line in found] == ["method", *labels] for found in (numbers, *others)) and len(others) == 3
    columns = ("label", "source", "deviations")
    assert sources_of == [[" ".join(row[name].split()) for name in columns] for row in table["methods"].values()]
    assert "its schedule and step sizes" in words(page) and "30.89" in words(page)


def test_the_first_picture_is_error_against_run_time_of_all_methods_and_of_the_start(comparison):
    out, table, _ = comparison
    page = parsed((out / "comparison.html").read_text(encoding="utf-8"))
    first, second = [found for found in page.iter() if found.attrib.get("role") == "img"][:2]
    labels = [row["label"] for row in table["methods"].values()]
    for plot, words_of in ((first, "test PSNR, dB"), (second, "test FLIP")):
        assert plot.attrib["aria-label"] == f"{words_of} against run time, min"
        titles = [words(title) for title in plot.iter("title")]
        assert all(any(title.startswith(f"{label}: {words_of}") for title in titles) for label in labels)


def test_the_page_says_that_all_methods_took_preconditioned_steps(comparison):
    out, table, _ = comparison
    config = {"tiny": table["config"]["tiny"] | {"preconditioned": True}}
    said = "All methods take preconditioned steps"
    assert said in words(parsed(comparison_page(out, table | {"config": config})))
    assert said not in words(parsed(comparison_page(out, table)))


def test_the_page_says_that_pixels_do_not_count_where_masks_leave_some_out(comparison):
    out, table, _ = comparison
    said, mask = "Pixels that its mask leaves out do not count.", np.ones((HEIGHT, WIDTH))
    assert said in words(parsed(comparison_page(out, table, {"tiny": lambda _: mask})))
    assert said not in words(parsed(comparison_page(out, table)))


def test_the_page_names_what_has_another_start_or_other_steps(comparison):
    out, table, _ = comparison
    alike = {name: row for name, row in table["methods"].items() if METHODS[name].from_the_start}
    row = {"source": "", "deviations": "", "data": {}}
    others = {"mask_gaussian": "MaskGaussian", "ours_early": "ours, early", "released_40k": "released, 40,000 steps"}
    methods = alike | {name: row | {"label": label} for name, label in others.items()}
    page = " ".join(words(parsed(comparison_page(out, table | {"methods": methods}))).split())
    assert "one densified start, except those that begin at the first step: MaskGaussian; ours, early. All" in page
    assert "end after the same number of steps, except released, 40,000 steps. Render" in page
    page = " ".join(words(parsed(comparison_page(out, table | {"methods": alike}))).split())
    assert "continue from one densified start. All" in page and "the same number of steps. Render" in page


def test_the_best_compact_method_is_bold(comparison):
    out, table, _ = comparison
    numbers = next(parsed((out / "comparison.html").read_text(encoding="utf-8")).iter("table"))
    column = rows(numbers)[0].index("PSNR (dB)")
    psnr = {name: row["data"]["tiny"]["runs"]["0"]["psnr"] for name, row in table["methods"].items()}
    best = max(NAMES[1:], key=lambda name: psnr[name])
    bold = [line[0].text for line in numbers.iter("tr") if line[column].find("b") is not None]
    assert bold == [table["methods"][best]["label"]]


def test_text_of_runs_cannot_become_markup_and_missing_pictures_are_named(comparison, tmp_path):
    out = Path(shutil.copytree(comparison[0], tmp_path / "<evil>&"))
    evil = """'"><evil a='1'>&amp;<!--"""
    table = json.loads(json.dumps(comparison[1])) | {"failed": {f"run {evil}": f"error {evil}"}}
    for row in table["methods"].values():
        row |= {"label": row["label"] + evil, "source": evil}
    for picture in out.glob("tiny/seed_0/ours/test/*.png"):
        picture.unlink()
    page = parsed(comparison_page(out, table))
    assert not list(page.iter("evil")) and words(page).count(evil) > 3 * len(NAMES)
    assert words(next(page.iter("h1"))) == "<evil>& comparison"
    (notice,) = page.findall(".//*[@class='notice']")
    assert words(notice) == f"run {evil} has failed: error {evil}"
    assert any(words(line).startswith("Missing or not readable: ") for line in page.iter("p"))


def test_the_front_is_what_no_other_beats_in_both():
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, 12, 40).astype(float), rng.integers(0, 12, 40).astype(float)
    beaten = [
        any((x[j] <= x[i]) & (y[j] >= y[i]) & ((x[j] < x[i]) | (y[j] > y[i])) for j in range(40)) for i in range(40)
    ]
    expected = {(x[i], y[i]) for i in range(40) if not beaten[i]}
    front = pareto(x, y)
    assert [(x[i], y[i]) for i in front] == sorted(expected)


def test_what_is_complete_is_not_repeated(comparison, data, tmp_path):
    out, _, lines = comparison
    out = Path(shutil.copytree(out, tmp_path / "out"))  # render times are new
    assert sum("start" in line for line in lines) == 1 and len(lines) == len(NAMES) + 2
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/*/*/metrics.json")}
    again: list[str] = []
    with without_processes():
        compare(TrainConfig("", **SETTINGS), [str(data)], out, [0], NAMES, progress=again.append)
    assert len(again) == 1 and "render times" in again[0]
    assert {path: path.stat().st_mtime_ns for path in before} == before
    for path in out.glob("*/*/*/recipe.json"):  # as an earlier version wrote it, which knew no slopes and cuts
        method = json.loads(path.read_text())
        assert [method["recipe"].pop(name) for name in GIVEN] == [None] * len(GIVEN)
        if "kind" in (method["recipe"]["score"] or {}):  # of a ScoreRule, which had a tone curve of its own
            method["recipe"]["score"]["curve"] = None
        path.write_text(json.dumps(method))
    with without_processes():
        compare(TrainConfig("", **SETTINGS), [str(data)], out, [0], NAMES, progress=again.append)
    assert len(again) == 2 and {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.slow
def test_a_run_that_fails_is_named_and_the_others_go_on(comparison, data, tmp_path):
    out = tmp_path / "out"
    (out / "tiny" / "seed_0").mkdir(parents=True)
    (out / "comparison.json").write_text("{}")
    (out / "tiny" / "seed_0" / "start.npz").write_bytes((comparison[0] / "tiny" / "seed_0" / "start.npz").read_bytes())
    (out / "tiny" / "config.json").write_text((comparison[0] / "tiny" / "config.json").read_text())
    (out / "tiny" / "seed_0" / "opacity").write_text("in the way")
    config, lines = TrainConfig("", **SETTINGS), []
    with without_processes(but=["opacity"]):
        table = compare(config, [str(data)], out, [0], ("3dgs", "opacity"), progress=lines.append)
    assert list(table["methods"]) == ["3dgs"] and list(table["failed"]) == ["tiny, seed 0: opacity"]
    assert "is a file" in table["failed"]["tiny, seed 0: opacity"]
    assert "is a file" in (out / "comparison.html").read_text() and "is a file" in " ".join(lines)
    assert "is a file" in (out / "tiny" / "seed_0" / "opacity.log").read_text()
    (out / "tiny" / "seed_0" / "opacity").unlink()
    with without_processes(but=["opacity"]):
        table = compare(config, [str(data)], out, [0], ("3dgs", "opacity"))
    assert list(table["methods"]) == ["3dgs", "opacity"] and not table["failed"]
    assert not (out / "tiny" / "seed_0" / "opacity.log").exists()


def test_several_data_sets_have_their_mean_first(comparison, tmp_path):
    out, table, _ = comparison
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.json").write_text((out / "tiny" / "config.json").read_text())
        run = tmp_path / name / "seed_0" / "3dgs"
        run.mkdir(parents=True)
        metrics = json.loads((out / "tiny/seed_0/3dgs/metrics.json").read_text())
        metrics["test"]["psnr"] += {"a": 0, "b": 2}[name]
        (run / "metrics.json").write_text(json.dumps(metrics))
        (run / "recipe.json").write_text((out / "tiny/seed_0/3dgs/recipe.json").read_text())
        (run / "history.jsonl").write_text("")
    both = collect_all(tmp_path, {})
    means = both["methods"]["3dgs"]["data"]
    assert list(means) == ["a", "b", MEAN]
    assert means[MEAN]["summary"]["psnr"]["value"] == pytest.approx(means["a"]["summary"]["psnr"]["value"] + 1)


def test_other_folders_and_data_are_refused(comparison, data, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "SECONDS_TO_ANSWER", 0.5)
    config = TrainConfig("", **SETTINGS)
    with pytest.raises(DataError, match="other settings"):
        compare(replace(config, steps=61), [str(data)], comparison[0], [0], NAMES)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "file").write_text("mine")
    with pytest.raises(DataError, match="other contents"):
        compare(config, [str(data)], tmp_path / "mine", [0], NAMES)
    with pytest.raises(DataError, match="two data sets"):
        compare(config, [str(data), str(data)], tmp_path / "new", [0], NAMES)
    with pytest.raises(DataError, match="no scheduler answers"):
        compare(config, [str(data)], tmp_path / "new", [0], ("3dgs",), cluster="tcp://127.0.0.1:9")
    single = write_tiny_data(tmp_path / "single", n=1)
    with pytest.raises(DataError, match="no test views"):
        compare(config, [str(single)], tmp_path / "newer", [0], NAMES)


def test_a_worker_without_the_weights_of_lpips_says_so(comparison):
    out, _, _ = comparison
    with pytest.raises(DataError, match="lpips_vgg16.npz.*make lpips"):
        perform(Task("lpips", str(out / "tiny"), 0, NAMES), {})


@pytest.mark.slow
def test_methods_that_come_later_are_timed_with_the_others_and_rows_tell_their_seeds(comparison, data, tmp_path):
    out = Path(shutil.copytree(comparison[0], tmp_path / "out"))
    with without_processes():
        table = compare(TrainConfig("", **SETTINGS), [str(data)], out, [0, 1], ("opacity",))
    timed = json.loads((out / "tiny" / "seed_0" / "opacity" / "render_ms.json").read_text())
    assert timed["in_turn_with"] == sorted([*NAMES, "opacity"])
    rows = latex(table, "tiny").splitlines()
    assert any(row.startswith("opacity (2 seeds) &") for row in rows)
    assert any(row.startswith("DashGaussian (1 seed) &") for row in rows)


@pytest.mark.parametrize(("kind", "methods", "stop"), [("start", (), 17), ("train", ("ours",), 47)])
def test_a_task_that_was_cut_off_goes_on_and_ends_with_the_same_bits(
    comparison, tmp_path, monkeypatch, ordered, kind, methods, stop
):
    whole = comparison[0] / "tiny"
    (tmp_path / "seed_0").mkdir()
    shutil.copy(whole / "config.json", tmp_path)
    if kind == "train":
        shutil.copy(whole / "seed_0" / "start.npz", tmp_path / "seed_0")
    task, step, steps = Task(kind, str(tmp_path), 0, methods), Trainer.step, []

    def count(trainer):
        steps.append(trainer.step_count)
        if steps == [*range(steps[0], stop)]:
            raise KeyboardInterrupt
        return step(trainer)

    monkeypatch.setattr(Checkpoints, "due", lambda self: True)
    monkeypatch.setattr(Trainer, "step", count)
    with pytest.raises(KeyboardInterrupt):
        perform(task, {})
    assert not task.done
    perform(task, {})
    assert task.done and steps.count(stop - 1) == 2 and len(set(steps)) == len(steps) - 1
    if kind == "train":
        models = [folder / "seed_0" / "ours" / "point_cloud.ply" for folder in (whole, tmp_path)]
        assert models[0].read_bytes() == models[1].read_bytes()
    else:
        once, again = (load_checkpoint(folder / "seed_0" / "start.npz") for folder in (whole, tmp_path))
        assert all(np.array_equal(once[name], again[name]) for name in once if name != "seconds")
        rows = (tmp_path / "seed_0" / "start" / "history.jsonl").read_text().splitlines()
        assert [json.loads(row)["step"] for row in rows][-1] == 30


@pytest.mark.slow
def test_the_process_of_a_task_ends_when_whoever_started_it_is_killed(comparison, tmp_path):
    out, _, _ = comparison
    settings = json.loads((out / "tiny" / "config.json").read_text()) | {"steps": 10**7, "log_every": 10**6}
    (tmp_path / "config.json").write_text(json.dumps(settings))
    program = "from mi_dogsplat.compare.execute import Means, in_a_process\n"
    program += "from mi_dogsplat.compare.tasks import Task\n"
    program += f"in_a_process(Task('start', {str(tmp_path)!r}, 0), Means())"
    with subprocess.Popen([sys.executable, "-c", program], cwd=Path(__file__).parents[2]) as parent:
        children: list[psutil.Process] = []
        while not children and parent.poll() is None:
            children = psutil.Process(parent.pid).children()
            time.sleep(0.05)
        time.sleep(1)  # it has begun
        parent.kill()
    try:
        assert children and not psutil.wait_procs(children, timeout=300)[1]
    finally:
        for child in children:
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()


def test_lpips_comes_with_its_weights_also_to_runs_that_are_complete(comparison, data, tmp_path, monkeypatch):
    out, table, _ = comparison
    assert "lpips" in COLUMNS and "LPIPS" not in latex(table, "tiny")
    out = Path(shutil.copytree(out, tmp_path / "out"))
    install(tmp_path / "cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    lines: list[str] = []
    with without_processes():
        table = compare(TrainConfig("", **SETTINGS), [str(data)], out, [0], NAMES, progress=lines.append)
    assert [line.split(": ")[1] for line in lines] == ["render times", "LPIPS"] and "LPIPS" in latex(table, "tiny")
    for name in NAMES:
        run = out / "tiny" / "seed_0" / name
        pairs = [
            [np.asarray(Image.open(run / "test" / f"{view}{end}.png"), float) / 255 for end in ("", "_gt")]
            for view in json.loads((run / "metrics.json").read_text())["views"]
        ]
        expected = np.mean([Lpips(small_weights())(*pair) for pair in pairs])
        assert table["methods"][name]["data"]["tiny"]["runs"]["0"]["lpips"] == pytest.approx(expected, rel=1e-5)
    assert [t.kind for t in tasks_of(out / "tiny", [0], NAMES) if not t.done] == ["time"]


def test_lpips_looks_at_what_the_masks_of_the_comparison_leave(comparison, tmp_path, monkeypatch):
    install(tmp_path / "cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder, run = tmp_path / "tiny", tmp_path / "tiny" / "seed_0" / "3dgs"
    shutil.copytree(comparison[0] / "tiny" / "seed_0" / "3dgs", run)
    settings = json.loads((comparison[0] / "tiny" / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps(settings | {"masks": str(tmp_path)}))
    (view,) = json.loads((run / "metrics.json").read_text())["views"]
    mask = np.zeros((HEIGHT, WIDTH), np.float32)
    mask[:, WIDTH // 3 :] = 1
    Image.fromarray((255 * mask).astype(np.uint8)).save(tmp_path / f"{view}.png")
    perform(Task("lpips", str(folder), 0, ("3dgs",)), {})
    picture, truth = (np.asarray(Image.open(run / "test" / f"{view}{end}.png"), float) / 255 for end in ("", "_gt"))
    expected = Lpips(small_weights())(np.where(mask[..., None] > 0, picture, truth), truth, mask)
    assert json.loads((run / "lpips.json").read_text())["lpips"] == pytest.approx(expected, rel=1e-5)


@pytest.mark.slow
def test_workers_on_this_machine_do_the_same(comparison, data, tmp_path):
    """Their start is there already: test_compare_tasks.py has workers make one."""
    out = tmp_path / "out"
    out.mkdir()
    shutil.copy(comparison[0] / "comparison.json", out)
    (out / "tiny" / "seed_0").mkdir(parents=True)
    for file in ("config.json", "seed_0/start.npz"):
        shutil.copy(comparison[0] / "tiny" / file, out / "tiny" / file)
    table = compare(TrainConfig("", **SETTINGS), [str(data)], out, [0], ("3dgs",), workers=2)
    again, first = (t["methods"]["3dgs"]["data"]["tiny"]["runs"]["0"] for t in (table, comparison[1]))
    assert again["psnr"] == pytest.approx(first["psnr"], abs=1e-3) and not table["failed"]
