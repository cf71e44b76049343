"""How a command ends: stopped by signals, with a bug, without anybody who reads, in a process of its own."""

import os
import signal
import subprocess
import sys
from io import BytesIO, TextIOWrapper
from pathlib import Path

import mitsuba as mi
import pytest
from command_line import run
from mi_dogsplat.cli import main
from mi_dogsplat.cli.errors import one_line_errors, quiet_pipe, resumable
from mi_dogsplat.runs.resume import require_no_stopped_run
from scene_files import scene_file

SHORT = ["--preset", "3dgs", "--steps", "12", "--variant", "llvm_ad_rgb"]


def test_ctrl_c_stops_with_one_line_and_status_130(capsys, data, tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("mi_dogsplat.training.strategy.densify.Densification.after_step", stopped)
    status, _, err = run(capsys, "train", data, "-o", tmp_path / "run", *SHORT)
    assert status == 130 and err.splitlines()[-1].startswith("dogsplat: stopped") and "Traceback" not in err
    assert (tmp_path / "run" / "history.jsonl").read_text() == ""
    assert not list((tmp_path / "run").rglob(".*"))


@pytest.mark.parametrize("command", ["train", "prune"])
def test_what_a_stopped_training_has_done_is_not_lost_to_a_new_one(capsys, model, data, tmp_path, command):
    checkpoint = tmp_path / "run" / "checkpoint" / "state.npz"
    checkpoint.parent.mkdir(parents=True)
    checkpoint.touch()
    words = [command, *([model] if command == "prune" else []), data, "-o", tmp_path / "run"]
    status, _, err = run(capsys, *words, "--variant", "llvm_ad_rgb")
    assert status == 2 and err.count("\n") == 1 and "--resume" in err and "checkpoint/" in err
    (tmp_path / "run" / "metrics.json").write_text("{}")
    require_no_stopped_run(tmp_path / "run")  # it came to its end


@pytest.mark.parametrize("kind", [RuntimeError, SystemError])
def test_ctrl_c_within_a_render_or_an_import_by_mitsuba_is_one_line_too(capsys, kind):
    def stopped():
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise kind("what Dr.Jit, or Python, makes of it") from error

    assert one_line_errors(stopped) == 130
    assert capsys.readouterr().err == "dogsplat: stopped before the end; nothing is half-written\n"


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("command", ["export", "simplify", "clean", "mesh", "check", "render", "eval", "masks"])
def test_a_command_that_is_stopped_says_so_and_leaves_nothing(
    capsys, model, data, tmp_path, monkeypatch, command, number
):
    flags = {
        "export": ["-o", tmp_path / "a.spz"],
        "simplify": ["-o", tmp_path / "a.ply", "--target", 8, "--steps", 3, "--views", 4, "--size", 32, 24],
        "clean": ["-o", tmp_path / "a.ply"],
        "mesh": ["-o", tmp_path / "a.ply", "--views", 4, "--size", 32, 24, "--min-faces", 1],
        "check": ["-o", tmp_path, "--only", "work-precision", "--data", data, "--rounds", 1],
        "render": ["-o", tmp_path / "a.png"],
        "eval": [data, "-o", tmp_path],
        "masks": [data, "-o", tmp_path / "masks"],
    }
    monkeypatch.setattr("mi_dogsplat.check.run.synthetic_scenes", lambda _: [])
    monkeypatch.setattr("os.replace", lambda *_: signal.raise_signal(number))  # its first file is written, but hidden
    status, _, err = run(capsys, command, model, *flags[command])
    assert status == 128 + number
    assert err.splitlines()[-1] == "dogsplat: stopped before the end; nothing is half-written"
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


STARTED = """
import signal, sys

class Loading:  # of a package that the command stands on
    def find_spec(self, name, path=None, target=None):
        if name == "mitsuba" and "loading" in sys.argv:
            signal.raise_signal(signal.SIGINT)

sys.argv = sys.argv[1:]
sys.meta_path.insert(0, Loading())
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell may let this process ignore
from mi_dogsplat.cli import main
from mi_dogsplat.cli.commands import info
info.run = lambda args: signal.raise_signal(signal.SIGINT)
sys.exit(main(["info", "model.ply"]))
"""


@pytest.mark.parametrize("script, moment, status, last", [
    ("dogsplat", "loading", 130, None),
    ("program", "loading", 1, "KeyboardInterrupt"),
    ("dogsplat", "at work", 130, "dogsplat: stopped before the end; nothing is half-written"),
])  # fmt: skip
def test_ctrl_c_while_the_command_loads_its_packages_ends_it_quietly(script, moment, status, last):
    """Other programs get an exception for it, as of any import."""
    words = [sys.executable, "-c", STARTED, f"bin/{script}", moment]
    done = subprocess.run(words, cwd=Path(__file__).parents[2], capture_output=True, text=True)
    lines = done.stderr.splitlines() or [None]
    assert lines[-1] == last and (script == "program" or len(lines) == 1), done.stderr
    assert done.returncode in (status, -signal.SIGINT if script == "program" else status) and done.stdout == ""


def test_what_knows_better_how_it_goes_on_says_so(capsys):
    def search():
        with resumable():
            signal.raise_signal(signal.SIGTERM)

    assert one_line_errors(search) == 143
    assert capsys.readouterr().err == "dogsplat: stopped; the same command again goes on from here\n"


def test_signals_end_a_render_by_mitsuba_within_which_no_handler_begins_and_not_its_writing(
    tmp_path, monkeypatch, capsys
):
    actions, render = [], mi.render

    def note(*_, **__):
        actions.append([signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)])

    monkeypatch.setattr("mitsuba.render", lambda *scene, **settings: (note(), render(*scene, **settings)))
    monkeypatch.setattr("mi_dogsplat.render.render_files.write_png", note)
    assert run(capsys, "render", scene_file(tmp_path), "-o", tmp_path / "s.png")[0] == 0
    drawing, writing = actions
    assert drawing == [signal.SIG_DFL] * 2 and signal.SIG_DFL not in writing


