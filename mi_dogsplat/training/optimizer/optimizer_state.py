"""The state of an optimizer on the host: the parameters in Adam, as a checkpoint holds them."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import mitsuba as mi
import numpy as np

from .adam import forget, restore_entry, saved_entry
from .group_rows import SPARSE_ROW_SIZE, check_groups
from .sh_rows import SH_INDEX, check_bands, row_sizes

BANDS = ("sh_rest", *SH_INDEX)  # what may hold view-dependent colour


def saved_parameters(adam: mi.ad.Adam, other_rates: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Values, both moments, step counts and rates, of which ``other_rates`` are those before any factor."""
    saved: dict[str, np.ndarray] = {}
    for name in adam:
        saved |= saved_entry(adam, name)
    return saved | {f"{name}.rate": np.array(rate) for name, rate in other_rates.items()}


def restore_parameters(
    adam: mi.ad.Adam, row_size: dict[str, int], bands: Collection[str], saved: Mapping[str, np.ndarray]
) -> dict[str, float]:
    """Put into ``adam`` what ``saved_parameters`` gave, and sizes of rows into ``row_size``.

    Args:
        bands: names of what holds view-dependent colour so far.

    Returns: rates of what is no parameter of a primitive that renders read.

    Raises ``ValueError`` when it is incomplete, of another SH degree, or has a value that is not finite.
    """
    n = np.size(saved.get("logit_opacities", ()))
    names = [name for name in row_size if name not in (*BANDS, *SPARSE_ROW_SIZE)]  # that every model has
    _require_rows(saved, {name: row_size[name] for name in names}, n)
    check_groups(saved)
    check_bands(saved, {name: row_size[name] for name in bands}, n)

    new_bands = row_sizes({name: saved[name] for name in BANDS if name in saved}, n)
    known = {*names, *new_bands, *SPARSE_ROW_SIZE}
    learned = [name for name in saved if f"{name}.rate" in saved and name not in known]
    for name in list(adam):
        forget(adam, name)
    for name in [name for name in BANDS if name not in new_bands]:
        row_size.pop(name, None)
    row_size |= new_bands | SPARSE_ROW_SIZE | dict.fromkeys(learned, 1)
    for name in [name for name in row_size if name in saved]:
        restore_entry(adam, name, saved)
    return {name: float(saved[f"{name}.rate"]) for name in learned}


def _require_rows(saved: Mapping[str, np.ndarray], sizes: Mapping[str, int], n: int) -> None:
    """All is finite, and there are ``n`` rows of these sizes. Raises ``ValueError``."""
    not_finite = [name for name, values in saved.items() if not np.isfinite(values).all()]
    if not_finite:
        raise ValueError(f"SplatOptimizer.restore: {not_finite[0]} of the state is not finite")
    wrong = [name for name, size in sizes.items() if np.size(saved.get(name, ())) != n * size]
    if n == 0 or wrong:
        raise ValueError(f"SplatOptimizer.restore: {wrong or 'logit_opacities'} of the state is missing rows")
