"""Poses of the training views: their gradient, their steps, what is found again, what is kept, what it costs."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from hdr_data import write_hdr_data
from launches import launches
from mi_dogsplat.datasets import Dataset, camera_extent, load_dataset
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.datasets.dataset import View, seen_by
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.report.write import write_report
from mi_dogsplat.runs import finish as finish_module
from mi_dogsplat.runs import run
from mi_dogsplat.scene.camera_motions import common_motions, motion_gradient, moved_w2c, without_common
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training import train as train_module
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.densify import Densification
from mi_dogsplat.training.strategy.pose_refinement import PoseRefinement, Poses
from mi_dogsplat.training.strategy.strategy import Seen, Strategy, Training, arrays_of
from mi_dogsplat.training.train import Trainer
from PIL import Image
from splat_scenes import SMOOTH_OPTIONS

from benchmarks.pose_error import PoseError, pose_error

VIEWS = 7  # of the tiny data, for training


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {
        "preset": "3dgs", "steps": 60, "sh_degree": 1, "max_primitives": 100, "log_every": 10, "refine_poses": True,
    }  # fmt: skip
    return TrainConfig(str(data), **(base | changes))


@pytest.fixture
def at_once(monkeypatch) -> None:
    """Poses are refined from the first step on."""
    monkeypatch.setattr(train_module, "PoseRefinement", lambda: PoseRefinement(start=0))


def poses_of(trainer: Trainer) -> Poses:
    return trainer.states["poserefinement"]


def stepped(trainer: Trainer, steps: int) -> Trainer:
    for _ in range(steps):
        trainer.step()
    return trainer


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
    """Of several views in a step: what is added to an array before it is evaluated may be lost (performance.md)."""
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
    few, many = (after_turns(data, rule, turns, small, VIEWS * turns).motions for turns in (20, 80))
    np.testing.assert_allclose(many, few, atol=0.1 * np.abs(few).max())
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
    """A power of two, which rounds nothing otherwise."""
    dataset = load_dataset(write_hdr_data(tmp_path / "data"))

    def motions(factor: float) -> np.ndarray:
        train = [
            View(v.name, v.camera, v.image * np.float32(factor), white=factor * (v.white or 1)) for v in dataset.train
        ]
        trainer = Trainer(config_of(tmp_path / "data"), replace(dataset, train=train, test=[]))
        return poses_of(stepped(trainer, 2 * len(train))).motions

    expected = motions(1.0)
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(motions(1024.0), expected, atol=1e-3 * np.abs(expected).max())


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


@dataclass(frozen=True)
class Frozen(Strategy[None]):
    """The model stays as it is."""

    def after_backward(self, t: Training, state: None, seen: Seen) -> None:
        for value in t.optimizer.params.values():
            dr.clear_grad(value)


@pytest.fixture(scope="module")
def room() -> tuple[Splats, Dataset]:
    """A model all around and at all depths, so that turns and shifts look different, and its pictures."""
    rng, n = np.random.default_rng(0), 120
    z = rng.uniform(1, 6, n)
    model = Splats(
        means=np.column_stack([rng.uniform(-1, 1, (n, 2)) * (0.6 + z[:, None]), z]),
        log_scales=np.log(rng.uniform(0.06, 0.15, (n, 3)) * z[:, None]),
        quats=rng.normal(size=(n, 4)),
        logit_opacities=rng.uniform(1, 4, n),
        sh_coeffs=(rng.uniform(0.05, 0.95, (n, 1, 3)) - 0.5) / C0,
    )
    views, (width, height) = [], (48, 36)
    for k in range(9):
        x, y = k // 3 - 1, k % 3 - 1
        w2c = look_at(np.array([1.2 * x, y, 0.8 * (k % 2) - 1.9]), np.array([0.3 * y, 0.3 * x, 3.0]), "-y")
        camera = Camera(w2c, width / 2, width / 2, width / 2, height / 2, width, height)
        image = render_picture(upload(model), camera, RasterOptions(sh_degree=0)).color
        views.append(View(str(k), camera, image.astype(np.float32)))
    colors = 0.5 + C0 * model.sh_coeffs[:, 0]
    return model, Dataset(Path("room"), views, [], model.means, colors.astype(np.float32), False)


def found(room: tuple[Splats, Dataset], wrong: Dataset, *strategies: Strategy, steps: int = 250) -> Trainer:
    """Trained from the model that the photographs were made of, without densification."""
    recipe = replace(RECIPES["3dgs"], densification=Densification(start=0, stop=0), also=strategies)
    config = config_of(Path("room"), steps=steps, sh_degree=0, max_primitives=None)
    trainer, model = Trainer(config, wrong, recipe), room[0]
    for name in ("means", "log_scales", "quats", "logit_opacities"):
        trainer.optimizer.assign(name, getattr(model, name))
    trainer.optimizer.assign("sh_dc", model.sh_coeffs[:, 0])
    return stepped(trainer, steps)


def errors(given: Dataset, views: list[View]) -> PoseError:
    exact, seen = ({view.name: view.camera for view in some} for some in (given.train, views))
    return pose_error(exact, seen)


@pytest.mark.parametrize("strategies", [(), (Frozen(),)], ids=["together with the model", "by a model that is right"])
def test_poses_that_were_perturbed_are_found_again(room, at_once, strategies):
    """Errors of 0.7 degrees and 1.2 % of the extent fall to a third of that at most."""
    given = room[1]
    w2c, extent = np.array([view.camera.w2c for view in given.train]), camera_extent(given.train)
    noise = np.random.default_rng(0).normal(scale=0.01, size=(len(w2c), 6))
    moved = moved_w2c(w2c, without_common(noise, common_motions(w2c, extent)), extent)  # a frozen model sees the rest
    train = [seen_by(v, replace(v.camera, w2c=at)) for v, at in zip(given.train, moved, strict=True)]
    wrong = replace(given, train=train)
    trainer = found(room, wrong, *strategies)
    before, after = errors(given, wrong.train), errors(given, trainer.photographs.originals)
    assert before.angle > 0.7 and before.position > 0.011
    assert after.angle < before.angle / 3 and after.position < before.position / 3
    state = poses_of(trainer)
    common = common_motions(state.given, trainer.extent).T @ state.motions.ravel()
    assert np.abs(common).max() < 1e-12 < 1e-3 < np.abs(state.motions).max()


def test_without_the_option_no_camera_moves(data):
    dataset = load_dataset(data)
    trainer = stepped(Trainer(config_of(data, refine_poses=False), dataset), 2 * VIEWS)
    assert all(a is b for a, b in zip(trainer.photographs.originals, dataset.train, strict=True))


def test_a_run_that_goes_on_has_the_bits_of_one_that_was_not_stopped(data, at_once, ordered):
    config, dataset = config_of(data), load_dataset(data)
    first = stepped(Trainer(config, dataset), 2 * VIEWS + 3)  # in the middle of a turn
    state = {name: np.array(value) for name, value in first.state().items()}
    second = Trainer(config, dataset)
    second.restore(state)
    second.begin()
    for trainer in (first, second):
        stepped(trainer, 2 * VIEWS)
    for name, value in arrays_of(poses_of(first)).items():
        np.testing.assert_array_equal(arrays_of(poses_of(second))[name], value)
    np.testing.assert_array_equal(second.optimizer.numpy("means"), first.optimizer.numpy("means"))
    np.testing.assert_array_equal(second.photographs.positions, first.photographs.positions)


def test_before_it_starts_it_changes_no_bit_and_launches_nothing(data, monkeypatch, ordered):
    monkeypatch.setattr(train_module, "PoseRefinement", lambda: PoseRefinement(start=20_000))
    dataset = load_dataset(data)
    trainers = [Trainer(config_of(data, refine_poses=on), dataset) for on in (False, True)]
    launched = [[(k.kind, k.size) for k in launches(trainer.step)] for trainer in trainers]
    assert launched[0] == launched[1]
    off, on = trainers
    assert "poserefinement" not in off.states and poses_of(on).turns == 0
    np.testing.assert_array_equal(on.optimizer.numpy("means"), off.optimizer.numpy("means"))


def test_what_a_step_costs_does_not_grow_with_the_number_of_views(data, at_once):
    dataset = load_dataset(data)
    more = replace(dataset, train=[replace_name(v, f"{v.name}_{k}") for k in range(4) for v in dataset.train])
    counts = [len(launches(Trainer(config_of(data), d).step)) for d in (dataset, more)]
    off = len(launches(Trainer(config_of(data, refine_poses=False), dataset).step))
    assert counts[0] == counts[1] and off < counts[0] <= off + 20


def replace_name(view: Any, name: str) -> Any:
    other = seen_by(view, view.camera)
    object.__setattr__(other, "name", name)
    return other


def test_a_run_leaves_the_refined_poses_as_a_data_set_and_tells_how_far_cameras_moved(data, tmp_path, at_once):
    out = tmp_path / "run"
    metrics = run.train(config_of(data, steps=3 * VIEWS), out)
    given, refined = load_dataset(data), load_dataset(out / "refined")
    names = [[view.name for view in views] for views in (given.train, given.test)]
    assert [[view.name for view in views] for views in (refined.train, refined.test)] == names
    np.testing.assert_array_equal(refined.points, given.points)
    moved = metrics["poses"]
    assert list(moved) == names[0] and all(motion["shift"] > 0 for motion in moved.values())
    for before, after in zip(given.train, refined.train, strict=True):
        np.testing.assert_array_equal(after.image, before.image)
        shift = np.linalg.norm(after.camera.position - before.camera.position)
        assert shift / camera_extent(given.train) == pytest.approx(moved[before.name]["shift"], rel=1e-6)
    for before, after in zip(given.test, refined.test, strict=True):
        np.testing.assert_allclose(after.camera.w2c, before.camera.w2c, atol=1e-12)
    assert metrics["test"]["aligned_psnr"] >= metrics["test"]["psnr"]
    assert "aligned_psnr" not in metrics["train"]
    rows = [json.loads(line) for line in (out / "history.jsonl").read_text().splitlines()]
    assert rows[-1]["events"][0]["kind"] == "poses_refined"
    page = write_report(out).read_text()
    assert "How far the cameras moved" in page and page.count('"moved"') == 1
    again = run.train(config_of(data, steps=3 * VIEWS), out, resume=True)
    assert again["poses"] == moved
    with pytest.raises(DataError, match="is the run that its data come from; name another folder"):
        run.train(config_of(out / "refined"), out)
    run.train(config_of(data, steps=5, refine_poses=False), out)
    assert not (out / "refined" / "transforms.json").exists()


def test_the_metrics_are_there_when_the_poses_cannot_be_written(data, tmp_path, monkeypatch):
    def full(trainer: Trainer, out: Path) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(finish_module, "write_poses", full)
    with pytest.raises(DataError, match="no space left"):
        run.train(config_of(data, steps=2), tmp_path / "run")
    assert len(json.loads((tmp_path / "run" / "metrics.json").read_text())["poses"]) == VIEWS


def test_the_cameras_of_a_scene_are_exact_and_refused(tmp_path):
    scene = tmp_path / "scene.xml"
    scene.write_text("<scene version='3.0.0'/>")
    with pytest.raises(DataError, match="scene.xml: the cameras of a scene are exact; train without --refine-poses"):
        run.train(config_of(scene), tmp_path / "run")


def test_several_views_in_a_step_and_pictures_that_are_smaller_for_a_while(data, at_once):
    trainer = Trainer(config_of(data, batch_views=3), load_dataset(data))
    trainer.photographs.shrink(2)
    stepped(trainer, 5)  # 15 views: two turns
    state = poses_of(trainer)
    assert state.turns == 1 and state.counts.sum() == 6 and np.isfinite(state.motions).all()
    small = [camera.w2c for camera in (view.camera for view in trainer.photographs.views)]
    trainer.photographs.shrink(1)
    for k, view in enumerate(trainer.photographs.views):
        np.testing.assert_array_equal(view.camera.w2c, small[k])
        assert view.camera.width == tiny_data.WIDTH and np.abs(view.camera.w2c - state.given[k]).max() > 0
