"""A comparison as tasks: what they wait for, what all of them share, and workers of which one is killed."""

import json
import os
import shutil
import signal
import time
from dataclasses import replace
from typing import Any

import numpy as np
import psutil
import pytest
from hdr_data import write_hdr_data
from mi_dogsplat.compare import tasks as of_tasks
from mi_dogsplat.compare.cluster import local_options
from mi_dogsplat.compare.compare import compare
from mi_dogsplat.compare.execute import Means, in_a_process
from mi_dogsplat.compare.folders import claim
from mi_dogsplat.compare.method_runs import recipe_of
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.names import method_of
from mi_dogsplat.compare.tasks import Task, all_tasks, perform, tasks_of
from mi_dogsplat.runs.checkpoint import load_checkpoint, save_checkpoint
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.locks import locked
from mi_dogsplat.training.config import TrainConfig
from small_comparison import SETTINGS, without_processes


def test_without_its_start_a_run_fails_in_one_line(data, tmp_path):
    (tmp_path / "tiny").mkdir()
    settings = {k: v for k, v in vars(TrainConfig(str(data), steps=60)).items() if k not in ("preset", "seed")}
    (tmp_path / "tiny" / "config.json").write_text(json.dumps(settings))
    error = in_a_process(Task("train", str(tmp_path / "tiny"), 0, ("3dgs",)), Means())
    assert error and "there is no densified start" in error


def test_a_line_of_a_task_names_files_as_they_are_called_whatever_the_locale(data, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")  # that of some locales
    folder = tmp_path / "Zürich"
    folder.mkdir()
    settings = {k: v for k, v in vars(TrainConfig(str(data), steps=60)).items() if k not in ("preset", "seed")}
    (folder / "config.json").write_text(json.dumps(settings))
    error = in_a_process(Task("train", str(folder), 0, ("3dgs",)), Means())
    assert error and error.startswith(str(folder))


def test_a_target_that_the_start_does_not_reach_is_one_line(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"data": "", "steps": 60, "target": 1000}))
    save_checkpoint(tmp_path / "seed_0" / "start.npz", {"optimizer.logit_opacities": np.zeros(50)})
    for name, flag in (("ours", "--target"), ("ours@60", "--more-targets")):
        with pytest.raises(DataError, match=f"{flag}: the target of .* primitives is not below the 50 .*; choose"):
            perform(Task("train", str(tmp_path), 0, (name,)), {})


@pytest.mark.slow
def test_a_target_that_a_start_does_not_reach_is_told_once_before_any_run_begins(data, tmp_path):
    """The start is kept for another target."""
    settings: dict[str, Any] = {"preset": "3dgs", "steps": 12, "sh_degree": 0}
    out, names, lines = tmp_path / "out", ("3dgs", "opacity", "ours"), []
    above = TrainConfig("", **settings, target=10**6)
    with without_processes(told=True):
        table = compare(above, [str(data)], out, [0], names, targets=[0.5], progress=lines.append)
    problem = table["failed"].pop("tiny, seed 0: densified start")
    assert "--target: the target of 1,000,000 primitives is not below the " in problem and not table["failed"]
    assert len(lines) == 2 and not table["methods"]  # there are no render times either
    start = out / "tiny" / "seed_0" / "start.npz"
    before = start.stat().st_mtime_ns
    with without_processes(told=True):
        assert compare(above, [str(data)], out, [0], names)["failed"] == {"tiny, seed 0: densified start": problem}
        table = compare(replace(above, target=0.5), [str(data)], out, [0], ("3dgs",))
    assert list(table["methods"]) == ["3dgs"] and not table["failed"] and start.stat().st_mtime_ns == before
    with pytest.raises(DataError, match="holds runs with other settings"):
        compare(replace(above, target=0.25), [str(data)], out, [0], ("3dgs",))


@pytest.mark.slow
def test_a_baseline_meets_no_target(data, tmp_path):
    settings: dict[str, Any] = {"preset": "3dgs", "steps": 12, "sh_degree": 0, "target": 10**6}
    with without_processes():
        table = compare(TrainConfig("", **settings), [str(data)], tmp_path / "out", [0], ("3dgs",))
    assert list(table["methods"]) == ["3dgs"] and not table["failed"]


