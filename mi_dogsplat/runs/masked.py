"""What the masks of a training hide of its photographs: how much, and a sheet of them to look at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import View
from ..datasets.masks import Masks
from ..render.mask_sheet import mask_sheet
from ..render.picture import photograph
from ..report.run_folder import MASKED
from ..support.pictures import write_png


def write_masked(out: Path, views: Sequence[View], masks: Masks, background: float) -> dict[str, float]:
    """Write the photographs of which most is masked, with what is, into a run folder.

    Returns ``masked`` of ``metrics.json``: the share of the pixels of each training view that is masked, by its name.
    Raises ``DataError``.
    """
    shares = {view.name: float(_hidden(masks, view).mean()) for view in views}
    most = sorted((view for view in views if shares[view.name]), key=lambda view: -shares[view.name])
    shown = ((photograph(view, background), _hidden(masks, view), view.name) for view in most or views)
    write_png(out / MASKED, mask_sheet(shown))
    return shares


def _hidden(masks: Masks, view: View) -> NDArray[np.bool_]:
    """[H, W], what a mask paints black."""
    mask = masks.of(view)
    return np.zeros((view.camera.height, view.camera.width), bool) if mask is None else mask == 0
