"""Whoever stops a comparison loses nothing: what runs saves first."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from happenings import history_of
from mi_dogsplat.compare.cluster import local_options
from mi_dogsplat.compare.compare import compare
from mi_dogsplat.compare.execute import Means, in_a_process
from mi_dogsplat.compare.tasks import Task
from mi_dogsplat.runs.checkpoint import load_checkpoint
from mi_dogsplat.training.config import TrainConfig

ROOT = Path(__file__).parents[2]
ENDLESS = {"steps": 10**7, "sh_degree": 1, "log_every": 10, "checkpoint_seconds": 10.0**6}
SECONDS = 300  # of a machine that does much else
# A shell that starts the tests in the background has them ignore SIGINT, and whatever they start
LISTENING = """import os, signal, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


def trains(folder: Path) -> bool:
    history = folder / "seed_0" / "start" / "history.jsonl"
    return history.exists() and history.stat().st_size > 0


def saved_step(folder: Path) -> int:
    return int(load_checkpoint(folder / "seed_0" / "start" / "checkpoint" / "state.npz")["step"])


def saves_when_asked(task: Task, means: Means, asked) -> str | None:
    """In place of a process: that of the first seed fails at once, and any other one has no end of its own."""
    if task.seed == 0:
        return "failed"
    while not asked():
        time.sleep(0.01)
    (Path(task.folder) / "saved").touch()
    return "stopped"


@contextmanager
def workers_in_threads(*_):
    from distributed import Client, LocalCluster

    options: dict[str, Any] = local_options(1) | {"threads_per_worker": 2, "processes": False}
    with LocalCluster(**options) as cluster:
        with Client(cluster) as client:
            yield client


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there a process cannot be sent SIGTERM, only be ended")
@pytest.mark.parametrize(
    "name, to_the_group, workers", [("SIGTERM", False, 0), ("SIGINT", True, 0), ("SIGINT", True, 1)]
)
def test_a_signal_to_the_command_lets_the_run_save_first(data, tmp_path, name, to_the_group, workers):
    """Ctrl-C in a terminal goes to all processes of a group, Dask's workers among them."""
    arguments = ["compare", str(data), "-o", str(tmp_path / "out"), "--only", "3dgs", "--workers", str(workers)]
    for setting, value in ENDLESS.items():
        arguments += [f"--{setting.replace('_', '-')}", f"{value:.0f}"]
    command = [sys.executable, "-c", LISTENING, "-m", "mi_dogsplat", *arguments]
    folder, number = tmp_path / "out" / data.name, signal.Signals[name]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        try:
            last = time.monotonic() + SECONDS
            while not trains(folder) and process.poll() is None and time.monotonic() < last:
                time.sleep(0.05)
            (os.killpg if to_the_group else os.kill)(process.pid, number)
            _, errors = process.communicate(timeout=SECONDS)
        finally:
            process.kill()
    assert process.returncode == 128 + number, errors
    assert errors.splitlines()[-1] == "dogsplat: stopped; the same command again goes on from here"
    assert saved_step(folder) >= history_of(folder / "seed_0" / "start")[-1]["step"] >= 10
    assert not list(folder.rglob("*.log"))


def test_a_task_of_a_worker_that_is_asked_to_stop_saves_first(data, tmp_path):
    settings = {k: v for k, v in vars(TrainConfig(str(data), **ENDLESS)).items() if k not in ("preset", "seed")}
    del settings["checkpoint_seconds"], settings["memory"]
    (tmp_path / "config.json").write_text(json.dumps(settings))
    stop, last = threading.Event(), time.monotonic() + SECONDS

    def asked() -> bool:
        if trains(tmp_path) or time.monotonic() > last:
            stop.set()
        return stop.is_set()

    error = in_a_process(
        Task("start", str(tmp_path), 0), Means(free={"checkpoint_seconds": 1e6, "memory": None}), asked
    )
    assert error == "stopped" and saved_step(tmp_path) >= history_of(tmp_path / "seed_0" / "start")[-1]["step"] >= 10
    assert not (tmp_path / "seed_0" / "start.log").exists()


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_runs_of_workers_save_first_if_tables_are_what_is_interrupted(data, tmp_path, monkeypatch, error):
    def interrupted(line: str) -> None:
        raise error

    for name, value in {"compare.cluster_client": workers_in_threads, "cluster.in_a_process": saves_when_asked}.items():
        monkeypatch.setattr(f"mi_dogsplat.compare.{name}", value)
    monkeypatch.setattr("mi_dogsplat.compare.compare.all_tasks", lambda folders, seeds, *_: [
        Task("start", str(folders[0]), seed) for seed in seeds])
    config = TrainConfig("", preset="3dgs", steps=60)
    with pytest.raises(error):
        compare(config, [str(data)], tmp_path / "out", [0, 1], ("3dgs",), workers=2, progress=interrupted)
    assert (tmp_path / "out" / data.name / "saved").exists()
