"""Slopes in a training: they come without a change of the pictures, learn, and go where no pixel shows them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import mi_dogsplat.runs.run
import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line
from command_line import run as dogsplat
from happenings import records
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.learning_rates import LearningRates
from mi_dogsplat.training.optimizer import SplatOptimizer
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.dog_control import DogRule, activate
from mi_dogsplat.training.strategy.slope_activation import SlopeRule, activate_slopes, shown_slopes
from mi_dogsplat.training.tone_curve import SrgbLog
from mi_dogsplat.training.train import Trainer
from splat_scenes import C0, image_of, kernels, options, random_splats, rasterized, rounded, tilted_camera

STEPS = 120
CAMERA = tilted_camera()


def model(slope_share: float = 0.0, dog_share: float = 0.5) -> Splats:
    return rounded(random_splats(40, degree=1, dog_share=dog_share, slope_share=slope_share))


def optimizer_of(splats: Splats, curve: SrgbLog | None = None) -> SplatOptimizer:
    return SplatOptimizer(splats, LearningRates(extent=1.0, total_steps=1000), curve)


def image(optimizer: SplatOptimizer) -> np.ndarray:
    return image_of(rasterize(optimizer.params, DeviceCamera.upload(CAMERA), options(model())), CAMERA)


def step(optimizer: SplatOptimizer) -> None:
    r, g, b = rasterize(optimizer.params, DeviceCamera.upload(CAMERA), options(model())).colors
    dr.backward(dr.square(r - 0.2) + dr.square(g - 0.4) + dr.square(b - 0.2))
    optimizer.step()


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "ours_slopes", "steps": STEPS, "sh_degree": 1, "log_every": 10}
    base |= {"target": 20, "max_primitives": 60}
    return TrainConfig(str(data), **(base | changes))


def rows_of(run: Path) -> list[dict]:
    return [json.loads(line) for line in (run / "history.jsonl").read_text().splitlines()]


# --- they come ---


def test_activation_leaves_the_picture_and_then_every_slope_learns():
    optimizer = optimizer_of(model())
    before = image(optimizer)
    assert activate_slopes(optimizer) == optimizer.n_slopes == 40
    np.testing.assert_allclose(image(optimizer), before, rtol=0, atol=1e-7)
    step(optimizer)
    slopes = optimizer.to_splats().color_slopes
    seen = np.unique(np.nonzero(slopes)[0])
    assert len(seen) > 30 and np.abs(slopes).max() == pytest.approx(2.5e-3, rel=1e-3)


def test_slopes_that_are_there_stay_with_their_moments():
    optimizer = optimizer_of(model(slope_share=0.4))
    step(optimizer)
    before, state = optimizer.to_splats(), optimizer.state()
    assert 5 < before.n_slopes < 30
    activate_slopes(optimizer)
    after, m = optimizer.to_splats(), optimizer.state()["color_slopes.m"].reshape(40, 9)
    np.testing.assert_array_equal(after.color_slopes[before.slope_index], before.color_slopes)
    np.testing.assert_array_equal(m[before.slope_index], state["color_slopes.m"].reshape(-1, 9))
    others = np.delete(np.arange(40), before.slope_index)
    assert not after.color_slopes[others].any() and not m[others].any()


def test_a_primitive_becomes_dog_and_gets_slopes_in_either_order():
    models = []
    for order in ((False, True), (True, False)):
        optimizer = optimizer_of(model(slope_share=0.4, dog_share=0.2))
        for with_slopes in order:
            activate_slopes(optimizer) if with_slopes else activate(DogRule(opacity=0.05), optimizer)
        models.append(optimizer.to_splats())
    for name in Splats.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(models[0], name), getattr(models[1], name), err_msg=name)


# --- they go ---


def test_slopes_go_whose_largest_entry_is_below_the_threshold_and_no_others():
    optimizer = optimizer_of(model(slope_share=0.5))
    n, rng = optimizer.n_slopes, np.random.default_rng(0)
    slopes = rng.uniform(-0.99 / 255, 0.99 / 255, (n, 9))
    large = np.arange(n) % 3 == 0
    slopes[large, rng.integers(0, 9, large.sum())] = rng.choice([-1, 1], large.sum()) * 1.01 / 255
    optimizer.assign("color_slopes", slopes)
    np.testing.assert_array_equal(shown_slopes(SlopeRule(), optimizer), large)
    assert shown_slopes(SlopeRule(least=0.0), optimizer).all()
    assert not shown_slopes(SlopeRule(least=0.1), optimizer).any()


def test_what_goes_is_not_seen():
    """One primitive, all its slopes at the threshold with the signs that add up: 1.05 / 255 by the estimate."""
    one = model(dog_share=0).select([3])
    one.means[:], one.logit_opacities[:], one.log_scales[:] = [0, 0, 3], 10, np.log(0.4)
    sloped = replace(one, slope_index=[0], color_slopes=np.full((1, 3, 3), 1 / 255))
    pictures = [image_of(rasterized(splats, CAMERA), CAMERA) for splats in (one, sloped)]
    change = np.abs(pictures[1] - pictures[0]).max() * 255
    assert 0.5 < change < 1.05


def test_slopes_of_linear_colours_are_seen_through_the_curve_of_the_loss():
    splats = model(slope_share=0.5)
    splats.sh_coeffs[:, 0] = (np.where(np.arange(40) % 2, 0.001, 30.0)[:, None] - 0.5) / C0
    splats.color_slopes[:] = 1 / 255 / 2
    shown = shown_slopes(SlopeRule(), optimizer_of(splats, SrgbLog()))
    np.testing.assert_array_equal(shown, splats.slope_index % 2 == 1)  # in the shadows


def test_without_slopes_left_training_runs_the_kernels_of_one_that_never_had_any():
    plain, optimizer = optimizer_of(model()), optimizer_of(model())
    activate_slopes(optimizer)
    step(optimizer)
    optimizer.set_slopes(np.zeros(0, int), np.zeros((0, 3, 3)))
    assert set(optimizer.params) == set(plain.params)
    step(plain)
    assert kernels(lambda: step(optimizer)) == kernels(lambda: step(plain))


@pytest.mark.parametrize(("changes", "words"), [({"start": -1}, "start"), ({"least": -0.1}, "least")])
def test_a_number_out_of_range_is_refused_by_name(changes, words):
    with pytest.raises(ValueError, match=words):
        SlopeRule(**changes)


def test_the_start_scales_with_the_run():
    assert SlopeRule(start=18_000).scaled(7 / 30) == SlopeRule(start=4200)
    assert SlopeRule().scaled(1e-6).start == 1


# --- a run ---


@pytest.fixture(scope="module")
def sloped_data(tmp_path_factory) -> Path:
    """Pictures of primitives whose colours vary over them."""
    return tiny_data.write_tiny_data(tmp_path_factory.mktemp("sloped"), splats=tiny_data.sloped_truth())


@pytest.fixture(scope="module")
def trained(sloped_data, tmp_path_factory) -> tuple[Path, dict]:
    out = tmp_path_factory.mktemp("runs") / "run"
    return out, mi_dogsplat.runs.run.train(config_of(sloped_data), out)


def test_a_run_tells_when_slopes_come_and_how_many_are_left(trained):
    out, metrics = trained
    rows, splats = rows_of(out), read_ply(out / "point_cloud.ply")
    (come,) = records(rows, "slopes_activated")
    (row,) = [row for row in rows if records([row], "slopes_activated")]
    assert come["count"] == 20 and row["step"] == 72 and records([row], "dog_activated")  # 18,000 of 30,000 steps
    assert "slopes activated for 20 primitives" in row["event"]
    assert all(row["n_slopes"] == 20 * (row["step"] >= 72) for row in rows[:-1])
    assert metrics["n_slopes"] == splats.n_slopes > 10


def test_slopes_bring_the_pictures_nearer_to_colours_that_vary(sloped_data):
    """From one state, before DoG and slopes come."""
    dataset, before = load_dataset(sloped_data), Trainer(config_of(sloped_data, steps=300), load_dataset(sloped_data))
    while before.step_count < 175:
        before.step()
    state, found = before.state(), {}
    for preset in ("ours", "ours_slopes"):
        trainer = Trainer(config_of(sloped_data, steps=300, preset=preset), dataset)
        trainer.restore(state)
        assert trainer.optimizer.n == 20 and trainer.optimizer.n_slopes == 0
        for _ in run_to_end(trainer):
            pass
        found[preset] = trainer.training_l1()
    assert found["ours_slopes"] < 0.85 * found["ours"]


def test_the_end_leaves_out_what_no_pixel_shows_and_says_so(sloped_data):
    trainer = Trainer(config_of(sloped_data), load_dataset(sloped_data))
    while trainer.step_count < STEPS:
        trainer.step()
    slopes = trainer.optimizer.numpy("color_slopes")
    slopes[[2, 11]] = 0.9 / 255
    trainer.optimizer.assign("color_slopes", slopes)
    expected = np.flatnonzero(np.abs(slopes).max(axis=1) >= 1 / 255)
    (event,) = trainer.end()
    gone = 20 - len(expected)
    assert event.record == {"kind": "slopes_left_out", "count": gone, "left": len(expected)} and gone >= 2
    assert event.text == f"slopes of {gone} primitives left out, {len(expected)} have some"
    np.testing.assert_array_equal(trainer.optimizer.slope_index, expected)
    assert trainer.end() == []


def test_a_recipe_without_slopes_says_nothing_of_them(sloped_data, tmp_path):
    metrics = mi_dogsplat.runs.run.train(config_of(sloped_data, preset="ours", steps=12), tmp_path)
    assert "n_slopes" not in metrics and not any("n_slopes" in row for row in rows_of(tmp_path))
    assert "slope" not in (tmp_path / "history.jsonl").read_text()


@pytest.mark.parametrize("preset", ["ours", "ours_slopes"])
def test_a_model_with_slopes_keeps_them_and_they_learn(sloped_data, tmp_path, preset):
    splats = tiny_data.sloped_truth()
    half = replace(splats, slope_index=splats.slope_index[::2], color_slopes=splats.color_slopes[::2])
    write_ply(tmp_path / "model.ply", half)
    config = config_of(sloped_data, model=str(tmp_path / "model.ply"), target=50, preset=preset, max_primitives=None)
    trainer = Trainer(config, load_dataset(sloped_data))
    assert trainer.optimizer.n_slopes == 30
    rows = list(run_to_end(trainer, until=5))
    kept = trainer.optimizer.to_splats()
    assert 15 < kept.n_slopes <= 30 and rows[0]["n_slopes"] <= 30
    assert not np.isin(kept.color_slopes, splats.color_slopes).any()
    rows = list(run_to_end(trainer))
    assert 15 < trainer.optimizer.n_slopes <= (30 if preset == "ours" else 50)
    assert len(records(rows, "slopes_activated")) == (preset == "ours_slopes")


@pytest.mark.parametrize("steps", [1, 2, 3, 12])
def test_the_shortest_runs_complete_every_phase(data, steps):
    trainer = Trainer(config_of(data, steps=steps), load_dataset(data))
    rows = list(run_to_end(trainer))
    assert trainer.optimizer.n == 20 and trainer.states["slopeactivation"].done
    assert [record["count"] for record in records(rows, "slopes_activated")] == [20]


def test_a_recipe_that_does_not_prune_can_have_slopes_too(data):
    recipe = replace(RECIPES["3dgs"], slopes=SlopeRule(start=15_000))
    trainer = Trainer(config_of(data, preset="3dgs", steps=30), load_dataset(data), recipe)
    rows = list(run_to_end(trainer))
    assert records(rows, "slopes_activated")[0]["count"] == trainer.optimizer.n > 20


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_a_format_without_slopes_is_refused_in_one_line(data, capsys, tmp_path, name):
    flags = ["--preset", "ours_slopes", "--format", name]
    result = dogsplat(capsys, "train", data, "-o", tmp_path / "run", *flags)
    problem = f'"ours_slopes" gives slopes to primitives, and {name} does not hold them'
    assert_one_line(result, "--preset", problem, "use ours, or --format ply")
    with pytest.raises(DataError, match="--preset"):
        config_of(data, format=name)
    with pytest.raises(ValueError, match=f"slopes to primitives, which {name} does not hold"):
        RECIPES["ours_slopes"].for_format(name)
    assert RECIPES["ours_slopes"].for_format("ply") is RECIPES["ours_slopes"]
