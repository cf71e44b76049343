"""Arrays of the device as NumPy arrays, all that have one size by one kernel.

Read one by one, each is computed by a kernel of its own, which repeats what it shares with the others and has to be
compiled.
"""

from collections.abc import Iterable
from typing import Any

import drjit as dr
import numpy as np


def read(arrays: Iterable[Any]) -> list[np.ndarray]:
    arrays = list(arrays)
    dr.eval(arrays)
    return [array.numpy() for array in arrays]


def read_gradients(params: Any, names: Iterable[str], prefix: str = "") -> dict[str, np.ndarray]:
    """Of parameters by these names, which ``params`` knows with the prefix."""
    names = list(names)
    return dict(zip(names, read(dr.grad(params[f"{prefix}{name}"]) for name in names), strict=True))
