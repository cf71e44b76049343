"""What a run learned of its photographs: exposure and white balance of each, and vignetting of their cameras."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ..scene.appearance import Appearance
from .plot import Series, line_plot
from .points import Note

CHANNELS = {"red": 5, "blue": 1}  # over green, and their colours of the page


def appearance_plots(appearance: Appearance | None) -> list[Markup]:
    """Exposure, and white balance, against the number of the image; none where nothing was learned."""
    if appearance is None or not len(appearance.names):
        return []
    gains = appearance.of_images  # [V, 3]
    number = np.arange(1, len(gains) + 1, dtype=np.float64)

    def points(label: str, values: np.ndarray, color: int) -> Series:
        notes = [Note(f"{name}: {value:+.2f}") for name, value in zip(appearance.names, values, strict=True)]
        return Series(label, number, values, "points", color, notes)

    exposure = line_plot([points("exposure", gains.mean(1), 1)], "training image", "exposure, EV")
    over_green = [points(f"{c} over green", gains[:, 2 * k] - gains[:, 1], CHANNELS[c]) for k, c in enumerate(CHANNELS)]
    return [exposure, line_plot(over_green, "training image", "white balance, log2")]


def corner_losses(appearance: Appearance | None) -> list[str]:
    """What part of the light the corners lose, in words, for each device; none where nothing was learned."""
    if appearance is None:
        return []
    shares = [1 - 2 ** float(vignetting.sum()) for vignetting in appearance.of_devices]
    return [f"{100 * share:.0f} %".replace("-", "\u2212") for share in shares]
