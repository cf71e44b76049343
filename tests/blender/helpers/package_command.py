"""The package as another process, and what it is told by those who neither wait nor watch."""

import json
import os
import subprocess

COMMAND = tuple(json.loads(os.environ["DOGSPLAT_COMMAND"]))


def by_package(script: str, *arguments: str):
    """What a script prints as JSON in the Python that has the package."""
    done = subprocess.run([COMMAND[0], "-c", script, *arguments], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def never(*_) -> bool:
    """Whether somebody wants a picture no more."""
    return False


def nothing(*_) -> None:
    """What is made of progress and previews."""