def test_tasks_wait_for_the_start_and_times_for_all_runs_of_the_same_data_and_seed(tmp_path):
    tasks = [t for name in "ab" for t in tasks_of(tmp_path / name, (0, 1), ("3dgs", "ours"))]
    assert len({task.name for task in tasks}) == len(tasks) == 16
    for task in tasks:
        needed = [other for other in tasks if task.needs(other)]
        assert all(other.seed_folder == task.seed_folder for other in needed)
        assert len(needed) == {"start": 0, "train": 1, "time": 3}[task.kind]
        assert all(tasks.index(other) < tasks.index(task) for other in needed)  # so that they can go in this order


def test_lpips_of_all_data_and_seeds_comes_last(tmp_path, monkeypatch):
    (tmp_path / "weights.npz").touch()
    monkeypatch.setattr(of_tasks, "weights_path", lambda: tmp_path / "weights.npz")
    tasks = all_tasks([tmp_path / "a", tmp_path / "b"], (0, 1), ("3dgs", "ours"))
    assert [task.kind for task in tasks] == 4 * ["start", "train", "train", "time"] + 4 * ["lpips"]
    assert all(tasks.index(other) < tasks.index(task) for task in tasks for other in tasks if task.needs(other))


def test_seeds_and_targets_that_are_given_twice_are_done_once(tmp_path):
    once = tasks_of(tmp_path, (1, 0), ("3dgs", "ours"), (0.05, 0.2))
    assert tasks_of(tmp_path, (1, 0, 1), ("3dgs", "ours"), (0.05, 0.2, 0.05)) == once
    assert len({task.log for task in once}) == len(once)


def test_runs_at_other_targets_are_measured_with_all_others(tmp_path, monkeypatch):
    """The tables of equal bytes and time show their LPIPS, too."""
    (tmp_path / "weights.npz").touch()
    monkeypatch.setattr("mi_dogsplat.compare.tasks.weights_path", lambda: tmp_path / "weights.npz")
    (lpips,) = [task for task in tasks_of(tmp_path, [0], ("3dgs", "ours"), (0.05,)) if task.kind == "lpips"]
    for name in ("3dgs", "ours", "ours@0.05", "paper@0.2"):  # the last one of an earlier call
        run = tmp_path / "seed_0" / name
        run.mkdir(parents=True)
        (run / "metrics.json").write_text("{}")
        (run / "recipe.json").write_text(json.dumps(recipe_of(METHODS[method_of(name)])))
    assert [run.name for run in lpips.complete] == ["3dgs", "ours", "ours@0.05", "paper@0.2"]
    for name in ("3dgs", "ours", "ours@0.05"):
        assert not lpips.done
        (tmp_path / "seed_0" / name / "lpips.json").write_text('{"lpips": 0.2}')
    assert lpips.done


def test_seeds_of_numpy_are_whole_numbers(data, tmp_path, monkeypatch):
    """As ``np.arange`` has them, which no JSON holds."""
    seen = []

    def nothing(tasks, means):
        seen.extend(tasks)
        yield from ()

    monkeypatch.setattr("mi_dogsplat.compare.compare.one_after_another", nothing)
    seeds: Any = np.arange(2)
    compare(TrainConfig("", **SETTINGS), [str(data)], tmp_path / "out", seeds, ("3dgs",))
    assert {json.dumps(task.seed) for task in seen} == {"0", "1"}


def test_two_comparisons_do_not_write_to_one_folder(data, tmp_path):
    (tmp_path / "out").mkdir()
    with locked(tmp_path / "out", "taken"), pytest.raises(DataError, match="another comparison is writing"):
        compare(TrainConfig("", **SETTINGS), [str(data)], tmp_path / "out", [0], ("3dgs",))
    assert not list((tmp_path / "out").iterdir())


