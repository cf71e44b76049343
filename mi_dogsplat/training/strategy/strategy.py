"""The seam of training: a strategy has hooks, the loop (``train.py``) calls them, and nobody overrides anything.

A strategy is a frozen dataclass of numbers, without tensors, so that a recipe can hold and print it. What it remembers
from step to step is a second dataclass, its *state*: the loop makes one per run (``new_state``), hands it to every
hook, and writes its fields into checkpoints under the name of the strategy. Numbers per primitive are parameters of
the optimizer (``SplatOptimizer.learn``) or move with it (``rearranged``).

A step of the loop, with the hooks in it:

    before_step -> view -> params -> camera -> render -> loss -> backward -> after_backward -> Adam -> after_step

With ``--batch-views K`` all from the view to ``after_backward`` comes K times in a step. Gradients add up meanwhile,
and Adam takes a Kth of the sum: what a strategy adds for each view counts once. Each hook is called for all strategies
in their order in the recipe. ``begin`` comes once before the first step, also of a run that goes on from a checkpoint;
``end`` after the last one of the run.

A strategy of your own stands in ``Recipe.also``, between the control of density and pruning:

    @dataclass(frozen=True)
    class Fade(Strategy[None]):
        '''Pulls opacities down a little, so that what no photograph needs fades.'''

        pull: float = 1e-4

        def after_backward(self, t: Training, state: None, seen: Seen) -> None:
            logits = t.optimizer.params["logit_opacities"]
            dr.set_grad(logits, dr.grad(logits) + self.pull)

    train(TrainConfig("photos", steps=7000), Path("run"), recipe=replace(RECIPES["ours"], also=(Fade(),)))
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import drjit as dr
import numpy as np

from ...datasets.dataset import View
from ...engine.arrays import detached
from ...engine.device_camera import DeviceCamera
from ...engine.options import RasterOptions
from ...engine.parameters import device_array
from ...engine.rasterize import Frame
from ...render.picture import Picture
from ...scene.appearance import Appearance
from ...scores.score import Score
from ...scores.training_views import TrainingViews
from ..events import Event
from ..loss_means import LossMeans
from ..memory_budget import Budget
from ..optimizer.splat_optimizer import SplatOptimizer

if TYPE_CHECKING:
    # needs the extra "train", which recipes, behind the flags of any command, do not
    from ..images.photographs import Photographs

S = TypeVar("S")


class Training(Protocol):
    """What a strategy may know and use of the run that it is part of."""

    optimizer: SplatOptimizer  # the primitives
    photographs: Photographs  # the training views: cameras and pictures
    losses: LossMeans  # since the last row of the history
    rng: np.random.Generator  # of every random choice
    memory: Budget | None
    extent: float  # radius of the camera positions, world units
    n_start: int  # primitives that the run started with
    steps: int  # of the whole run
    step_count: int  # of them that are done
    target: float  # primitives to end with: below 1 a ratio, else a count

    @property
    def options(self) -> RasterOptions: ...  # how a training view is rendered now

    @property
    def training_views(self) -> TrainingViews: ...  # as the loss sees them now, for scores

    def due(self) -> bool: ...  # whether primitives are counted after this step: a row is logged, or a strategy is due

    def render(self, params: dict, view: int) -> tuple[list, Frame]: ...  # planes over the background, and their frame

    def picture(self, view: View) -> Picture: ...  # the model seen from a view of the data set

    def appearance(self) -> Appearance | None: ...  # what is learned of its cameras so far, where something is

    def training_l1(self) -> float: ...  # mean over all training views

    def test_psnr(self) -> float | None: ...  # mean over the test views, None without any; the clock stands still

    def importance(self, score: Score) -> np.ndarray: ...  # [N] what a score says of the primitives as they are

    def scores(self, score: Score) -> np.ndarray: ...  # [N] the same, as all strategies have it (``Strategy.scores``)


@dataclass(frozen=True)
class Seen:
    """A training view after the backward pass, when gradients lie on the parameters."""

    view: int
    camera: DeviceCamera
    params: dict  # as they were rendered
    frame: Frame
    planes: list  # the picture: three planes [H*W], background included
    gradient: list  # of the loss by these planes
    by_center: tuple[Any, Any] | None  # of the loss by the centres on screen, x, y [N]; where a strategy ``collects``
    last: bool  # of the views of its step: what is due once a step, not with every view, waits for it


@dataclass(frozen=True)
class Strategy(Generic[S]):
    """Part of a training. Every hook does nothing here; ``t`` is the run, ``state`` what ``new_state`` has made."""

    @property
    def name(self) -> str:
        """Of its state in checkpoints, and unique in a run."""
        return type(self).__name__.lower()

    def scaled(self, factor: float) -> Strategy[S]:
        """The strategy for a run ``factor`` times as long: every milestone at the same part of the run."""
        return self

    def earlier(self, steps: int) -> Strategy[S]:
        """The strategy for a run that begins ``steps`` steps later, with a model that exists."""
        return self

    def new_state(self, t: Training) -> S:
        """The state at the beginning of a run: a dataclass of arrays and numbers, or None."""
        return None  # pyright: ignore[reportReturnType] - of a Strategy[None]

    def begin(self, t: Training, state: S) -> list[Event]:
        """What is due before the first step, as for a model that exists."""
        return []

    def before_step(self, t: Training, state: S) -> None:
        """Before anything else of a step, the choice of the view included."""

    def collects(self, t: Training, state: S) -> bool:
        """Whether ``after_backward`` needs ``Seen.by_center`` of this view."""
        return False

    def params(self, t: Training, state: S, params: dict) -> dict:
        """What is rendered instead of ``params``. Other arrays, which no render reads, reach ``Seen.params``."""
        return params

    def camera(self, t: Training, state: S, view: int, camera: DeviceCamera) -> DeviceCamera:
        """What a training view of a step is rendered by instead of ``camera``."""
        return camera

    def after_backward(self, t: Training, state: S, seen: Seen) -> None:
        """Read gradients, or add to them, after each view of a step; those on the parameters are sums so far."""

    def due(self, t: Training, state: S) -> bool:
        """Whether ``after_step`` is about to count or choose primitives: broken ones have to go before."""
        return False

    def after_step(self, t: Training, state: S) -> list[Event]:
        """Change the primitives; the step counts as done. Returns what happened."""
        return []

    def end(self, t: Training, state: S) -> list[Event]:
        """What is due after the last step of the run; once more where no checkpoint came after it."""
        return []

    def scores(self, t: Training, state: S, rest: Callable[[], np.ndarray]) -> np.ndarray:
        """[N] importance for a prune that is due; ``rest()`` is that by the later strategies and the recipe's score."""
        return rest()

    def rearranged(self, state: S, index: np.ndarray, fresh: np.ndarray) -> None:
        """Row r of the primitives is a copy of the old row ``index[r]`` now, or ``fresh``: move what you hold."""


def arrays_of(state: Any) -> dict[str, np.ndarray]:
    """The fields of a state as arrays on the host; none of None."""
    if state is None:
        return {}
    values = {field.name: getattr(state, field.name) for field in dataclasses.fields(state)}
    return {name: v.numpy().copy() if dr.is_array_v(v) else np.array(v) for name, v in values.items()}


def restore_fields(state: Any, arrays: Mapping[str, np.ndarray]) -> None:
    """Take over what ``arrays_of`` made of a state of the same kind. Raises ``KeyError`` where a field is missing."""
    for name in [field.name for field in dataclasses.fields(state)] if state is not None else []:
        before, value = getattr(state, name), arrays[name]
        if dr.is_array_v(before):
            setattr(state, name, detached(device_array(value)))
        else:
            setattr(state, name, np.array(value) if isinstance(before, np.ndarray) else type(before)(value.item()))
