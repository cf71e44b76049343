"""Each experiment says what it takes, and ends with one line where it cannot."""

import importlib
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.names import EXPERIMENTS, ROOM_OF

ROOT = Path(__file__).parents[2]
NAMES = sorted(name for names in EXPERIMENTS.values() for name in names)


@pytest.mark.parametrize("name", NAMES)
def test_an_experiment_explains_itself(name, capsys):
    with pytest.raises(SystemExit) as stop:
        importlib.import_module(f"benchmarks.{ROOM_OF[name]}.{name}").main(["--help"])
    assert not stop.value.code and f"usage: python -m benchmarks {name}" in capsys.readouterr().out


@pytest.mark.parametrize("flags", [["32"], ["wide", "24"], ["--size", "3"], ["0", "24"]])
def test_a_size_that_is_none_is_refused(flags, capsys):
    with pytest.raises(SystemExit) as stop:
        importlib.import_module("benchmarks.engine.loss").main(flags)
    assert stop.value.code == 2 and "python -m benchmarks loss: error: " in capsys.readouterr().err


def test_an_experiment_behind_a_flag_is_told_where_it_belongs(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--variant", "llvm_ad_rgb", "up"])
    with pytest.raises(SystemExit) as stop:
        runpy.run_module("benchmarks", run_name="__main__")
    assert stop.value.code == 2 and "up is an experiment, which comes first" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["slopes", "--rounds", "0"],
        ["million", "--primitives", "0"],
        ["dog_share", "--shares", "0", "-0.1"],
        ["dog_share", "--shares", "0", "2"],
        ["widths", "--contestants", "own", "mmx"],
        ["widths", "--contestants", "avx2:4,4"],
    ],
)
def test_numbers_and_names_that_are_none_are_refused(words, capsys):
    name, *flags = words
    with pytest.raises(SystemExit) as stop:
        importlib.import_module(f"benchmarks.{ROOM_OF[name]}.{name}").main(flags)
    told = capsys.readouterr().err.splitlines()[-1]
    assert stop.value.code == 2 and told.startswith(f"python -m benchmarks {name}: error: argument {flags[0]}: ")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["lean", "--variant", "fast"], 'python -m benchmarks: --variant: "fast" cannot be used; '),
        (["rays", "no.ply"], "python -m benchmarks rays: no.ply: cannot be read "),
        (["million", "--memory", "much", "--primitives", "9"], 'python -m benchmarks million: --memory: "much" is '),
    ],
)
def test_bad_input_is_one_line(words, line):
    command = [sys.executable, "-m", "benchmarks", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=100)
    told = done.stderr.splitlines()
    assert done.returncode == 2 and len(told) == 1 and told[0].startswith(line), done.stderr
