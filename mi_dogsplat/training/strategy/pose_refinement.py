"""Poses of the training views are learned beside the model: ``--refine-poses``.

Structure from motion leaves errors, and a photograph from a wrong place asks for a blurred model. So each training view
gets a small rigid motion (``scene/camera_motions.py``), which follows the gradient of the photometric loss by the pose,
as in BARF (Lin et al. 2021), nerfstudio and gsplat.

Ours is when and how. All views take their step of Adam together, when each has been seen once more: then one wait for
the device serves a whole turn, and no view could have used its step before. And what all motions have in common, a
motion or scaling of the whole world, is taken out of them after each step: nothing in the training photographs speaks
against it, but test views stand where they stood.
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
from ...scene.camera_motions import common_motions, motion_gradient, moved_w2c, picture_units, without_common
from ..events import Event, PosesRefined
from ..milestones import scaled_milestone
from .strategy import Seen, Strategy, Training


@dataclass
class Poses:
    """State of ``PoseRefinement``, of V training views."""

    given: np.ndarray  # [V, 4, 4] world to camera, as in the data
    units: np.ndarray  # [V, 6, 6] motions by steps in the picture (``picture_units``); zeros before the first step
    motions: np.ndarray  # [V, 6]
    m: np.ndarray  # moments of Adam, [V, 6], in these units
    v: np.ndarray
    gradient: Any  # on the device, [6 V], as ``Nudge`` has it: since the last step
    seen: int  # views whose gradients are in it
    turns: int  # steps taken


@dataclass(frozen=True)
class PoseRefinement(Strategy[Poses]):
    """Adam's step sizes are parts of the picture's longer side, by which what a camera sees moves on the mean.

    They fall log-linearly. Their sum is given, not each: poses then come as far in a few turns through many views as
    in many through few.
    """

    start: int = 5000  # step, before which the model is too coarse to align anything with
    reach: float = 0.03  # sum of the step sizes of a run
    fall: float = 0.01  # the last step size over the first
    pull: float = 0.01  # of a motion that each step takes back, at the first step size
    beta_1: float = 0.9
    beta_2: float = 0.999  # moments of all that was seen, nearly: smaller gradients make smaller steps
    epsilon: float = 1e-15

    def scaled(self, factor: float) -> PoseRefinement:
        return replace(self, start=scaled_milestone(self.start, factor))

    def new_state(self, t: Training) -> Poses:
        given = np.array([view.camera.w2c for view in t.photographs.originals])
        zeros = np.zeros((len(given), 6))
        return Poses(given, np.zeros((len(given), 6, 6)), zeros, zeros, zeros, detached(device_array(zeros)), 0, 0)

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
        state.seen += 1

    def after_step(self, t: Training, state: Poses) -> list[Event]:
        if state.seen >= len(t.photographs):
            self._step(t, state)
        return []

    def end(self, t: Training, state: Poses) -> list[Event]:
        turns, shifts = (np.linalg.norm(state.motions[:, part], axis=1) for part in (slice(3), slice(3, 6)))
        return [PosesRefined(float(np.median(shifts)), float(np.degrees(np.median(turns))))]

    def _step(self, t: Training, state: Poses) -> None:
        by_pose = state.gradient.numpy().astype(np.float64).reshape(-1, 6)
        by_pose[~np.isfinite(by_pose).all(axis=1)] = 0
        if not state.turns:
            cameras = [view.camera for view in t.photographs.originals]
            state.units = picture_units(cameras, t.optimizer.numpy("means").astype(np.float64), t.extent)
        by_motion = motion_gradient(state.given, state.motions, t.extent, by_pose)
        gradient = np.einsum("vji,vj->vi", state.units, by_motion)
        state.gradient, state.seen = detached(device_array(np.zeros(gradient.size))), 0
        state.turns += 1
        state.m = self.beta_1 * state.m + (1 - self.beta_1) * gradient
        state.v = self.beta_2 * state.v + (1 - self.beta_2) * gradient**2
        m, v = state.m / (1 - self.beta_1**state.turns), state.v / (1 - self.beta_2**state.turns)
        steps = max(t.steps - self.start, 1)
        turns = max(steps * t.optimizer.learning_rates.batch_views / len(gradient), 1.0)
        rate = self.reach / turns * math.log(1 / self.fall) / (1 - self.fall)
        fall = self.fall ** min((t.step_count - self.start) / steps, 1.0)
        step = rate * m / (np.sqrt(v) + self.epsilon)
        change = fall * (np.einsum("vij,vj->vi", state.units, step) + self.pull * state.motions)
        state.motions = without_common(state.motions - change, common_motions(state.given, t.extent))
        self._move_cameras(t, state)

    def _move_cameras(self, t: Training, state: Poses) -> None:
        for view, w2c in enumerate(moved_w2c(state.given, state.motions, t.extent)):
            t.photographs.move(view, w2c)
