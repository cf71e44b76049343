"""What a model loses on its way into a file: pictures of each stage, against the model and against photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..datasets.dataset import Dataset
from ..datasets.masks import Masks
from ..measure.metrics import psnr
from ..render.framing import cameras_around, near_clip_for
from ..render.picture import background_color, exposed_by, photograph, picture_of
from ..render.picture_options import PictureOptions
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.splats import Array, Splats


@dataclass(frozen=True)
class Views:
    """From where a loss is measured: cameras, and photographs if there are any.

    ``photographs`` are display-referred sRGB [H, W, 3], those of linear images exposed by their ``exposure``: the
    radiance that is their white, None where there are no linear images. ``drawn``: how the model is. ``masks`` are of
    the photographs, [H, W], 1 where a pixel counts; None where it counts whole, and no list without any.
    """

    cameras: list[Camera]
    photographs: list[Array]
    background: float
    drawn: DrawnAs
    exposure: float | None = None
    masks: Sequence[Array | None] = ()

    def pictures(self, splats: Splats) -> list[Array]:
        """[H, W, 3] of each view, display-referred sRGB, exposed as the photographs are; by the model's white
        without linear ones."""
        picture = picture_of(splats, self.background, self.drawn)
        return [exposed_by(picture(camera), self.exposure) for camera in self.cameras]

    def near(self, pictures: list[Array]) -> float | None:
        """Mean PSNR of pictures of these views against the photographs, in dB; None where no pixel of those counts."""
        masks = self.masks or [None] * len(self.photographs)
        pairs = zip(pictures, self.photographs, masks, strict=True) if self.photographs else ()
        found = [psnr(a, b, mask) for a, b, mask in pairs if mask is None or mask.any()]
        return float(np.mean(found)) if found else None


@dataclass(frozen=True)
class Loss:
    """What a model has become on its way into a file, and its mean PSNR in dB; None where there is nothing to compare.

    ``of_model``: against pictures of the model as it was; ``of_photographs``: against the photographs of the data.
    """

    stage: str
    of_model: float | None
    of_photographs: float | None


def views_of(
    splats: Splats,
    dataset: Dataset | None,
    count: int,
    options: PictureOptions,
    drawn: DrawnAs,
    up: str | None = None,
    masks: Masks | None = None,
) -> Views:
    """At most ``count`` test views of a data set, training views where it has none; else views from around a model."""
    if dataset is None:
        drawn = replace(drawn, near_clip=near_clip_for(splats, drawn.near_clip, options.near_clip))
        return Views(cameras_around(splats, count, up), [], background_color(options.background, False), drawn)
    background = background_color(options.background, dataset.has_alpha)
    held_out = dataset.test or dataset.train
    views = held_out[:: -(-len(held_out) // count)]
    photographs = [photograph(view, background) for view in views]
    cameras = [view.camera for view in views]
    of_views = [masks.of(view) for view in views] if masks else ()
    return Views(cameras, photographs, background, drawn.beside(dataset.white), dataset.white, of_views)


def losses(stages: dict[str, Splats], views: Views) -> list[Loss]:
    """Of each stage, against the first one and against the photographs."""
    reference = views.pictures(next(iter(stages.values())))
    found = []
    for number, (name, splats) in enumerate(stages.items()):
        pictures = views.pictures(splats) if number else reference
        found.append(Loss(name, mean_psnr(pictures, reference) if number else None, views.near(pictures)))
    return found


def mean_psnr(pictures: list[Array], truth: list[Array]) -> float:
    """Mean over pairs of pictures, in dB."""
    return float(np.mean([psnr(a, b) for a, b in zip(pictures, truth, strict=True)]))
