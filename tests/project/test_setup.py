"""What ``make`` sets up: a demo less than the tests, and one line where the network is missing."""

import os
import platform
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NO_NETWORK = """
WARNING: Retrying (Retry(total=0)) after connection broken by 'NewConnectionError(...)': /simple/hatchling/
ERROR: Could not find a version that satisfies the requirement hatchling (from versions: none)
ERROR: No matching distribution found for hatchling
"""
NO_SPACE = "ERROR: Could not install packages due to an OSError: No space left on device"


def set_up(folder: Path, said: str) -> subprocess.CompletedProcess:
    """scripts/setup/venv.sh with an environment whose pip installs nothing."""
    python = folder / "bin" / "python"
    python.parent.mkdir()
    python.write_text(f"#!/bin/sh\ncase $* in *install*) cat >&2 <<'END'\n{said}\nEND\nexit 1;; esac\n")
    python.chmod(0o755)
    command = [str(ROOT / "scripts" / "setup" / "venv.sh"), "python3", str(folder), "train"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_without_a_network_set_up_says_so_in_one_line(tmp_path):
    done = set_up(tmp_path, NO_NETWORK)
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "the package index cannot be reached" in done.stderr and "PIP_INDEX_URL" in done.stderr


def test_what_else_goes_wrong_is_said_by_pip(tmp_path):
    done = set_up(tmp_path, NO_SPACE)
    assert done.returncode == 1 and done.stderr.strip() == NO_SPACE


@pytest.mark.parametrize(("target", "installed"), [("demo", ["train"]), ("test", ["train", "train,export,view,dev"])])
def test_a_target_installs_what_it_needs(tmp_path, target, installed):
    command = ["make", "-n", target, f"VENV={tmp_path}/none", f"BLENDER={tmp_path}/other"]
    lines = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    assert [line.split()[-1] for line in lines if line.startswith("scripts/setup/venv.sh")] == installed


def run_cuda_tests(**environment: str) -> subprocess.CompletedProcess:
    """scripts/gpu/test_cuda.sh with a Python that says what it is given."""
    command = [str(ROOT / "scripts" / "gpu" / "test_cuda.sh"), "echo"]
    return subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=False)


@pytest.fixture
def standin(tmp_path) -> str:
    """A folder with a command that runs the one it is given."""
    run = tmp_path / "run"
    run.write_text('#!/bin/sh\nexec "$@"\n')
    run.chmod(0o755)
    return str(tmp_path)


def test_without_a_stand_in_for_cuda_its_tests_are_skipped_in_one_line(tmp_path):
    done = run_cuda_tests(CUDA_STANDIN=str(tmp_path / "none"))
    assert done.returncode == 0 and done.stdout.count("\n") == 1
    assert done.stdout.startswith("no tests of CUDA: there is no stand-in") and "CUDA_STANDIN=" in done.stdout


@pytest.mark.skipif(platform.system() != "Linux" or platform.machine() != "x86_64", reason="another line is said there")
@pytest.mark.parametrize("variable", ["CC", "CXX"])
def test_without_a_compiler_the_tests_of_cuda_are_skipped_in_one_line(standin, variable):
    done = run_cuda_tests(CUDA_STANDIN=standin, **{"CC": "true", "CXX": "true", variable: "no-such-compiler"})
    assert done.returncode == 0 and done.stdout.count("\n") == 1
    assert "needs the compiler no-such-compiler" in done.stdout


@pytest.mark.skipif(platform.system() != "Linux" or platform.machine() != "x86_64", reason="they are skipped there")
def test_the_tests_of_cuda_are_those_that_load_no_scene(standin):
    done = run_cuda_tests(CUDA_STANDIN=standin, CC="true", CXX="true")
    assert done.returncode == 0, done.stderr
    assert {"tests/scores", "tests/training", "tests/engine/test_tiles.py"} <= set(done.stdout.split())
    assert not {"tests/engine/test_aovs.py", "tests/plugin", "tests/plugin/test_dogpath.py"} & set(done.stdout.split())
