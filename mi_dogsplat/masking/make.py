"""Masks of what moved, or stood in the way, while a scene was photographed; behind ``dogsplat masks``."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..datasets import View, load_dataset
from ..datasets.images import box_downscale
from ..datasets.masks import Masks
from ..formats.read import read_model, require_primitives, require_writable
from ..render.mask_sheet import mask_sheet
from ..render.picture import background_color, photograph, picture_of, seen_as
from ..render.picture_options import PictureOptions
from ..scene.drawing import DrawnAs, drawn_as
from ..scene.splats import Splats
from ..support.arguments import checks_arguments
from ..support.errors import DataError, making
from ..support.files import is_empty
from ..support.pictures import write_png
from ..support.variants import require_arrays
from .errors import smooth_error
from .masks_config import MasksConfig
from .on_photograph import on_photograph
from .regions import unusual
from .usual import usual_errors

LONGEST = 400  # pixels of a side in which masks are looked for, about
ROUNDS = 2  # of which the second knows what the first has found


@dataclass(frozen=True)
class Found:
    """Which share of the pixels of each training view is masked, by its name."""

    shares: dict[str, float]

    @property
    def masked(self) -> dict[str, float]:
        """Those of which something is, the most masked first."""
        return {name: share for name, share in sorted(self.shares.items(), key=lambda item: -item[1]) if share}


@checks_arguments
def make_masks(
    model: str | Path,
    data: str | Path,
    out: str | Path,
    config: MasksConfig = MasksConfig(),
    preview: str | Path | None = None,
    options: PictureOptions = PictureOptions(),
    show: Callable[[int, int], None] = lambda done, n: None,
    split: str = "test",
) -> Found:
    """Write a mask for each training view: black where it differs from a model of the scene as others do not.

    Args:
        model: the model, of any format, trained on these photographs: a small one learns little of what moved.
        data: the data set. Masks of its test views are white, since nobody is to choose what these are measured by.
        out: the folder to write, with NAME.png for each view.
        config: from which error on, and masks that there are.
        preview: a .png to write, with the photographs that are masked most.
        options: how pictures are drawn; what they do not say, the model's file does.
        show: called with the number of photographs that are read, each of them once a round, and how many these are.
        split: of the data, "test" or "validation", as in the training of the model.

    Needs a Mitsuba variant. Raises ``DataError``.
    """
    require_arrays()
    out = Path(out)
    require_new(out)
    if preview and Path(preview).suffix.lower() != ".png":
        raise DataError(preview, "no known picture format", "name a file that ends in .png")
    if preview:
        require_writable(Path(preview))
    read = read_model(model)
    require_primitives(Path(model), read, "compare the photographs with")
    drawn = drawn_as(options.drawing, read.drawing)
    options.require_for(drawn.linear)
    dataset = load_dataset(data, options.shrink, on_disk=True, split=split)
    if options.white is not None and dataset.white is not None:
        dataset = dataset.exposed(options.white)
    background = background_color(options.background, dataset.has_alpha)
    given = Masks(config.masks, dataset.train) if config.masks else None
    search = _Search(read.splats, dataset.train, background, drawn.beside(dataset.white), config.times, given)
    for k in range(ROUNDS):
        search.round(lambda done, k=k: show(k * len(dataset.train) + done, ROUNDS * len(dataset.train)))
    nothing = [np.zeros((1, 1), bool) for _ in dataset.test]
    _write(out, dataset.views, [*search.found, *nothing], given)
    masked = {view.name: mask for view, mask in zip(dataset.train, search.masked, strict=True)}
    shares = {name: float(mask.mean()) for name, mask in masked.items()}
    if preview:
        most = [view for view in sorted(dataset.train, key=lambda view: -shares[view.name]) if shares[view.name]]
        shown = most or dataset.train
        write_png(preview, mask_sheet((photograph(view, background), masked[view.name], view.name) for view in shown))
    return Found(shares)


def require_new(out: Path) -> None:
    """Raise ``DataError`` for a folder of masks in whose place there is something."""
    if out.exists() and not (out.is_dir() and is_empty(out)):
        raise DataError(out, "exists, and is not an empty folder", "remove it, or name another folder")


def shrink_for(views: Sequence[View]) -> int:
    """By which the largest of some views becomes about as large as masks are looked for in."""
    longest = max(max(view.camera.width, view.camera.height) for view in views)
    return max(1, round(longest / LONGEST))


class _Search:
    """What is masked in each of some views, found in rounds: by what is left, the next knows better what is usual."""

    def __init__(
        self,
        splats: Splats,
        views: Sequence[View],
        background: float,
        drawn: DrawnAs,
        times: float,
        given: Masks | None,
    ):
        self.splats, self.views, self.background, self.drawn, self.times = splats, views, background, drawn, times
        self.steps = [shrink_for([view]) for view in views]
        self.cameras = [view.camera.downscaled(step) for view, step in zip(views, self.steps, strict=True)]
        self.given = [self._given(given, k) for k in range(len(views))]
        self.found = [np.zeros_like(given) for given in self.given]

    @property
    def masked(self) -> list[NDArray[np.bool_]]:
        """Of each view [h, w], what masks that there are hide, or what is found."""
        return [given | found for given, found in zip(self.given, self.found, strict=True)]

    def _given(self, given: Masks | None, k: int) -> NDArray[np.bool_]:
        """What the masks that there are paint black in a view [h, w]."""
        mask = given.of(self.views[k]) if given else None
        if mask is None:
            return np.zeros((self.cameras[k].height, self.cameras[k].width), bool)
        return box_downscale(mask[..., None], self.steps[k])[..., 0] < 0.5

    def round(self, show: Callable[[int], None]) -> None:
        """Look for what is wrong beyond what is usual; what was masked until now has no say in what that is."""
        picture = picture_of(self.splats, self.background, self.drawn)
        counts = [~masked for masked in self.masked]
        errors = []
        for k, view in enumerate(self.views):
            view = view.in_memory()
            pair = seen_as(picture(view.camera), view), photograph(view, self.background)
            render, truth = (box_downscale(image, self.steps[k]) for image in pair)
            errors.append(smooth_error(render, truth, counts[k], ~self.given[k]))
            show(k + 1)
        usual = usual_errors(self.splats, self.cameras, self.drawn, errors, counts)
        self.found = [unusual(error, X, self.times) for error, X in zip(errors, usual, strict=True)]


def _write(out: Path, views: Sequence[View], found: Sequence[NDArray[np.bool_]], given: Masks | None) -> None:
    """A folder with a mask for each view, whole or not at all; masks that are ``given`` keep all of their pixels."""
    with making(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as part:
            folder = Path(part) / out.name
            folder.mkdir()
            for view, region in zip(views, found, strict=True):
                masked = on_photograph(region, view)
                painted = given.painted(view, masked.shape[1], masked.shape[0]) if given else None
                counts = ~masked if painted is None else ~masked & painted
                write_png(folder / f"{view.name}.png", np.where(counts, 1.0, 0.0))
            if out.exists():  # empty, or as good as that
                shutil.rmtree(out)
            folder.rename(out)