def test_a_comparison_does_not_go_on_with_other_views(data, tmp_path, monkeypatch):
    """Its table would have runs that were measured on different photographs."""
    changed, out = tmp_path / data.name, tmp_path / "out"
    shutil.copytree(data, changed)
    monkeypatch.setattr("mi_dogsplat.compare.compare.one_after_another", lambda *_: (task for task in ()))
    config = TrainConfig("", **SETTINGS)
    for _ in range(2):
        compare(config, [str(changed)], out, [0], ("3dgs",))
    file = changed / "transforms.json"
    content = json.loads(file.read_text())
    file.write_text(json.dumps(content | {"frames": content["frames"][1:]}))
    with pytest.raises(DataError, match="holds runs on other views: .*; name another folder"):
        compare(config, [str(changed)], out, [0], ("3dgs",))


def test_a_comparison_removes_what_a_kill_left_in_its_folder_but_nothing_of_a_run(data, tmp_path):
    parts = [tmp_path / "out" / name / ".comparison.html.0123456789ab.part" for name in ("", "tiny/seed_0/3dgs")]
    for part in parts:
        part.parent.mkdir(parents=True, exist_ok=True)
        part.write_text("half a page")
    (tmp_path / "out" / "comparison.json").write_text("{}")
    with pytest.raises(DataError, match="other contents"):  # the data set of that run is not this one
        compare(TrainConfig("", **SETTINGS), [str(data)], tmp_path / "out", [0], ("3dgs",))
    assert [part.exists() for part in parts] == [False, True]


def test_the_memory_that_is_given_holds_for_every_task(data, tmp_path):
    config = replace(TrainConfig("", **SETTINGS), memory="1M")
    table = compare(config, [str(data)], tmp_path / "out", [0], ("3dgs",))
    assert "needs about" in table["failed"]["tiny, seed 0: densified start"]


@pytest.mark.slow
def test_neither_the_start_nor_a_method_depends_on_the_distance_of_rows_and_pages_do_without_curves(data, tmp_path):
    settings: dict[str, Any] = SETTINGS | {"log_every": 45, "test_every": 1000}
    with without_processes():
        table = compare(TrainConfig("", **settings), [str(data)], tmp_path / "out", [0], ("3dgs", "lp_3dgs"))
    start = load_checkpoint(tmp_path / "out" / "tiny" / "seed_0" / "start.npz")
    assert not table["failed"] and start["step"] == 30 and start["seconds"] > 0
    assert "Error against run time" in (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_on_two_workers_of_which_one_is_killed_all_runs_are_complete(data, tmp_path):
    """The worker dies while it performs a task: the process of the task goes too, and another worker does it again."""
    from distributed import Client, LocalCluster

    killed: list[psutil.Process] = []
    cluster: Any = LocalCluster(**local_options(2))
    with cluster:
        client: Any = Client(address := cluster.scheduler_address)
        with client:

            def kill_a_busy_worker(line: str) -> None:
                """As soon as the start is there and runs have begun."""
                deadline = time.monotonic() + 30
                while not killed and time.monotonic() < deadline:
                    busy = [psutil.Process(pid) for pid in client.run(os.getpid).values()]
                    runs = [(worker, worker.children()) for worker in busy if worker.children()]
                    if runs:
                        worker, children = runs[0]
                        killed.extend(children)
                        worker.send_signal(signal.SIGKILL)

            config, out = TrainConfig("", **SETTINGS), tmp_path / "out"
            names = ("3dgs", "opacity")
            table = compare(config, [str(data)], out, [0], names, cluster=address, progress=kill_a_busy_worker)
    assert killed
    gone, alive = psutil.wait_procs(killed, timeout=300)
    assert not alive
    assert list(table["methods"]) == list(names) and not table["failed"]
    for name in names:
        assert len((out / "tiny" / "seed_0" / name / "history.jsonl").read_text().splitlines()) >= 3


def test_pictures_of_a_comparison_are_exposed_as_its_runs_are(tmp_path, monkeypatch):
    """With and without DoG they were compared in the exposure that images have of themselves."""
    data, seen = write_hdr_data(tmp_path / "data"), []
    claim(tmp_path / "compared", TrainConfig(str(data), preset="3dgs", white=7.0))
    monkeypatch.setattr(of_tasks, "draw_in_turn", lambda dataset, *_: seen.append(dataset.white))
    perform(Task("time", str(tmp_path / "compared"), 0), {})
    assert seen == [7.0]
