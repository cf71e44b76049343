"""A search for masks before a training, as the commands show it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..masking.masks_config import MasksConfig
from ..render.picture_options import PictureOptions
from ..support.variants import set_variant
from ..training.config import TrainConfig
from .printing import masks_lines, say
from .training_run import shown_training


def search_masks(config: TrainConfig, run: Path, resume: bool) -> TrainConfig:
    """The settings of a training with masks of what moved, which are made in its folder by a small model.

    resume: what an earlier start has made there is taken as it is, and what it was stopped at goes on.

    Raises ``DataError``, and ``Stopped`` in the training of the small model.
    """
    set_variant(config.variant)
    from ..masking.first_model import settings_of_first
    from ..masking.make import make_masks, require_new
    from ..report.run_folder import CONFIG, FIRST, MASKED, MASKS, METRICS, MODEL
    from ..runs.run import check_run, prepared, train
    from .progress import Bar

    first, masks = run / FIRST, run / MASKS
    masked = replace(config, masks=str(masks))
    check_run(masked, run, resume)  # else it is told after the small model is trained
    with prepared(run):
        begun = (first / CONFIG).exists()
        if not (resume and begun and masks.is_dir()):
            require_new(masks)  # of an earlier training, perhaps on other photographs, or painted by hand
            small = settings_of_first(config)
            if not (resume and (first / METRICS).exists()):
                say(f"first training a small model in {first}, which shows what the photographs have in common")
                with shown_training(small.steps, small.split) as show:
                    train(small, first, show, resume=resume and begun)
            say(f"finding what moved; masks go to {masks}")
            options = PictureOptions(small.downscale, small.background, white=small.white)
            given = MasksConfig(masks=config.masks)
            with Bar("photograph") as bar:
                written = masks, given, run / MASKED
                found = make_masks(first / MODEL, small.data, *written, options, bar.show, small.split)
            say("\n".join(masks_lines(masks, found)))
    return masked
