"""The package as another process, and what it is told by those who neither wait nor watch."""

import json
import os
import signal
import subprocess

COMMAND = tuple(json.loads(os.environ["DOGSPLAT_COMMAND"]))
SECONDS = 600  # that a process may take: the longest takes some ten, and a busy machine may need many times as much


def by_package(script: str, *arguments: str, seconds: float = SECONDS):
    """What a script prints as JSON in the Python that has the package.

    Raises ``RuntimeError`` with what it said where it fails or does not end in time; then also with where it was.
    """
    command = [COMMAND[0], "-X", "faulthandler", "-c", script, *arguments]
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as process:
        try:
            answer, said = process.communicate(timeout=seconds)
            problem = f"status {process.returncode}" if process.returncode else None
        except subprocess.TimeoutExpired:
            answer, said = _ended(process)
            problem = f"no answer after {seconds} seconds"
    if problem is not None:
        raise RuntimeError(f"{problem} of the package, asked with {arguments}:\n{script}\nIt said:\n{answer}{said}")
    return json.loads(answer)


def _ended(process: subprocess.Popen) -> tuple[str, str]:
    """What a process says that is made to tell where its threads are, and to end."""
    process.send_signal(signal.SIGABRT)
    try:
        return process.communicate(timeout=30)
    except subprocess.TimeoutExpired:  # also where a child of it keeps the pipes
        process.kill()
        return "", "nothing that could be read"


def never(*_) -> bool:
    """Whether somebody wants a picture no more."""
    return False


def nothing(*_) -> None:
    """What is made of progress and previews."""
