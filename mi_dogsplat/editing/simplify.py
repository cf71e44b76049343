"""A model of fewer primitives, without photographs: merged, then fitted to renders; behind ``dogsplat simplify``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..export.bake import baked
from ..export.refine import GREY, look_from_near, rendered
from ..formats.read import read_source
from ..formats.table import format_to_write
from ..formats.write import require_encoder, write_model
from ..inspection.unneeded import Unneeded
from ..measure.metrics import psnr
from ..render.framing import robust_sphere
from ..render.picture_options import PictureOptions
from ..render.vantages import vantage_cameras
from ..scene.cameras import Camera
from ..scene.drawing import Drawing, drawn_as
from ..scene.kinds import varying
from ..scene.radiance import from_units_of_white, in_units_of_white
from ..scene.splats import Splats
from ..scene.whole import whole
from ..support.arguments import checks_arguments
from ..support.errors import DataError
from ..support.srgb import displayed
from ..support.variants import require_arrays
from ..support.wording import counted
from ..training.fit import GAINS, Look, fit
from ..training.strategy.dog_control import DogRule
from .merge import merge
from .simplify_config import SimplifyConfig
from .views import weights_in

RESOLUTION = 1e-3  # of the radius of a model, below which shapes are alike
LEAST_WEIGHT = 1e-3  # of the mean weight: of what no view sees, and some other might
HELD_OUT = 16  # views that nothing was fitted to, to measure on
DOG = DogRule(opacity=0.05, scale=0.6)  # where they start, as in the preset ours


@dataclass(frozen=True)
class Simplified:
    """What came of it: numbers of primitives, and PSNR in dB against the model on views that nothing was fitted to."""

    n_before: int
    n_after: int
    n_dog: int
    n_views: int
    merged: float
    fitted: float | None
    """None without a fit"""
    left_out: list[str]
    """a line for each thing that the formats have no room for"""


@checks_arguments
def simplify_model(
    model: str | Path,
    out: str | Path,
    config: SimplifyConfig = SimplifyConfig(),
    options: PictureOptions = PictureOptions(),
    show: Callable[[int, int], None] | None = None,
) -> Simplified:
    """Write a model file with fewer primitives.

    Args:
        model: the model, of any format.
        out: the file to write, in the format of its name.
        config: how.
        options: how pictures are drawn. A background of ``auto`` or ``random`` is grey, on which all shows.
        show: called with the steps that are done, and how many there are.

    Needs a Mitsuba variant. Raises ``DataError``.
    """
    require_arrays()
    model, out = Path(model), Path(out)
    chosen = format_to_write(out)
    require_encoder(out, chosen)
    if config.dog and not chosen.dog:
        raise DataError("--dog", f"{chosen.name} cannot hold DoG", "write a .ply, or leave it out")
    read = read_source(model, out, "simplify")
    splats = read.splats
    target = config.count(splats.n_splats)
    look = look_of(splats, options, read.drawing)
    others = cameras_of(splats, config, HELD_OUT, config.seed + 1, read.drawing.up)
    truth = rendered(splats, others, look)

    def quality(found: Splats) -> float:
        pairs = zip(rendered(found, others, look), truth, strict=True)
        if look.drawn.linear:  # what a screen shows
            pairs = [(displayed(a, look.drawn.white), displayed(b, look.drawn.white)) for a, b in pairs]
        return float(np.mean([psnr(picture, true) for picture, true in pairs]))

    cameras = cameras_of(splats, config, config.views, config.seed, read.drawing.up)
    start = merged(splats, target, cameras, look)
    if not start.n_splats:
        raise DataError(model, "all of its primitives are invisible, so that none would be left", "use another model")
    if start.n_splats > target:
        problem = f"{counted(start.n_splats, 'primitive')} could not be merged any further"
        raise DataError(model, problem, "use a larger --target")
    found = fitted(start, splats, cameras, look, config, show) if config.steps else start
    left_out = [f"{model.name}: {line}" for line in read.left_out]
    if splats.is_cut.any():
        cut = counted(splats.is_cut.sum(), "primitive")
        left_out.append(f"the cuts of {cut} are left out: merged primitives are whole")
    if splats.n_shifts:
        shifted = counted(splats.n_shifts, "primitive")
        left_out.append(f"the shifts of {shifted} are left out: merged primitives do not move with the view")
    if splats.is_varied.any():
        varied = counted(splats.is_varied.sum(), "primitive")
        left_out.append(f"the {varying(splats)} of {varied} are left out: merged primitives have one mean colour")
    left_out += write_model(out, replace(read, splats=found, drawing=options.drawing.over(read.drawing)))
    after = quality(found) if config.steps else None
    return Simplified(splats.n_splats, found.n_splats, found.n_dog, len(others), quality(start), after, left_out)


def look_of(splats: Splats, options: PictureOptions, said: Drawing = Drawing()) -> Look:
    """How all pictures of a model are drawn that are compared, from near; options come before what its file says.

    Colours are compared as the model has them, linear or not.
    """
    background = {"black": 0.0, "white": 1.0}.get(options.background or "auto", GREY)
    return look_from_near(splats, drawn_as(options.drawing, said), background)


def cameras_of(splats: Splats, config: SimplifyConfig, n: int, seed: int, up: str | None = None) -> list[Camera]:
    """``n`` cameras, of which every third has twice the size: what is fitted at one size alone is worse at others."""
    width, height = config.size
    cameras = vantage_cameras(splats, n, config.size, seed, config.inside, up)
    return [camera.resized(2 * width, 2 * height) if k % 3 == 2 else camera for k, camera in enumerate(cameras)]


def merged(splats: Splats, target: int, cameras: list[Camera], look: Look) -> Splats:
    """``target`` plain Gaussians, merged by how much of each primitive the cameras see (Σ α T over all pixels).

    None of a model that is invisible.
    """
    still = splats.without_shifts()
    plain = whole(baked(still) if still.n_dog else still).without_slopes()
    needed = Unneeded.of(plain).taken_out(plain).uniform_sh()
    if not needed.n_splats:
        return needed
    seen = weights_in(needed, cameras, look.drawn).total
    seen = np.maximum(seen, LEAST_WEIGHT * (seen.mean() or 1.0))
    start = in_units_of_white(needed, look.drawn)  # colours in the unit of a picture
    found = merge(start, target, RESOLUTION * robust_sphere(needed)[1], seen)
    return from_units_of_white(found, look.drawn)


def fitted(
    start: Splats,
    splats: Splats,
    cameras: list[Camera],
    look: Look,
    config: SimplifyConfig,
    show: Callable[[int, int], None] | None = None,
) -> Splats:
    """The ``start`` after steps towards pictures of ``splats``; with DoG, if asked for, from half of them on."""
    pictures = rendered(splats, cameras, look)

    def after(first: int, n: int, model: Splats, gain: float, end: float) -> Splats:
        gains = replace(GAINS, gain=gain, end_gain=end)

        def tell(step: int, _: float) -> None:
            if show:
                show(first + step, config.steps)

        return fit(model, cameras, pictures, n, look, gains, config.seed, after_step=tell)

    if not config.dog:
        return after(0, config.steps, start, GAINS.gain, GAINS.end_gain)
    half, middle = config.steps // 2, (GAINS.gain + GAINS.end_gain) / 2
    plain = after(0, half, start, GAINS.gain, middle)
    return without_faded(after(half, config.steps - half, with_dog(plain), middle, GAINS.end_gain))


def with_dog(plain: Splats) -> Splats:
    """Every primitive a Difference of Gaussians, at a weak start."""
    n, scale = plain.n_splats, math.log(float(np.mean(DOG.scale)))
    logits = np.full(n, math.log(DOG.opacity / (1 - DOG.opacity)))
    rows = {"dog_logit_opacities": logits, "dog_log_scales": np.full((n, 3), scale)}
    return replace(plain, dog_index=np.arange(n), **rows)


def without_faded(splats: Splats) -> Splats:
    """Those that a pixel can show stay DoG (``DogRule.min_opacity``)."""
    stay = splats.dog_opacities * splats.opacities[splats.dog_index] >= DOG.min_opacity
    names = ("dog_index", "dog_logit_opacities", "dog_log_scales")
    return replace(splats, **{name: getattr(splats, name)[stay] for name in names})
