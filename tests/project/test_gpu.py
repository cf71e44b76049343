"""scripts/gpu: what is run within which time, the report of it, and the bundle for a machine without network."""

import json
import os
import signal
import subprocess
import sys
import tarfile
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from scripts.gpu import bundle, report, results, unpack
from scripts.gpu.results import Result
from scripts.gpu.running import Running
from scripts.gpu.session import Session
from scripts.gpu.steps import CHECKS, PROBE, SCENES, Setup, Step, steps

ROOT = Path(__file__).parents[2]
MACHINE = {"gpu": "A GPU", "gpu_memory_mb": 81559, "driver": "580.1 (CUDA 13.0)", "processor": "A CPU", "cores": 16,
           "system": "Linux 6"}
PYTEST = """
[gw0] [ 25%] PASSED tests/engine/test_tiles.py::test_one
[gw1] [ 50%] FAILED tests/engine/test_view.py::test_two[a b]
[gw1] [ 75%] SKIPPED tests/scores/test_score.py::test_three
[gw1] [ 80%] ERROR tests/scores/test_score.py::test_four
=================================== FAILURES ===================================
E   PASSED tests/none.py::test_of_a_message
=========================== short test summary info ============================
FAILED tests/engine/test_view.py::test_two[a b] - assert
"""


@pytest.fixture(autouse=True)
def _short_grace(monkeypatch):
    """Whoever starts the tests in the background has them ignore SIGINT, and all that they start: that is killed."""
    monkeypatch.setattr("scripts.gpu.running.GRACE", 0.2)


def python(code: str, **settings) -> Step:
    common = {"name": "a", "title": "A step", "limit": 60, "least": 0, "command": [sys.executable, "-c", code]}
    return Step(**common | settings)


@pytest.fixture
def session(tmp_path) -> Session:
    known = {"machine": MACHINE, "versions": {"mitsuba": "3.9"}, "command": "run.sh", "commit": "abc", "steps": {}}
    return Session(tmp_path / "out", tmp_path / "work", time.time() + 1000, known, {})


def outcomes(session: Session) -> dict[str, str]:
    return {name: step["outcome"] for name, step in session.report["steps"].items()}


def test_a_step_that_fails_does_not_end_the_others(session, tmp_path):
    chosen = [
        python("print('well')", name="good"),
        python("raise SystemExit('broken')", name="bad"),
        python("raise SystemExit(2)", name="untold", untold=2),
        python("1", name="scenes", optix=True),
        python("1", name="behind", after="bad"),
        python("1", name="long", least=2000),
        python("print('last')", name="last"),
    ]
    session.run(chosen, optix=False)
    assert outcomes(session) == {
        "good": "passed", "bad": "failed", "untold": "not run", "scenes": "not run", "behind": "not run",
        "long": "not run", "last": "passed",
    }
    says = {name: step["says"] for name, step in session.report["steps"].items()}
    assert says["good"] == "well" and says["bad"] == "broken" and says["scenes"] == "no OptiX"
    assert says["behind"] == "bad did not pass" and says["long"] == "no time left"
    assert report.failed(session.report) == ["bad"]
    log = (tmp_path / "out" / "log.txt").read_text()
    assert "### good: python -c" in log and "### failed, status 1" in log and "broken" in log


def test_figures_of_an_earlier_call_are_not_told_as_those_of_one_that_fails(tmp_path, session):
    (step,) = (s for s in steps(Setup(tmp_path, None, 2, True, True), False) if s.name == "million")
    (tmp_path / "million.json").write_text('[{"forward, ms": 1}]')
    session.run([replace(step, command=[sys.executable, "-c", "raise SystemExit('broken')"])], optix=False)
    told = session.report["steps"]["million"]
    assert told["outcome"] == "failed" and told["rows"] == []


def test_what_is_late_is_asked_to_stop_and_then_killed_with_what_it_started(tmp_path):
    deaf = "import signal, subprocess, time; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    deaf += "print(subprocess.Popen(['sleep', '600']).pid, flush=True); time.sleep(600)"
    ended = Running([sys.executable, "-c", deaf], tmp_path / "log", 2.0, {}).wait()
    assert ended.late and ended.status == -signal.SIGKILL
    child = int((tmp_path / "log").read_text())
    deadline = time.monotonic() + 30
    while alive(child) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not alive(child)


