"""What ``make`` sets up: a demo less than the tests, and one line where the network is missing."""

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
    """scripts/setup_venv.sh with an environment whose pip installs nothing."""
    python = folder / "bin" / "python"
    python.parent.mkdir()
    python.write_text(f"#!/bin/sh\ncase $* in *install*) cat >&2 <<'END'\n{said}\nEND\nexit 1;; esac\n")
    python.chmod(0o755)
    command = [str(ROOT / "scripts" / "setup_venv.sh"), "python3", str(folder), "train"]
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
    assert [line.split()[-1] for line in lines if line.startswith("scripts/setup_venv.sh")] == installed
