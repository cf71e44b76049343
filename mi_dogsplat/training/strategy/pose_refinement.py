"""Poses of the training views are learned beside the model: ``--refine-poses``.

Structure from motion leaves errors, and a photograph from a wrong place asks for a blurred model. So each training view
gets a small rigid motion (``scene/camera_motions.py``), which follows the gradient of the photometric loss by the pose,
as in BARF (Lin et al. 2021), nerfstudio and gsplat.

Ours is when, how far and what not:

- All views take their step together, as soon as each has been seen once more; of one that was seen twice meanwhile,
  as where all begins in the middle of a turn, the mean gradient counts. One wait for the device serves a whole turn.
- The step is not Adam's, which is as long for a pose that is right as for one that is wrong. The gradient is brought to
  the unit of the picture (``preconditioners``, after CamP) and divided by the mean slope of the photograph: what it
  would be if every pixel asked for the same. Where poses are right its length is some .15 by chance, and what is
  below ``quiet`` counts as nothing; where they are off by half a degree it is .6 to 1.
- What all motions have in common, a motion or scaling of the whole world, is taken out of them after each step: no
  training photograph speaks against it, but test views stand where they stood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.arrays import detached
from ...engine.device_camera import DeviceCamera, Nudge
from ...engine.parameters import device_array
from ...scene.camera_motions import common_motions, motion_gradient, moved_w2c, preconditioners, without_common
from ..events import Event, PosesRefined
from ..milestones import FromStep
from .strategy import Seen, Strategy, Training

FLATTEST = 0.1  # slope of a photograph: one that is flatter says nothing of its pose


@dataclass
class Poses:
    """State of ``PoseRefinement``, of V training views."""

    given: np.ndarray  # [V, 4, 4] world to camera, as in the data
    motions: np.ndarray  # [V, 6]
    mean: np.ndarray  # of the gradients, [V, 6], over the last turns
    scales: np.ndarray  # [V, 6, 6] from them to motions, for a step size of 1; zeros before the first step
    slopes: np.ndarray  # [V] of the photographs (``_slopes``); likewise
    gradient: Any  # on the device, [6 V], as ``Nudge`` has it: since the last step
    counts: np.ndarray  # [V] how often each view is in it
    turns: int  # steps taken


@dataclass(frozen=True)
class PoseRefinement(FromStep, Strategy[Poses]):
    """Step sizes are parts of the picture's longer side: how far a picture moves if every pixel asks for it.

    They fall log-linearly. Their sum is given, not each: poses then come as far in a few turns through many views as
    in many through few.
    """

    start: int = 5000  # step, before which the model is too coarse to align anything with
    reach: float = 0.1  # sum of the step sizes of a run
    largest: float = 0.01  # step size: beyond, steps overshoot, however few there are
    fall: float = 0.01  # the last step size over the first
    pull: float = 0.01  # of a motion that each step takes back, at the first step size
    quiet: float = 0.2  # of a gradient in units of the picture: so much is asked for where poses are right, too
    memory: float = 0.8  # of the mean of the gradients, from turn to turn

    def new_state(self, t: Training) -> Poses:
        given = np.array([view.camera.w2c for view in t.photographs.originals])
        zeros = np.zeros((len(given), 6))
        scales, none = np.zeros((len(given), 6, 6)), detached(device_array(zeros))
        return Poses(given, zeros, zeros, scales, zeros[:, 0], none, np.zeros(len(given), int), 0)

    def begin(self, t: Training, state: Poses) -> list[Event]:
        if state.turns:  # of a run that goes on
            self._move_cameras(t, state)
        return []

    def camera(self, t: Training, state: Poses, view: int, camera: DeviceCamera) -> DeviceCamera:
        return replace(camera, nudge=Nudge.of(t.optimizer.n)) if t.step_count >= self.start else camera

    def after_backward(self, t: Training, state: Poses, seen: Seen) -> None:
        if seen.camera.nudge is None:
            return
        of_lanes = detached([dr.grad(value) for value in seen.camera.nudge.values])
        dr.eval(of_lanes)
        by_pose = dr.concat([dr.sum(lanes) for lanes in of_lanes])  # [6]
        at = dr.opaque(mi.UInt32, 6 * seen.view) + dr.arange(mi.UInt32, 6)
        dr.scatter_add(state.gradient, by_pose, detached(at))
        state.counts[seen.view] += 1

    def after_step(self, t: Training, state: Poses) -> list[Event]:
        if state.counts.all():
            self._step(t, state)
        return []

    def end(self, t: Training, state: Poses) -> list[Event]:
        turns, shifts = (np.linalg.norm(state.motions[:, part], axis=1) for part in (slice(3), slice(3, 6)))
        return [PosesRefined(float(np.median(shifts)), float(np.degrees(np.median(turns))))]

    def _step(self, t: Training, state: Poses) -> None:
        """Move all views by the gradients of a turn, and begin the next one. Waits for the device."""
        gradient = _gradient_of_turn(t, state)
        if not state.turns:
            state.slopes, state.scales = _slopes(t), _scales(t)
            state.scales /= state.slopes[:, None, None]
        state.gradient = detached(device_array(np.zeros(gradient.size)))
        state.counts = np.zeros_like(state.counts)
        state.turns += 1
        state.mean = self.memory * state.mean + (1 - self.memory) * gradient
        first, fallen = self._step_size(t, len(gradient))
        change = fallen * (self._heard(state, first) + self.pull * state.motions)
        state.motions = without_common(state.motions - change, common_motions(state.given, t.extent))
        self._move_cameras(t, state)

    def _step_size(self, t: Training, views: int) -> tuple[float, float]:
        """(The first one, what is left of it now). It falls to ``fall`` exponentially, and all of a run add up to
        ``reach``: that is turns x first x (1 - fall) / ln(1 / fall)."""
        steps = max(t.steps - self.start, 1)
        turns = max(steps * t.optimizer.learning_rates.batch_views / views, 1.0)
        first = min(self.reach / turns * math.log(1 / self.fall) / (1 - self.fall), self.largest)
        return first, self.fall ** min((t.step_count - self.start) / steps, 1.0)

    def _heard(self, state: Poses, step_size: float) -> np.ndarray:
        """[V, 6] motions that the gradients ask for; less by what they ask for where poses are right, too."""
        mean = state.mean / (1 - self.memory**state.turns)  # it began with zero, as in Adam
        asked = np.einsum("vij,vj->vi", state.scales, mean)  # for a step size of 1
        loud = np.sqrt(np.maximum(np.einsum("vi,vi->v", mean, asked) / state.slopes, 1e-30))  # [V]
        heard = np.maximum(1 - self.quiet / loud, 0)
        return step_size * heard[:, None] * asked

    def _move_cameras(self, t: Training, state: Poses) -> None:
        for view, w2c in enumerate(moved_w2c(state.given, state.motions, t.extent)):
            t.photographs.move(view, w2c)


def _gradient_of_turn(t: Training, state: Poses) -> np.ndarray:
    """[V, 6] by the motions; 0 of a view that has one that is not finite."""
    by_pose = state.gradient.numpy().astype(np.float64).reshape(-1, 6) / state.counts[:, None]
    by_pose[~np.isfinite(by_pose).all(axis=1)] = 0
    return motion_gradient(state.given, state.motions, t.extent, by_pose)


def _scales(t: Training) -> np.ndarray:
    """``preconditioners`` of the training views, by the primitives as points."""
    points = t.optimizer.numpy("means").astype(np.float64)
    cameras = [view.camera for view in t.photographs.originals]
    return preconditioners(cameras, points, t.extent, t.photographs.near_clip)


def _slopes(t: Training) -> np.ndarray:
    """[V] by how much a photograph would change along its longer side if it went on as from pixel to pixel, mean.

    In what the loss sees of it, of which its gradients are: of linear radiance in units of white, through the curve. It
    is a mean over all pixels, and so is the loss: what is masked changes nothing, nor does the edge of a mask.
    """
    found = []
    for k, view in enumerate(t.photographs.originals):
        image, mask = t.photographs.as_seen(view.image), t.photographs.mask(k)
        if mask is not None:
            image = np.where(mask[..., None] > 0, image, np.nan)
        steps = [np.diff(image, axis=axis) for axis in (0, 1) if image.shape[axis] > 1]
        changes = [float(np.nan_to_num(np.abs(step)).mean()) for step in steps]
        found.append(max(image.shape[:2]) * float(np.mean(changes or [0.0])))
    return np.maximum(found, FLATTEST)
