"""Poses of the training views: their gradient, their steps, what is found again, what is kept, what it costs."""

from dataclasses import dataclass, replace
from pathlib import Path

import drjit as dr
import numpy as np
import pytest
import tiny_data
from happenings import history_of
from launches import launches
from mi_dogsplat import write_ply
from mi_dogsplat.datasets import Dataset, camera_extent, load_dataset
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.report.write import write_report
from mi_dogsplat.runs import run
from mi_dogsplat.scene.camera_motions import common_motions, moved_w2c, without_common
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training import resolve
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.densify import Densification
from mi_dogsplat.training.strategy.pose_refinement import PoseRefinement
from mi_dogsplat.training.strategy.strategy import Seen, Strategy, Training, arrays_of
from mi_dogsplat.training.train import Trainer
from refined_poses import VIEWS, config_of, poses_of, stepped

from benchmarks.poses.pose_error import PoseError, pose_error


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
    train = [replace(v, camera=replace(v.camera, w2c=at)) for v, at in zip(given.train, moved, strict=True)]
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


def test_of_a_model_that_exists_poses_step_from_the_beginning(data, tmp_path):
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    config = config_of(data, preset="ours", model=str(tmp_path / "model.ply"), max_primitives=None)
    assert poses_of(stepped(Trainer(config, load_dataset(data)), VIEWS)).turns == 1
    assert PoseRefinement(start=16_000).earlier(15_000).scaled(0.1).start == 100


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
    monkeypatch.setattr(resolve, "PoseRefinement", lambda: PoseRefinement(start=20_000))
    dataset = load_dataset(data)
    trainers = [Trainer(config_of(data, refine_poses=on), dataset) for on in (False, True)]
    launched = [[(k.kind, k.size) for k in launches(trainer.step)] for trainer in trainers]
    assert launched[0] == launched[1]
    off, on = trainers
    assert "poserefinement" not in off.states and poses_of(on).turns == 0
    np.testing.assert_array_equal(on.optimizer.numpy("means"), off.optimizer.numpy("means"))


def test_what_a_step_costs_does_not_grow_with_the_number_of_views(data, at_once):
    dataset = load_dataset(data)
    more = replace(dataset, train=[replace(v, name=f"{v.name}_{k}") for k in range(4) for v in dataset.train])
    counts = [len(launches(Trainer(config_of(data), d).step)) for d in (dataset, more)]
    off = len(launches(Trainer(config_of(data, refine_poses=False), dataset).step))
    assert counts[0] == counts[1] and off < counts[0] <= off + 20


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
    rows = history_of(out)
    assert rows[-1]["events"][0]["kind"] == "poses_refined"
    page = write_report(out).read_text()
    assert "How far the cameras moved" in page and page.count('"moved"') == 1
    again = run.train(config_of(data, steps=3 * VIEWS), out, resume=True)
    assert again["poses"] == moved
    with pytest.raises(DataError, match="is the run that its data come from; name another folder"):
        run.train(config_of(out / "refined"), out)
    run.train(config_of(data, steps=5, refine_poses=False), out)
    assert not (out / "refined" / "transforms.json").exists()


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
