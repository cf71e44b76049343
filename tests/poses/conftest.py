"""A room whose exact cameras are known, photographed and filmed; made once for all tests."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from posed_room import write_room
from shared_folder import unchanged_folder


@pytest.fixture(autouse=True)
def _extra():
    for package in ("pycolmap", "av"):
        pytest.importorskip(package, reason=f"needs {package}: pip install 'mi_dogsplat[poses]'")


@pytest.fixture(scope="session")
def room(tmp_path_factory) -> Iterator[Path]:
    """The folder of ``write_room``; no test writes to it."""
    yield from unchanged_folder(tmp_path_factory.getbasetemp(), "room", write_room)


@pytest.fixture(scope="session")
def pixels(room) -> list[np.ndarray]:
    """The pictures of the room, uint8 [H, W, 3] each."""
    return [np.asarray(Image.open(path)) for path in sorted((room / "pictures").iterdir())]
