"""A process that writes one file again and again until it is killed; it imports little, to be there soon."""

from pathlib import Path

import numpy as np
from mi_dogsplat.runs.checkpoint import save_checkpoint


def write_for_ever(path: Path) -> None:
    """Each version of the checkpoint holds one number, in both of its arrays."""
    for i in range(10**9):
        save_checkpoint(path, {"a": np.full(20_000, i), "n": np.array(i)})
