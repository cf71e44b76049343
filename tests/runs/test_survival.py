"""Runs in processes of their own that are killed, interrupted, and out of disk: what is left opens, and goes on."""

import errno
import functools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from checkpoint_writer import write_for_ever
from mi_dogsplat import read_ply
from mi_dogsplat.report.run_folder import read_run
from mi_dogsplat.runs.checkpoint import load_checkpoint
from mi_dogsplat.runs.run import claimed
from mi_dogsplat.support.errors import DataError
from PIL import Image
from tiny_data import write_tiny_data

ROOT = Path(__file__).parents[2]
TRAIN = [sys.executable, "-m", "mi_dogsplat"]
# a checkpoint after each step, however slow the disk is: else a run may be done before its second one
OFTEN = [sys.executable, "-c", "from mi_dogsplat.runs import checkpoint; checkpoint.SHARE = float('inf'); "
         "from mi_dogsplat.cli import main; raise SystemExit(main())"]  # fmt: skip
SETTINGS = ["--preset", "3dgs", "--sh-degree", "1", "--max-primitives", "100", "--log-every", "10"]
SETTINGS += ["--checkpoint-seconds", "0", "--variant", "llvm_ad_rgb"]
CHECKPOINT = Path("checkpoint") / "state.npz"


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return write_tiny_data(tmp_path_factory.mktemp("with spaces and üñïçødé"))


def arguments(data: Path, out: Path, steps: int, *more: str) -> list[str]:
    return ["train", str(data), "-o", str(out), "--steps", str(steps), *SETTINGS, *more]


def run(*command: object, **options) -> subprocess.CompletedProcess:
    return subprocess.run([str(word) for word in command], cwd=ROOT, capture_output=True, text=True, **options)


def last_line(text: str) -> str:
    """The line that is left on a terminal, without the bar that was drawn over."""
    return text.splitlines()[-1]


