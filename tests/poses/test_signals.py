"""What pycolmap does to the signals of the process that imports it."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

STOPPED = """
import signal
from mi_dogsplat.cli.errors import one_line_errors, resumable
from mi_dogsplat.poses.colmap_database import pycolmap_module

def search():
    with resumable():
        pycolmap_module(gpu=False)
        signal.raise_signal(signal.SIGTERM)

raise SystemExit(one_line_errors(search))
"""


def test_a_search_for_poses_that_is_stopped_by_sigterm_ends_with_one_line():
    stopped = subprocess.run([sys.executable, "-c", STOPPED], cwd=ROOT, capture_output=True, text=True, check=False)
    assert stopped.returncode == 143
    assert stopped.stderr == "dogsplat: stopped; the same command again goes on from here\n"
