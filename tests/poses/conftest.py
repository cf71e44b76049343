"""A room whose exact cameras are known, photographed and filmed; made once for all tests."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from posed_room import write_room
from shared_folder import contents, shared_folder


@pytest.fixture(autouse=True)
def _extra():
    for package in ("pycolmap", "av"):
        pytest.importorskip(package, reason=f"needs {package}: pip install 'mi_dogsplat[poses]'")


@pytest.fixture(scope="session")
def room(tmp_path_factory) -> Iterator[Path]:
    """The folder of ``write_room``; no test writes to it."""
    base = tmp_path_factory.getbasetemp()
    folder = shared_folder(base.parent if base.name.startswith("popen") else base, "room", write_room)
    before = contents(folder)
    yield folder
    assert contents(folder) == before, "a test has changed the room; let it have a copy"


@pytest.fixture(scope="session")
def pixels(room) -> list[np.ndarray]:
    """The pictures of the room, uint8 [H, W, 3] each."""
    return [np.asarray(Image.open(path)) for path in sorted((room / "pictures").iterdir())]