def assert_every_file_opens(folder: Path) -> None:
    """Except for hidden ones: half-written files that the next start removes."""
    for path in (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")):
        match path.suffix:
            case ".json":
                assert isinstance(json.loads(path.read_text(encoding="utf-8")), dict)
            case ".npz":
                assert load_checkpoint(path)
            case ".ply":
                assert read_ply(path).n_splats
            case ".png":
                Image.open(path).load()
            case ".exr":
                assert path.read_bytes()[:4] == b"\x76\x2f\x31\x01" and path.stat().st_size > 1000
            case ".html":
                assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
            case ".jsonl":
                assert read_run(folder).broken_rows <= 1
            case _:
                raise AssertionError(f"what is {path}?")


def assert_whole(folder: Path, steps: int) -> None:
    """A complete run without remains, whose history has each step once."""
    assert_every_file_opens(folder)
    assert not [path for path in folder.rglob(".*")]
    result = read_run(folder)
    assert result.metrics and result.broken_rows == 0
    assert [row["step"] for row in result.history if "l1" in row] == list(range(10, steps + 1, 10))
    assert result.history[-1]["step"] == steps and (folder / "report.html").is_file()


@pytest.mark.slow
def test_a_run_that_is_killed_again_and_again_at_any_moment_comes_to_its_end(data, tmp_path):
    steps, out, chance = 1000, tmp_path / "a run", random.Random(0)
    reached = [0]
    for least in (None, chance.randint(1, 60), chance.randint(1, 60)):  # the first comes as it may, others in training
        more = ["--resume"] if (out / "config.json").exists() else []
        process = subprocess.Popen([*OFTEN, *arguments(data, out, steps, *more)], cwd=ROOT, stderr=subprocess.DEVNULL)
        while least and step_of(out) < reached[-1] + least and process.poll() is None:
            time.sleep(0.005)
        time.sleep(chance.uniform(0, 0.02 if least else 1.0))
        process.kill()
        process.wait()
        assert process.returncode == -signal.SIGKILL
        if out.exists():
            assert_every_file_opens(out)
        assert step_of(out) >= reached[-1] + (least or 0)
        reached.append(step_of(out))
    result = run(*TRAIN, *arguments(data, out, steps, "--resume"))
    assert result.returncode == 0, result.stderr
    assert_whole(out, steps)


def step_of(out: Path) -> int:
    """That of the checkpoint, 0 without one."""
    return int(load_checkpoint(out / CHECKPOINT)["step"]) if (out / CHECKPOINT).exists() else 0


@pytest.mark.slow
def test_a_run_that_is_killed_while_it_writes_a_file_keeps_the_old_one_and_goes_on(data, tmp_path):
    steps, out = 20, tmp_path / "run"
    for name in ("config.json", "state.npz", "metrics.json"):  # at the beginning, in training, and at the end
        more = ["--resume"] if (out / "config.json").exists() else []
        program = "-m", "tests.helpers.killed_while_writing"
        result = run(sys.executable, *program, name, *arguments(data, out, steps, *more))
        assert result.returncode == -signal.SIGKILL, (name, result.stderr)
        assert len([path for path in out.rglob(".*.part")]) == 1
        assert_every_file_opens(out)
    result = run(*TRAIN, *arguments(data, out, steps, "--resume"))
    assert result.returncode == 0, result.stderr
    assert_whole(out, steps)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_ctrl_c_saves_and_ends_with_one_line_that_says_how_to_go_on(data, tmp_path, number, status):
    steps, out = 100_000, tmp_path / "run"
    process = subprocess.Popen([*TRAIN, *arguments(data, out, steps)], cwd=ROOT, stderr=subprocess.PIPE, text=True)
    while not (out / CHECKPOINT).exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(number)
    _, err = process.communicate(timeout=300)
    assert process.returncode == status
    step = int(load_checkpoint(out / CHECKPOINT)["step"])
    assert last_line(err).startswith(f"dogsplat: stopped after step {step} of {steps}") and "--resume" in last_line(err)
    assert "Traceback" not in err
    assert_every_file_opens(out)
    assert all(row["step"] <= step for row in read_run(out).history)


def test_whoever_starts_a_training_stops_it_by_ending_its_input(data, tmp_path):
    """Without a signal; bytes mean nothing."""
    out = tmp_path / "run"
    command = [*TRAIN, *arguments(data, out, 100_000, "--until-input-ends")]
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdin
    print("?", file=process.stdin, flush=True)
    while not (out / CHECKPOINT).exists() and process.poll() is None:
        time.sleep(0.01)
    assert process.poll() is None
    _, err = process.communicate(timeout=300)
    assert process.returncode == 143 and "--resume" in last_line(err) and "Traceback" not in err
    assert_every_file_opens(out)


@functools.cache
def can_mount() -> bool:
    """Whether this machine lets us mount a disk in a namespace of our own."""
    return shutil.which("unshare") is not None and not run("unshare", "-rm", "true").returncode


def in_a_mount(options: str, folder: Path, command: list[str]) -> subprocess.CompletedProcess:
    """Run a command that sees a memory disk at ``folder``; what is on it afterwards is copied to ``folder``.copy."""
    if not can_mount():
        pytest.skip("this machine does not let us mount a disk in a namespace of our own (unshare -rm)")
    folder.mkdir()
    script = 'mount -t tmpfs -o "$1" tmpfs "$2" || exit 99; f=$2; shift 2; "$@"; s=$?; cp -a "$f" "$f.copy"; exit $s'
    return run("unshare", "-rm", "sh", "-c", script, "sh", options, folder, *command)


@pytest.mark.parametrize("kilobytes", [4, 24, 64, 128])  # from the first file on to the pictures of the end
def test_a_full_disk_is_one_line_and_what_is_there_opens(data, tmp_path, kilobytes):
    disk = tmp_path / "disk"
    result = in_a_mount(f"size={kilobytes}k", disk, [*TRAIN, *arguments(data, disk / "run", 20)])
    assert result.returncode == 2, result.stderr
    line = last_line(result.stderr)
    assert line.startswith(f"dogsplat: {disk}") and "No space left on device" in line
    assert "Traceback" not in result.stderr
    assert_every_file_opens(tmp_path / "disk.copy")
    assert not list((tmp_path / "disk.copy").rglob(".*.part"))


def test_a_folder_that_is_read_only_is_one_line(data, tmp_path):
    disk = tmp_path / "disk"
    result = in_a_mount("ro", disk, [*TRAIN, *arguments(data, disk / "run", 20)])
    assert result.returncode == 2 and result.stderr.count("\n") == 1
    assert result.stderr.startswith(f"dogsplat: {disk / 'run'}: Read-only file system; "), result.stderr


@pytest.mark.parametrize("checkpoint", [True, False])
@pytest.mark.parametrize("number", [errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_what_cannot_be_written_is_answered_with_what_helps(tmp_path, number, checkpoint):
    out = tmp_path / "run"
    (out / CHECKPOINT).parent.mkdir(parents=True)
    (out / "config.json").write_text("{}")
    if checkpoint:
        (out / CHECKPOINT).touch()
    with pytest.raises(DataError) as caught, claimed(out):
        raise OSError(number, os.strerror(number), str(out / "history.jsonl"))
    line = str(caught.value)
    assert line.startswith(f"{out / 'history.jsonl'}: cannot be written ({os.strerror(number)}); ")
    of_another = number in (errno.EACCES, errno.EPERM, errno.EROFS)
    assert ("name a folder that can be written" in line) == of_another
    assert ("make room" in line) == (not of_another)
    assert ("--resume goes on" in line) == (checkpoint and not of_another)


def test_a_file_is_whole_whenever_its_writer_is_killed(tmp_path, monkeypatch):
    """Thousands of versions of a file, one after the other; 20 kills."""
    path, chance = tmp_path / "state.npz", random.Random(1)
    writers = get_context("forkserver")  # one process imports all, and each writer begins as a copy of it
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # else it finds nothing to import, and says nothing
    writers.set_forkserver_preload(["checkpoint_writer"])
    for _ in range(20):
        path.unlink(missing_ok=True)
        process = writers.Process(target=write_for_ever, args=(path,), daemon=True)
        process.start()
        while not path.exists() and process.is_alive():
            time.sleep(0.001)
        time.sleep(chance.uniform(0, 0.05))
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
        state = load_checkpoint(path)
        assert (state["a"] == state["n"]).all() and np.size(state["a"]) == 20_000
