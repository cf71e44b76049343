"""The model that is filmed."""

from pathlib import Path

import pytest
import tiny_data
from mi_dogsplat import write_ply


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.ply"
    write_ply(path, tiny_data.truth())
    return path
