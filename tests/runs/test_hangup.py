"""A terminal that is closed while a training writes to it: it saves, or goes on where nobody is to tell it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mi_dogsplat.cli.printing import say
from mi_dogsplat.cli.streams import discard, discard_unread
from mi_dogsplat.runs.checkpoint import CHECKPOINT, load_checkpoint
from mi_dogsplat.runs.stopping import Stopped, StopRequest, stop_signals, stopped_with

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no SIGHUP and no pseudo-terminals")
ROOT = Path(__file__).parents[2]
SECONDS = 300  # of a machine that does much else
# what starts the tests may ignore SIGHUP, and so would whatever they start
LISTENING = """import os, signal, sys
signal.signal(signal.SIGHUP, getattr(signal, sys.argv[1]))
os.execv(sys.executable, [sys.executable, *sys.argv[2:]])
"""


@pytest.fixture
def listening():
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def trained_until_its_terminal_is_closed(data: Path, out: Path, handler: str, steps: int) -> int:
    """Its status; the shell and the system tell of the end, once each."""
    master, slave = os.openpty()
    words = ["-m", "mi_dogsplat", "train", str(data), "-o", str(out), "--steps", str(steps), "--preset", "3dgs"]
    words += ["--sh-degree", "0", "--max-primitives", "80", "--log-every", "5", "--variant", "llvm_ad_rgb"]
    command = [sys.executable, "-c", LISTENING, handler, *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=slave, stderr=slave, start_new_session=True) as process:
        os.close(slave)
        try:
            os.set_blocking(master, False)
            last = time.monotonic() + SECONDS
            history = out / "history.jsonl"
            while not (history.exists() and history.stat().st_size) and process.poll() is None:
                assert time.monotonic() < last
                time.sleep(0.02)
            os.close(master)
            for _ in range(2):
                process.send_signal(signal.SIGHUP)
            return process.wait(SECONDS)
        finally:
            process.kill()


def test_a_training_whose_terminal_is_closed_saves_first(data, tmp_path):
    assert trained_until_its_terminal_is_closed(data, tmp_path / "run", "SIG_DFL", 10**6) == 128 + signal.SIGHUP
    rows = (tmp_path / "run" / "history.jsonl").read_text().splitlines()
    assert load_checkpoint(tmp_path / "run" / CHECKPOINT)["step"] >= json.loads(rows[-1])["step"] >= 5


def test_a_training_that_is_not_to_know_of_its_terminal_comes_to_its_end(data, tmp_path):
    """As under ``nohup``, or after ``disown``."""
    assert trained_until_its_terminal_is_closed(data, tmp_path / "run", "SIG_IGN", 60) == 0
    assert (tmp_path / "run" / "metrics.json").exists() and (tmp_path / "run" / "point_cloud.ply").exists()


def test_of_several_hangups_the_first_counts(listening):
    with StopRequest() as stop:
        for _ in range(2):
            signal.raise_signal(signal.SIGHUP)
        assert stop.signal_number == signal.SIGHUP
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    with pytest.raises(Stopped) as stopped, stopped_with("stopped"):
        try:
            signal.raise_signal(signal.SIGHUP)
        finally:
            signal.raise_signal(signal.SIGHUP)  # while something is put in order
    assert stopped.value.signal_number == signal.SIGHUP
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_DFL


def test_a_hangup_that_is_ignored_stays_so(listening):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    assert stop_signals() == (signal.SIGINT, signal.SIGTERM)
    with StopRequest() as stop, stopped_with("stopped"):
        signal.raise_signal(signal.SIGHUP)
    assert not stop.signal_number


def test_lines_that_nobody_reads_any_more_stop_no_work(monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        for line in ("one", "two"):
            say(line)


def test_a_full_disk_is_no_closed_terminal(monkeypatch):
    """What cannot be written there is an error, as of every file."""
    if not Path("/dev/full").exists():
        pytest.skip("only Linux has a device that is full")
    with open("/dev/full", "w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        with pytest.raises(OSError, match="No space left"):
            say("one")
        discard(stream)  # or closing it fails, too


def test_what_a_stream_still_holds_that_nobody_reads_is_gone(monkeypatch):
    reader, writer = os.pipe()
    with open(writer, "w", encoding="utf-8") as stream:
        print("held", file=stream)
        os.close(reader)
        monkeypatch.setattr(sys, "stdout", stream)
        discard_unread()
        stream.flush()