def alive(pid: int) -> bool:
    """Whether a process runs; one that nobody has waited for yet does not."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_a_step_that_can_be_gone_on_with_is_stopped_and_one_that_cannot_has_failed(session):
    waiting = "import time; print('at work', flush=True); time.sleep(600)"
    session.run([python(waiting, name="training", limit=1, bounded=True), python(waiting, name="hangs", limit=1)], True)
    assert outcomes(session) == {"training": "stopped", "hangs": "timed out"}
    assert report.failed(session.report) == ["hangs"]


def test_what_runs_aside_has_ended_before_something_is_timed(session):
    aside = python("import time; time.sleep(.5); print(time.time())", name="aside", aside=True)
    timed = python("import time; print(time.time())", name="timed", alone=True)
    session.run([aside, python("1", name="beside"), timed], True)
    assert list(session.report["steps"]) == ["beside", "aside", "timed"]
    said = {name: step["says"] for name, step in session.report["steps"].items()}
    assert float(said["aside"]) < float(said["timed"])


def test_a_step_leaves_the_time_that_those_behind_it_need_at_least(tmp_path):
    known = {"machine": MACHINE, "command": "", "commit": "", "steps": {}}
    # "last" needs a half of its least at least: what "long" leaves, which may take 2 s and a little
    session = Session(tmp_path, tmp_path, time.time() + 22, known, {})
    waiting = python("import time; time.sleep(600)", name="long", limit=600, bounded=True)
    never = python("1", name="never", least=1000)  # nothing is kept for what does not fit at all
    session.run([waiting, never, python("1", name="last", least=20)], True)
    assert outcomes(session) == {"long": "stopped", "never": "not run", "last": "passed"}


def test_outcomes_of_tests_are_counted_also_of_a_run_that_was_stopped(tmp_path):
    log = tmp_path / "log"
    log.write_text(PYTEST)
    found = results.tests(log)
    assert found.says == "1 passed, 1 failed, 1 skipped, 1 error"
    assert found.failed == ["tests/engine/test_view.py::test_two[a", "tests/scores/test_score.py::test_four"]


def test_the_page_shows_machine_outcomes_and_figures(session):
    rows = [{"primitives": 1_000_000, "ms": 1.23456, "ratio": 98765.4}, {"primitives": 5, "note": "a|b"}]
    command = "python -m benchmarks renderers"
    session.note("renderers", "In several renderers", command, "passed", 61.04, Result("2 rows", rows))
    session.note("tests", "Tests", "pytest", "failed", 3.0, Result("1 failed", failed=["tests/a.py::test_b"]))
    page = report.markdown(session.report)
    assert page.startswith("## On a GPU: A GPU\n")
    assert "driver 580.1 (CUDA 13.0); A CPU, 16 cores" in page and "mitsuba 3.9" in page and "commit abc" in page
    assert "| `renderers` | passed | 61 | 2 rows |" in page
    assert "| primitives | ms | ratio | note |" in page
    assert "| 1,000,000 | 1.235 | 98,765 |  |" in page and "| 5 |  |  | a\\|b |" in page
    assert "- `tests/a.py::test_b`" in page
    assert report.failed(session.report) == ["tests"]


def test_a_report_is_kept_where_only_some_steps_run_again(session, tmp_path):
    session.note("training", "Training", "train", "stopped", 100.0, Result("at step 5"))
    session.note("tests", "Tests", "pytest", "passed", 3.0, Result("9 passed"))
    known = json.loads((tmp_path / "out" / "report.json").read_text())
    again = Session(tmp_path / "out", tmp_path / "work", time.time() + 100, known, {})
    again.note("training", "Training", "train", "passed", 50.0, Result("complete"))
    assert outcomes(again) == {"training": "passed", "tests": "passed"}
    assert "complete" in (tmp_path / "out" / "report.md").read_text()


def test_a_training_says_how_far_it_is_and_then_how_good(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"data": "data/fox", "preset": "ours", "steps": 30000}))
    (tmp_path / "history.jsonl").write_text(json.dumps({"step": 600, "seconds": 3.0, "n": 9000, "n_dog": 0}) + "\n")
    under_way = results.training(tmp_path, tmp_path / "log")
    assert "at step 600 of 30,000" in under_way.says and under_way.rows[0]["ms a step"] == pytest.approx(5)
    metrics = {"test": {"psnr": 31.5, "ssim": 0.9, "flip": 0.1}, "bytes": 2_700_000, "render_ms": 1.5}
    (tmp_path / "metrics.json").write_text(json.dumps(metrics))
    done = results.training(tmp_path, tmp_path / "log")
    assert done.says == "complete, 30,000 steps" and done.rows[0]["psnr"] == 31.5 and done.rows[0]["MB"] == 2.7


@pytest.mark.parametrize("quick", [False, True])
def test_photographs_can_be_compared_on_where_that_is_asked_for(tmp_path, quick):
    (tmp_path / "photographs" / "sparse").mkdir(parents=True)
    chosen = steps(Setup(tmp_path, tmp_path / "photographs", 4, True, quick), optix=True)
    assert [step.name for step in chosen if step.asked] == ["comparison"]
    assert not any(step.asked for step in steps(Setup(tmp_path, tmp_path, 4, True, quick), optix=True))


def test_a_comparison_tells_what_it_has_measured_so_far(tmp_path):
    log = tmp_path / "log"
    log.write_text("1/4 densified start: done\n")
    assert results.comparison(tmp_path, log).says == "1/4 densified start: done"
    names = "data,method,seed,n,megabytes,psnr,ssim,flip,lpips,train_seconds,peak_memory_mb"
    (tmp_path / "comparison.csv").write_text(f"{names}\nbonsai,3dgs_equal,0,600,0.15,10.5,0.13,0.58,,3.6,\n")
    (row,) = results.comparison(tmp_path, log).rows
    assert row["method"] == "3dgs_equal" and row["n"] == 600 and row["psnr"] == 10.5
    assert row["peak_memory_mb"] is None


@pytest.mark.parametrize("quick", [False, True])
def test_the_steps_name_what_is_there(tmp_path, quick):
    chosen = steps(Setup(tmp_path, None, 4, True, quick), optix=False)
    names = [step.name for step in chosen]
    assert len(set(names)) == len(names) and names[-2:] == ["capture", "training"]
    for step in chosen:
        files = [word for word in step.command if word.startswith("tests/") or word.endswith((".py", ".xml"))]
        assert all((ROOT / file).exists() for file in files), step.name
        assert step.least <= step.limit
    tests = next(step for step in chosen if step.name == "tests")
    assert not set(SCENES) & set(tests.command)
    rooms = "engine", "training", "training/strategy"
    assert quick or {f"tests/{room}" for room in rooms} < {str(Path(word).parent) for word in tests.command}
    assert sum(step.least for step in [PROBE, *chosen]) < 400  # of 10 minutes; the rest is for those that take more


def test_with_data_nothing_is_captured_and_a_run_that_is_there_goes_on(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.json").write_text("{}")
    chosen = steps(Setup(tmp_path, tmp_path / "set", 4, True, False), optix=True)
    assert chosen[-2].name != "capture"
    assert "--resume" in chosen[-1].command and str(tmp_path / "set") in chosen[-1].command
    assert "30000" in chosen[-1].command


@pytest.mark.skipif(not CHECKS.is_dir(), reason="../shared is not there, with the checks of the stand-in for CUDA")
def test_each_check_of_the_stand_in_is_a_step(tmp_path):
    names = [step.name for step in steps(Setup(tmp_path, None, 4, True, False), True) if step.name.startswith("check")]
    assert "check frozen_scores" in names and "check common" not in names


def test_without_a_gpu_it_ends_in_one_line_before_anything_is_installed(tmp_path):
    command = [str(ROOT / "scripts" / "gpu" / "run.sh")]
    environment = os.environ | {"PYTHON": sys.executable, "DRJIT_LIBCUDA_PATH": str(tmp_path / "no_driver.so")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "there is no GPU" in done.stderr


WHEEL = {
    "mitsuba/config.py": "code",
    "mitsuba/llvm_ad_rgb.cpython-312-x86_64-linux-gnu.so": "code",
    "mitsuba/llvm_ad_mono_polarized.cpython-312-x86_64-linux-gnu.so": "code",
    "mitsuba/cuda_ad_spectral_polarized.cpython-312-x86_64-linux-gnu.so": "code",
    "mitsuba/include/mitsuba/core.h": "code",
    "mitsuba/plugins/hair.so": "code",
    "mitsuba/plugins/path.so": "code",
    "mitsuba/__init__.pyi": "types",
    "scipy/spatial/_ckdtree.so": "code",
    "scipy/stats/_stats.so": "code",
    "numpy/testing/__init__.py": "code",
    "numpy/tests/test_a.py": "code",
}


@pytest.fixture
def packed(tmp_path) -> Path:
    wheel, out, data = tmp_path / "mitsuba-1-py3-none-any.whl", tmp_path / "bundle.tar.xz", tmp_path / "data"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, content in WHEEL.items():
            archive.writestr(name, content)
    (data / "images").mkdir(parents=True)
    (data / "images" / "0.png").write_bytes(b"picture")
    bundle.pack([wheel], data, out)
    return out


def test_a_bundle_holds_packages_without_what_no_step_needs_and_data(packed):
    with tarfile.open(packed) as archive:
        names = archive.getnames()
    assert names == [
        "bundle.json", "site/mitsuba/config.py", "site/mitsuba/llvm_ad_rgb.cpython-312-x86_64-linux-gnu.so",
        "site/mitsuba/plugins/path.so", "site/scipy/spatial/_ckdtree.so", "site/numpy/testing/__init__.py",
        "data/images/0.png",
    ]


def test_a_bundle_is_unpacked_once_and_only_for_its_python(packed, tmp_path, capsys, monkeypatch):
    folder = tmp_path / "unpacked"
    monkeypatch.setattr(sys, "version_info", (3, 12, 1, "final", 0))
    assert unpack.main(packed, folder) == 0 and (folder / "data" / "images" / "0.png").read_bytes() == b"picture"
    (folder / "data" / "images" / "0.png").unlink()
    assert unpack.main(packed, folder) == 0 and not (folder / "data" / "images" / "0.png").exists()
    monkeypatch.setattr(sys, "version_info", (3, 13, 0, "final", 0))
    assert unpack.main(packed, tmp_path / "other") == 2
    assert "is for Python 3.12, and this is 3.13" in capsys.readouterr().err


def test_what_is_no_bundle_is_refused_in_one_line(tmp_path, capsys):
    for content in (b"", b"no archive"):
        (tmp_path / "bundle.tar.xz").write_bytes(content)
        assert unpack.main(tmp_path / "bundle.tar.xz", tmp_path / "unpacked") == 2
    assert unpack.main(tmp_path / "missing.tar.xz", tmp_path / "unpacked") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3 and all("cannot be unpacked" in line for line in lines)