def test_a_bug_is_not_dressed_up_as_bad_input(data, tmp_path, monkeypatch):
    def bug(*_):
        raise RuntimeError("a bug")

    monkeypatch.setattr("mi_dogsplat.training.strategy.densify.Densification.after_step", bug)
    with pytest.raises(RuntimeError, match="a bug"):
        main(["train", str(data), "-o", str(tmp_path / "run"), *SHORT])


def test_the_module_is_the_command_in_a_process_of_its_own(model, tmp_path):
    command = [sys.executable, "-m", "mi_dogsplat"]
    folder = Path(__file__).parents[2]
    done = subprocess.run([*command, "info", model], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == "" and "60, 0 of them DoG" in done.stdout
    failed = subprocess.run(
        [*command, "render", tmp_path / "no.ply", "-o", tmp_path / "v.png"],
        cwd=folder, capture_output=True, text=True, env=os.environ,
    )  # fmt: skip
    assert failed.returncode == 2 and failed.stdout == "" and failed.stderr.count("\n") == 1


def test_output_that_nobody_reads_ends_the_command_quietly(model):
    reader, writer = os.pipe()
    os.close(reader)  # as `head -1` does when it has its line
    command = [sys.executable, "-m", "mi_dogsplat", "info", model]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert done.returncode == 141 and done.stderr == "", done  # 128 + SIGPIPE, as a shell reports of `yes | head`


@pytest.mark.skipif(os.name != "posix", reason="shells of other systems cannot close streams")
def test_a_command_whose_streams_are_closed_does_its_work(model, tmp_path):
    words = [sys.executable, "-m", "mi_dogsplat", "clean", str(model), "-o", str(tmp_path / "m.ply")]
    done = subprocess.run(["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *words], cwd=Path(__file__).parents[2])
    assert done.returncode == 0 and (tmp_path / "m.ply").exists()


def test_a_letter_that_the_output_lacks_is_an_escape(monkeypatch, model, tmp_path):
    path = tmp_path / "μ.ply"
    path.write_bytes(model.read_bytes())
    written = BytesIO()
    monkeypatch.setattr(sys, "stdout", TextIOWrapper(written, encoding="cp1252"))
    assert main(["info", str(path)]) == 0
    assert rb"\u03bc.ply: model" in written.getvalue()


def test_a_pipe_that_breaks_where_no_signal_is_named_so_ends_as_quietly(monkeypatch):
    """Windows has no SIGPIPE."""
    monkeypatch.delattr(signal, "SIGPIPE")
    monkeypatch.setattr(os, "dup2", lambda source, target: None)

    def broken() -> int:
        raise BrokenPipeError

    assert quiet_pipe(broken) == 141
