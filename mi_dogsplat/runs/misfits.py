"""Training images that do not fit the model: found at the end of a training, with the likely cause of each.

``train/misfits.json`` holds the PSNR of the training views that were looked at, and what does not fit, the worst first;
beside it are ``NAME.png`` (the render), ``NAME_gt.png`` and ``NAME_error.png`` of each. The report shows them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from PIL import Image

from ..datasets.dataset import View
from ..datasets.masks import Masks
from ..measure.evaluate import measuring_bytes
from ..measure.metrics import color_corrected, psnr
from ..measure.misfit import explained, likely_cause, relative_sharpness, usual_shares
from ..render.picture import photograph
from ..report.run_folder import MISFITS
from ..support.files import write_json
from ..support.pictures import heat_map, write_png
from ..support.pipeline import pipelined

FEWEST = 5  # views that tell what is usual
PER_STEPS = 20  # training steps for each view that is looked at: a fiftieth of the time, or so
LEAST_VIEWS = 24
USUAL_VIEWS = 6  # that tell how much each cause explains in a view that fits
DEVIATIONS = 3.0  # robust ones, from the median
LEAST_PSNR = 1.5  # dB below the median, at least
LEAST_SHARPNESS = 0.7  # of a logarithm: a photograph of half of the fine detail of others
MAD = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
SIDE = 400  # longer side of the pictures, pixels
ERROR_FULL = 0.25  # mean absolute error of a pixel that is the palest in the picture

_Rendered = tuple[View, np.ndarray]
T = TypeVar("T")


@dataclass(frozen=True)
class Misfit:
    """A view that does not fit: ``cause`` as in ``measure/misfit.py``, empty where it is not clear.

    ``below``: dB under the median PSNR of all views; ``explained``: of its cause, beyond what is usual.
    """

    name: str
    psnr: float
    below: float
    cause: str
    explained: float


def find_misfits(
    picture: Callable[[View], np.ndarray], views: Sequence[View], background: float, masks: Masks | None = None,
    exposure: bool = False,
) -> tuple[dict[str, float], list[Misfit]]:  # fmt: skip
    """PSNR by view, and the views that do not fit, the worst first.

    Args:
        picture: renders a view, [H, W, 3], as its photograph is seen.
        views: training views, of which fewer than ``FEWEST`` tell nothing.
        background: grey level behind images with alpha.
        masks: pixels that they paint black do not count.
        exposure: each view was given colours of its own, so that those of the renders are corrected first.
    """

    def compared(some: Sequence[View], measure: Callable[[np.ndarray, np.ndarray, np.ndarray | None], T]) -> list[T]:
        """``measure`` of each view's render, photograph and mask; the next one is rendered meanwhile."""

        def of_one(rendered: _Rendered) -> T:
            view, image = rendered
            mask, truth = masks.of(view) if masks else None, photograph(view, background)
            image = np.clip(image, 0, 1)
            return measure(np.asarray(color_corrected(image, truth, mask)) if exposure else image, truth, mask)

        return pipelined(of_one, ((view, picture(view)) for view in some), measuring_bytes(views))

    counted = {view.name: both for view, both in zip(views, compared(views, _fit), strict=True) if both}
    quality, sharpness = ({name: both[k] for name, both in counted.items()} for k in range(2))
    if len(quality) < FEWEST:
        return quality, []
    poor, blurred = _low(quality, LEAST_PSNR), _low(sharpness, LEAST_SHARPNESS)
    found = [view for view in views if view.name in poor | blurred]
    rest = [view for view in views if view.name in quality.keys() - poor - blurred]
    some = rest[:: max(1, len(rest) // USUAL_VIEWS)] if found else []
    usual = usual_shares(compared(some, explained))
    middle, misfits = float(np.median(list(quality.values()))), []
    for view, shares in zip(found, compared(found, explained), strict=True):
        cause = likely_cause(shares, usual) or ("blur" if view.name in blurred else "")
        beyond = max(0.0, shares[cause] - usual[cause]) if cause else 0.0
        misfits.append(Misfit(view.name, quality[view.name], middle - quality[view.name], cause, beyond))
    return quality, sorted(misfits, key=lambda misfit: -misfit.below)


def _fit(image: np.ndarray, truth: np.ndarray, mask: np.ndarray | None) -> tuple[float, float] | None:
    """PSNR and relative sharpness; None where no pixel counts."""
    if mask is not None and not mask.any():
        return None
    return float(psnr(image, truth, mask)), relative_sharpness(image, truth, mask)


def _low(values: dict[str, float], least: float) -> set[str]:
    """Names of those that are far below the median, by the spread of all or, where that is less, of the lower half:
    what is above has a long tail, as some views are easy."""
    middle = float(np.median(list(values.values())))
    away = np.array([middle - value for value in values.values()])
    spread = MAD * float(min(np.median(np.abs(away)), np.median(away[away >= 0])))
    return {name for name, value in values.items() if value < middle - max(least, DEVIATIONS * spread)}


def write_misfits(
    out: Path, picture: Callable[[View], np.ndarray], views: Sequence[View], steps: int, background: float,
    masks: Masks | None = None, exposure: bool = False,
) -> None:  # fmt: skip
    """Write what does not fit among the views of a training of ``steps`` steps, evenly chosen where there are many."""
    start = time.monotonic()
    count = min(len(views), max(LEAST_VIEWS, steps // PER_STEPS))
    some = [views[k * len(views) // count] for k in range(count)]
    quality, misfits = find_misfits(picture, some, background, masks, exposure)
    folder = out / Path(MISFITS).parent
    folder.mkdir(exist_ok=True)
    named = {view.name: view for view in some}

    def write(of: _Rendered) -> None:
        view, image = of
        render, truth = np.clip(image, 0, 1), photograph(view, background)
        error = heat_map(np.clip(np.abs(render - truth).mean(axis=2) / ERROR_FULL, 0, 1))
        for end, shown in (("", render), ("_gt", truth), ("_error", error)):
            write_png(folder / f"{view.name}{end}.png", _small(shown))

    poor = [named[misfit.name] for misfit in misfits]
    pipelined(write, ((view, picture(view)) for view in poor), measuring_bytes(poor))
    found = {misfit.name: asdict(misfit) for misfit in misfits}
    content = {"n_views": len(views), "fewest": FEWEST, "psnr": quality, "misfits": found}
    write_json(out / MISFITS, content | {"seconds": round(time.monotonic() - start, 3)})


def _small(image: np.ndarray) -> np.ndarray:
    pixels = Image.fromarray(np.rint(np.asarray(image)[..., :3] * 255).astype(np.uint8))
    pixels.thumbnail((SIDE, SIDE), Image.Resampling.LANCZOS)
    return np.asarray(pixels, np.float32) / 255
