"""Steps of refined poses: their gradient, when views step, which ones move and how far."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hdr_data import write_hdr_data
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.scene.camera_motions import common_motions, motion_gradient, moved_w2c, without_common
from mi_dogsplat.training.strategy.pose_refinement import PoseRefinement, Poses
from mi_dogsplat.training.strategy.strategy import Seen, Training
from mi_dogsplat.training.train import Trainer
from PIL import Image
from refined_poses import VIEWS, config_of, poses_of, stepped
from splat_scenes import SMOOTH_OPTIONS


def test_the_gradient_is_that_of_differences_of_the_loss(data, at_once, monkeypatch):
    """Of the very loss of training, in float32, along random directions, at poses that have moved.

    Cutoffs are smooth: elsewhere an image jumps where a pixel crosses one, which is no derivative.
    """
    usual: Any = Trainer.options
    monkeypatch.setattr(Trainer, "options", property(lambda t: replace(usual.fget(t), **SMOOTH_OPTIONS)))
    trainer = stepped(Trainer(config_of(data), load_dataset(data)), 2 * VIEWS + 1)
    state, rng = poses_of(trainer), np.random.default_rng(0)
    view, params = trainer.order[-1], {name: dr.detach(value) for name, value in trainer.optimizer.params.items()}

    def loss(motion: np.ndarray) -> float:
        trainer.photographs.move(view, moved_w2c(state.given[view][None], motion[None], trainer.extent)[0])
        planes, _ = trainer.render(params, view)
        return float(trainer.photographs.compare(planes, view, 0)[1][0])

    motion = state.motions[view]
    assert np.linalg.norm(motion[:3]) > 1e-4 < np.linalg.norm(motion[3:])
    directions = rng.normal(size=(6, 6))
    # an image jumps where primitives change their order: of three lengths one at most meets that
    slopes = [[(loss(motion + h * d) - loss(motion - h * d)) / (2 * h) for d in directions] for h in (1e-4, 3e-5, 1e-5)]
    expected = np.median(slopes, axis=0)
    loss(motion)  # moves it back
    before = np.array(state.gradient.numpy(), np.float64).reshape(-1, 6)
    trainer.step()
    by_pose = np.array(state.gradient.numpy(), np.float64).reshape(-1, 6)
    others = np.arange(VIEWS) != view
    assert np.array_equal(by_pose[others], before[others]) and not before[view].any()
    got = directions @ motion_gradient(state.given, state.motions, trainer.extent, by_pose)[view]
    np.testing.assert_allclose(got, expected, atol=0.05 * np.abs(expected).max())


def test_gradients_are_sums_of_lanes_though_nobody_waits_for_those_of_a_view(data, at_once, ordered, monkeypatch):
    """Of several views in a step: what is added to an array before it is evaluated may be lost.

    The trap is told in docs/performance/traps.md.
    """
    dataset, config = load_dataset(data), config_of(data, batch_views=3)
    expected, after_backward = np.zeros((VIEWS, 6)), PoseRefinement.after_backward

    def waits(rule: PoseRefinement, t: Training, state: Poses, seen: Seen) -> None:
        nudge = seen.camera.nudge
        assert nudge is not None
        expected[seen.view] += [dr.grad(lanes).numpy().astype(np.float64).sum() for lanes in nudge.values]
        after_backward(rule, t, state, seen)

    got = poses_of(stepped(Trainer(config, dataset), 2)).gradient.numpy()  # six of the views
    monkeypatch.setattr(PoseRefinement, "after_backward", waits)
    state = poses_of(stepped(Trainer(config, dataset), 2))
    assert state.turns == 0 and state.counts.sum() == 6 == np.count_nonzero(expected.any(axis=1))
    np.testing.assert_array_equal(got, state.gradient.numpy())
    np.testing.assert_allclose(got.reshape(-1, 6), expected, atol=1e-5 * np.abs(expected).max())


def seen_in_turn(rule: PoseRefinement, trainer: Trainer, state: Poses, views: Any, by_pose: np.ndarray) -> None:
    """Views are seen one by one, each with its row of gradients [V, 6]."""
    for view in views:
        camera = rule.camera(trainer, state, view, trainer.photographs.cameras[view])
        assert camera.nudge is not None
        for value, gradient in zip(camera.nudge.values, by_pose[view], strict=True):
            lanes = np.zeros(trainer.optimizer.n)
            lanes[:2] = 0.25 * gradient, 0.75 * gradient  # what the lanes add up to
            dr.set_grad(value, mi.Float(lanes))
        rule.after_backward(trainer, state, Seen(view, camera, {}, cast(Any, None), [], [], None, True))
        dr.eval(state.gradient)  # as the step of the model does
        trainer.step_count += 1
        rule.after_step(trainer, state)


def after_turns(data: Path, rule: PoseRefinement, turns: int, by_pose: np.ndarray, steps: int = 700) -> Poses:
    trainer = Trainer(config_of(data, steps=steps), load_dataset(data))
    state = rule.new_state(trainer)
    for _ in range(turns):
        seen_in_turn(rule, trainer, state, range(VIEWS), by_pose)
    assert state.turns == turns
    expected = moved_w2c(state.given, state.motions, trainer.extent)
    for k, view in enumerate(trainer.photographs.originals):
        np.testing.assert_allclose(view.camera.w2c, expected[k], atol=1e-12)
    assert np.abs(common_motions(state.given, trainer.extent).T @ state.motions.ravel()).max() < 1e-12
    return state


@pytest.fixture(scope="module")
def gradients() -> np.ndarray:
    """[V, 6] of some views, with nothing quiet about them."""
    return 0.05 * np.random.default_rng(0).normal(size=(VIEWS, 6)).astype(np.float32)


@pytest.mark.parametrize("first", [[], [5, 2], [6, 1, 3, 0]], ids=["a turn", "2 views before", "4 views before"])
def test_views_step_together_once_each_was_seen_and_count_alike(data, gradients, first):
    """Wherever in a turn it begins: what was seen twice has no more to say, and nobody steps without a gradient."""
    rule = PoseRefinement(start=0)
    expected = after_turns(data, rule, 1, gradients).motions
    trainer = Trainer(config_of(data, steps=700), load_dataset(data))
    state = rule.new_state(trainer)
    turn = [2, 6, 0, 5, 1, 3, 4]
    seen_in_turn(rule, trainer, state, [*first, *turn[:-1]], gradients)
    assert state.turns == 0 and not state.motions.any()
    trainer.step_count = VIEWS - 1  # step sizes fall with the steps that are done
    seen_in_turn(rule, trainer, state, turn[-1:], gradients)
    assert state.turns == 1 and not state.gradient.numpy().any()
    assert np.abs(expected).max() > 1e-4
    np.testing.assert_allclose(state.motions, expected, atol=1e-5 * np.abs(expected).max())


def test_what_is_quiet_stays_and_what_is_loud_moves_by_what_is_beyond(data, gradients):
    """Of one view alone; a step is a straight line in the length of its gradient, from where it is loud."""
    one = np.zeros_like(gradients)
    one[3] = gradients[3]

    def motion(length: float, quiet: float) -> np.ndarray:
        return after_turns(data, PoseRefinement(start=0, quiet=quiet), 1, length * one).motions

    free = motion(1.0, 0.0)
    lost = free - motion(1.0, 0.05)
    threshold = float(np.linalg.norm(lost) / np.linalg.norm(free))  # length at which 0.05 is reached
    assert 0 < threshold < 0.5
    np.testing.assert_allclose(lost, threshold * free, atol=1e-5 * np.abs(free).max())
    assert not motion(0.99 * threshold, 0.05).any() and motion(1.01 * threshold, 0.05).any()
    np.testing.assert_allclose(motion(2.0, 0.05), (2 - threshold) * free, atol=1e-5 * np.abs(free).max())
    np.testing.assert_allclose(free - motion(1.0, 0.1), 2 * lost, atol=1e-5 * np.abs(free).max())


def test_motions_come_as_far_in_few_turns_as_in_many_and_steps_fall(data, gradients):
    """By ``reach`` in all, if the gradient stays; the last step has ``fall`` of the first."""
    rule = PoseRefinement(start=0, reach=0.01, fall=0.1, pull=0, quiet=0, memory=0)
    small = 0.1 * gradients  # motions are small, so that gradients by them hardly turn
    first, last = (after_turns(data, rule, turns, small, VIEWS * turns) for turns in (20, 80))
    few, many = first.motions, last.motions
    np.testing.assert_allclose(many, few, atol=0.1 * np.abs(few).max())
    asked = np.einsum("vij,vj->vi", last.scales, last.mean)  # for a step size of 1
    extent = Trainer(config_of(data), load_dataset(data)).extent
    whole = without_common(-rule.reach * asked, common_motions(last.given, extent))
    np.testing.assert_allclose(many, whole, atol=0.04 * np.abs(whole).max())
    half = after_turns(data, replace(rule, reach=0.005), 20, small, VIEWS * 20).motions
    np.testing.assert_allclose(half, few / 2, atol=0.02 * np.abs(few).max())
    steps = [after_turns(data, rule, turns, small, VIEWS * 20).motions for turns in (1, 19, 20)]
    ratio = np.linalg.norm(steps[2] - steps[1]) / np.linalg.norm(steps[0])
    assert ratio == pytest.approx(0.1 ** (19 / 20), rel=0.05)


def test_where_nothing_is_asked_for_motions_go_back(data, gradients):
    rule = PoseRefinement(start=0, pull=0.03, fall=0.999, quiet=1e-3, memory=0)
    trainer = Trainer(config_of(data, steps=700), load_dataset(data))
    state = rule.new_state(trainer)
    seen_in_turn(rule, trainer, state, range(VIEWS), gradients)
    moved = state.motions.copy()
    seen_in_turn(rule, trainer, state, range(VIEWS), np.zeros_like(gradients))
    np.testing.assert_allclose(state.motions, 0.97 * moved, atol=1e-3 * np.abs(moved).max())


def test_radiance_in_another_unit_gives_the_same_motions(tmp_path, at_once):
    """A power of two, which rounds nothing otherwise. Atomics do: in two turns, steps by signs made .3 % of it."""
    dataset = load_dataset(write_hdr_data(tmp_path / "data"))

    def motions(factor: float) -> np.ndarray:
        train = [
            View(v.name, v.camera, v.image * np.float32(factor), white=factor * (v.white or 1)) for v in dataset.train
        ]
        trainer = Trainer(config_of(tmp_path / "data"), replace(dataset, train=train, test=[]))
        return poses_of(stepped(trainer, 2 * len(train))).motions

    expected = motions(1.0)
    assert np.abs(expected).max() > 1e-3
    near = 1e-3 if lanes_add_in_turn(mi.variant()) else 1e-2
    np.testing.assert_allclose(motions(1024.0), expected, atol=near * np.abs(expected).max())


def test_half_of_a_photograph_asks_for_as_much_as_all_of_it(data, tmp_path, gradients):
    """Masked pixels count in the mean that the loss is, so gradients halve; what is behind the mask says nothing."""
    dataset, rng = load_dataset(data), np.random.default_rng(0)
    height, width = dataset.train[0].image.shape[:2]
    mask = np.zeros((height, width), np.uint8)
    mask[:, width // 2 :] = 255
    (tmp_path / "masks").mkdir()
    for view in dataset.train:
        Image.fromarray(mask).save(tmp_path / "masks" / f"{Path(view.name).stem}.png")
    images = rng.uniform(size=(VIEWS, height, width, 3)).astype(np.float32)
    rule = PoseRefinement(start=0, quiet=0.05)

    def motions(images: np.ndarray, by_pose: np.ndarray, masks: str | None = str(tmp_path / "masks")) -> np.ndarray:
        train = [View(v.name, v.camera, image) for v, image in zip(dataset.train, images, strict=True)]
        trainer = Trainer(config_of(data, steps=700, masks=masks), replace(dataset, train=train, test=[]))
        state = rule.new_state(trainer)
        seen_in_turn(rule, trainer, state, range(VIEWS), by_pose)
        return state.motions

    got, expected = motions(images, gradients / 2), motions(images, gradients, None)
    assert np.abs(expected).max() > 1e-4
    np.testing.assert_allclose(got, expected, atol=0.05 * np.abs(expected).max())
    flat = images * (mask[..., None] > 0)
    np.testing.assert_array_equal(motions(flat, gradients / 2), got)


def test_the_record_has_the_median_turn_and_shift():
    motion = np.array([0.03, 0, -0.04, 0.2, -0.1, 0.2])  # a turn of .05, in radians, and a shift of .3
    state: Any = SimpleNamespace(motions=motion * np.array([[10], [1], [-2]]))
    (event,) = PoseRefinement().end(cast(Training, None), state)
    assert event.record == {"kind": "poses_refined", "shift": pytest.approx(0.6), "turn": pytest.approx(5.729578)}


def test_the_mean_over_turns_weighs_the_last_ones_most_and_begins_with_the_first(data, gradients):
    """.8 of the turn before: (.8 · .2 g + .2 · 0) / (1 - .8²) where the second turn asks for nothing."""
    rule = PoseRefinement(start=0, reach=0.01, fall=0.999, pull=0, quiet=0)
    small = 0.1 * gradients
    expected = after_turns(data, replace(rule, memory=0.0), 1, small).motions
    trainer = Trainer(config_of(data, steps=700), load_dataset(data))
    state = rule.new_state(trainer)
    for by_pose, steps in ((small, 1), (np.zeros_like(small), 1 + 0.16 / 0.36)):
        seen_in_turn(rule, trainer, state, range(VIEWS), by_pose)
        np.testing.assert_allclose(state.motions, steps * expected, atol=5e-3 * np.abs(expected).max())


def test_a_view_whose_gradient_is_no_number_asks_for_nothing(data, gradients):
    rule, found = PoseRefinement(start=0), []
    for value in (0.0, np.nan):
        trainer = Trainer(config_of(data, steps=700), load_dataset(data))
        state = rule.new_state(trainer)
        by_pose = gradients.copy()
        by_pose[2] = 0
        seen_in_turn(rule, trainer, state, range(VIEWS - 1), by_pose)
        sums = state.gradient.numpy()
        sums[6 * 2 + 4] = value
        state.gradient = mi.Float(sums)
        seen_in_turn(rule, trainer, state, [VIEWS - 1], by_pose)
        found.append(state.motions)
    assert np.abs(found[0]).max() > 1e-4
    np.testing.assert_array_equal(*found)
