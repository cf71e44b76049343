"""Folders for what goes to the package and comes from it."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any


def own_folder(owner: Any) -> tuple[Path, Callable[[], Any]]:
    """A new temporary folder, and how to remove it, which is done with its owner at the latest."""
    folder = Path(tempfile.mkdtemp(prefix="dogsplat_"))
    return folder, weakref.finalize(owner, shutil.rmtree, folder, ignore_errors=True)
