"""What the DoG primitives of a mixture draw, and how the picture errs with and without them (Wang et al. 2026).

The model holds plain Gaussians and Differences of Gaussians side by side. Either kind can be rendered alone, and
the pseudo-Gaussians can be switched off, which turns every DoG into its primary Gaussian. Two pictures of a view,
with and without DoG, are compared by their FLIP maps and by their error along the image row where they differ
most; where the second one comes from is the caller's choice: the same model switched off, or another model.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import View
from ..datasets.masks import Masks
from ..engine.options import RasterOptions
from ..engine.parameters import upload
from ..measure.metrics import evaluate, flip, masked
from ..render.picture import Picture, photograph, render_picture, seen_as
from ..report.run_folder import DOG_PROFILE
from ..report.views import ranked
from ..scene.drawing import DrawnAs
from ..scene.splats import Splats
from ..support.files import replacing
from ..support.pictures import heat_map, write_png

SWITCHED_OFF = "the same model, its pseudo-Gaussians switched off"
DIGITS = 5  # of an error in the profile; a step of 8 bits is 0.004


def write_mixture(
    splats: Splats,
    views: Sequence[View],
    metrics: Mapping[str, Mapping[str, float]],
    out: Path,
    options: RasterOptions,
    background: float = 0.0,
    drawn: DrawnAs = DrawnAs(),  # noqa: B008, it is immutable
    masks: Masks | None = None,
) -> None:
    """The parts of a model seen from its median view, and the comparison with its pseudo-Gaussians switched off.

    Args:
        splats: a model with DoG primitives.
        views, metrics, out: as ``evaluate_views`` was given, returned and wrote them; at least one view.
        options, background, drawn: as the views were rendered.
        masks: as they were measured.

    Writes ``<name>_gaussian.png`` and ``<name>_dog.png`` beside what ``write_comparison`` does.
    """
    order = ranked(metrics)
    name = order[len(order) // 2].name
    view = next(v for v in views if v.name == name)

    def drawing(model: Splats) -> Callable[[View], Picture]:
        params = upload(model)
        some = replace(options, sh_degree=min(options.sh_degree, model.sh_degree))  # of a part, maybe none has more
        return lambda v: render_picture(params, v.camera, some, background, drawn)

    write_png(out / f"{name}_gaussian.png", drawing(splats.only_gaussians())(view).color)
    write_png(out / f"{name}_dog.png", drawing(splats.only_dog())(view).color)
    mask = masks.of(view) if masks else None
    write_comparison(drawing(splats), drawing(splats.plain()), view, background, out, SWITCHED_OFF, mask)


def write_comparison(
    with_dog: Callable[[View], Picture],
    without_dog: Callable[[View], Picture],
    view: View,
    background: float,
    out: Path,
    without: str,
    mask: np.ndarray | None = None,
) -> dict[str, Any]:
    """Compare two renders of a view with its photograph.

    Args:
        with_dog, without_dog: render the view; ``evaluate_views`` has written the pictures of the first to ``out``.
        background: grey level behind images with alpha.
        without: says in words what ``without_dog`` draws.
        mask: pixels that count [H, W], at least one; the error of others is 0. None: all.

    Writes ``<name>_plain.png``, ``<name>_plain_error.png`` (FLIP, the scale of ``<name>_error.png``: 0..1) and
    ``dog_profile.json``, whose content it returns: ``view``, ``without``, ``row``, and under ``with_dog`` and
    ``without_dog`` the ``metrics`` of the whole view and the absolute ``error`` of each pixel of that row.
    """
    truth = photograph(view, background)
    ours, plain = (seen_as(render(view), view) for render in (with_dog, without_dog))
    counted = {"with_dog": masked(ours, truth, mask), "without_dog": masked(plain, truth, mask)}
    row = most_different_row(*counted.values())
    profile: dict[str, Any] = {"view": view.name, "without": without, "row": row}
    flips = {key: flip(picture, truth, mask, view.name) for key, picture in counted.items()}
    for key, picture in counted.items():
        profile[key] = {
            "metrics": evaluate(picture, truth, view.name, mask, flips[key][0]),
            "error": np.round(row_error(picture, truth, row), DIGITS).tolist(),
        }
    write_png(out / f"{view.name}_plain.png", plain)
    error = flips["without_dog"][1] if mask is None else flip(plain, truth)[1]  # of all pixels
    write_png(out / f"{view.name}_plain_error.png", heat_map(error))
    with replacing(out / DOG_PROFILE) as part:
        part.write_text(json.dumps(profile) + "\n", encoding="utf-8")
    return profile


def most_different_row(a: NDArray[np.floating], b: NDArray[np.floating]) -> int:
    """The row of two pictures [H, W, 3] with the largest mean absolute difference; the first of equals."""
    return int(np.argmax(np.abs(a.astype(np.float64) - b).mean((1, 2))))


def row_error(picture: NDArray[np.floating], truth: NDArray[np.floating], row: int) -> NDArray[np.float64]:
    """[W] absolute error of each pixel of a row, mean over the channels; the pictures are [H, W, 3]."""
    return np.abs(picture[row].astype(np.float64) - truth[row]).mean(-1)
