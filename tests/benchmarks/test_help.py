"""Each experiment says what it takes, and ends with one line where it cannot."""

import importlib
import runpy
import sys

import pytest

from benchmarks.names import EXPERIMENTS, ROOM_OF

NAMES = sorted(name for names in EXPERIMENTS.values() for name in names)


@pytest.mark.parametrize("name", NAMES)
def test_an_experiment_explains_itself(name, capsys):
    with pytest.raises(SystemExit) as stop:
        importlib.import_module(f"benchmarks.{ROOM_OF[name]}.{name}").main(["--help"])
    assert not stop.value.code and f"usage: python -m benchmarks {name}" in capsys.readouterr().out


@pytest.mark.parametrize("flags", [["32"], ["wide", "24"], ["--size", "3"]])
def test_a_size_that_is_none_is_refused(flags, capsys):
    with pytest.raises(SystemExit) as stop:
        importlib.import_module("benchmarks.engine.loss").main(flags)
    assert stop.value.code == 2 and "python -m benchmarks loss: error: " in capsys.readouterr().err


def test_an_experiment_behind_a_flag_is_told_where_it_belongs(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--variant", "llvm_ad_rgb", "up"])
    with pytest.raises(SystemExit) as stop:
        runpy.run_module("benchmarks", run_name="__main__")
    assert stop.value.code == 2 and "up is an experiment, which comes first" in capsys.readouterr().err
