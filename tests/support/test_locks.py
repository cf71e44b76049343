"""One process at a time writes to a folder, and none is kept out by one that is dead."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.files import LOCK, is_empty
from mi_dogsplat.support.locks import locked

HOLD = """
import sys, time
from pathlib import Path
from mi_dogsplat.support.locks import locked
with locked(Path(sys.argv[1]), "taken"):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_folder_that_another_process_holds_is_refused_until_that_is_killed(tmp_path):
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]) as holder:
        try:
            assert holder.stdout and holder.stdout.readline() == "held\n"
            with pytest.raises(DataError, match="taken; wait for it, stop it"), locked(tmp_path, "taken"):
                pass
        finally:
            holder.send_signal(signal.SIGKILL)
    assert (tmp_path / LOCK).exists() and is_empty(tmp_path)  # what is left of it is no content
    with locked(tmp_path, "taken"):
        pass
    assert not list(tmp_path.iterdir())


def test_a_lock_is_free_again_after_an_error(tmp_path):
    with pytest.raises(ZeroDivisionError), locked(tmp_path, "taken"):
        raise ZeroDivisionError
    with locked(tmp_path, "taken"), pytest.raises(DataError, match="taken"), locked(tmp_path, "taken"):
        pass
    assert not list(tmp_path.iterdir())


def test_on_a_file_system_without_locks_nobody_is_kept_out(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl", reason="this system has no flock that could be missing")

    def without(descriptor, operation):
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr(fcntl, "flock", without)
    (tmp_path / LOCK).write_text("1\nanother machine\n")  # of a process that was killed there
    with locked(tmp_path, "taken"):
        (tmp_path / "written").write_text("something")


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path, monkeypatch):
    def refuse(path, *rest, **others):
        raise PermissionError(errno.EACCES, "Permission denied", path)

    monkeypatch.setattr(os, "open", refuse)  # as for another user; root may do anything
    with pytest.raises(DataError, match="Permission denied; name a folder"), locked(tmp_path, "taken"):
        pass
