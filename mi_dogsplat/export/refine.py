"""Baked Gaussians brought back to what they stand for, by some hundred steps towards pictures.

With a data set these are its photographs, from its training views: so the export loses least of what counts, and may
gain a little on the model. What ``--appearance`` has learned of them is taken out of them first. Without a data set
they are renders of the DoG model itself, from around it and from free places inside (``render/vantages.py``). Such
views need not be like those that the model was trained for, so that the steps are fewer and smaller. Which pictures and
which steps: docs/export_details.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..datasets.dataset import Dataset, View
from ..datasets.masks import Masks
from ..render.framing import robust_sphere
from ..render.picture import background_color, photograph, picture_of, radiance_of
from ..render.picture_options import PictureOptions
from ..render.vantages import vantage_cameras
from ..scene.appearance import Appearance
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.splats import Array, Splats
from ..training.fit import Look, fit
from ..training.optimizer.learning_rates import Refinement
from ..training.quantisation.quantiser import Quantiser

STEPS, MOST_STEPS = 300, 1000
PASSES = 10  # over the training views, within these bounds
BY_DATA = Refinement(start=0, gain=8.0, end_gain=0.01, means_gain=2.0)  # on the step sizes of 3DGS
BY_RENDERS = Refinement(start=0, gain=0.5, end_gain=0.01, means_gain=0.25)
N_VANTAGES, VANTAGE_SIZE = 48, (400, 300)  # renders without a data set, pixels
CLIPPED = 254.5 / 255  # display value of a photograph from which on light is no brighter
GREY = 0.5  # behind them: black hides what is missing in the dark, white in the bright
NEAR = 0.01  # of the radius of the model: near clip, where the usual one is farther


@dataclass(frozen=True)
class Goal:
    """What baked Gaussians are brought to: pictures [H, W, 3], how they are drawn, and by what steps.

    Pictures are in the colours of the model: display-referred sRGB, or linear radiance, which its white exposes in the
    loss.
    """

    cameras: list[Camera]
    pictures: Sequence[Array]
    look: Look
    gains: Refinement


def steps_for(dataset: Dataset | None) -> int:
    """How many steps are taken unless somebody says: each training view of a data set is seen ``PASSES`` times."""
    return min(max(STEPS, PASSES * len(dataset.train)), MOST_STEPS) if dataset else STEPS


def by_data(
    model: Splats,
    dataset: Dataset,
    most: int,
    options: PictureOptions,
    drawn: DrawnAs,
    masks: Masks | None = None,
    appearance: Appearance | None = None,
) -> Goal:
    """Photographs of at most ``most`` training views, and the model itself where these do not say: there it is to stay
    as it is. Of a linear model and display-referred photographs renders from there.

    ``appearance``: what the cameras did to display-referred photographs, which the model is without.
    """
    if dataset.white is not None:  # a display value of 1 is a radiance of 1
        dataset = dataset.exposed(drawn.white if drawn.linear else 1.0)
    views = dataset.train[:: -(-len(dataset.train) // most)]
    cameras = [view.camera for view in views]
    look = Look(background_color(options.background, dataset.has_alpha), drawn)
    if drawn.linear and dataset.white is None:
        pictures = rendered(model, cameras, look)
    else:
        appearance = None if drawn.linear or dataset.white is not None else appearance
        pictures = [_completed(model, view.in_memory(), masks, appearance, look) for view in views]
    return Goal(cameras, pictures, look, BY_DATA)


def _completed(model: Splats, view: View, masks: Masks | None, appearance: Appearance | None, look: Look) -> Array:
    """The photograph of a view, without what the appearance says of its camera, and with what the model shows where the
    photograph does not say: where its mask is black, and where it is at its limit and the model is brighter."""
    picture = (radiance_of if look.drawn.linear else photograph)(view, look.background)
    mask, full = masks.of(view) if masks else None, view.recording.saturated
    at_limit = None if full is None else full[..., None]
    if appearance:
        at_limit = picture >= CLIPPED
        picture = appearance.taken_out(picture, view.camera, view.name)
    if mask is None and at_limit is None:
        return picture
    (own,) = rendered(model, [view.camera], look)
    picture = picture if at_limit is None else np.where(at_limit, np.maximum(picture, own), picture)
    return picture if mask is None else np.where(mask[..., None] > 0, picture, own)


def by_renders(model: Splats, most: int, drawn: DrawnAs, up: str | None = None) -> Goal:
    """Renders of the model, at most ``most``, from where there may be something to see."""
    look = look_from_near(model, drawn)
    cameras = vantage_cameras(model, min(N_VANTAGES, most), VANTAGE_SIZE, up_axis=up)
    return Goal(cameras, rendered(model, cameras, look), look, BY_RENDERS)


def look_from_near(model: Splats, drawn: DrawnAs, background: float = GREY) -> Look:
    """How a model is drawn from places of our own, which may be near to it."""
    near_clip = min(drawn.near_clip, NEAR * robust_sphere(model)[1])
    return Look(background, replace(drawn, near_clip=near_clip))


def rendered(model: Splats, cameras: list[Camera], look: Look) -> list[Array]:
    """[H, W, 3] from each camera, in the model's own colours, linear or not."""
    picture = picture_of(model, look.background, look.drawn)
    found = [picture(camera) for camera in cameras]
    return [seen.color if seen.radiance is None else seen.radiance for seen in found]


def refined(
    baked: Splats,
    goal: Goal,
    steps: int,
    show: Callable[[int, int], None] | None = None,
    small: str | None = None,
) -> Splats:
    """Gaussians after ``steps`` steps towards a goal.

    Args:
        show: called with the steps done, and all of them.
        small: format of ``formats/coded.py`` on whose grids they are to be; None: as they are.
    """
    return fit(
        baked,
        goal.cameras,
        goal.pictures,
        steps,
        goal.look,
        goal.gains,
        quantiser=Quantiser(small) if small else None,
        after_step=(lambda step, _: show(step, steps)) if show else None,
    )
