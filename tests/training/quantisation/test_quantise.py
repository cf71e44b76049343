"""Straight-through quantisation: the device draws what a file says, and a training ends with the model of its file."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from happenings import history_of
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.formats.coded import CODED, snapped
from mi_dogsplat.formats.grids import Extents, FileGrids, Palette, Steps
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.symmetries import nearest_to_identity
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.events import Quantised
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.quantisation.quantiser import Coding, Quantiser
from mi_dogsplat.training.quantisation.straight_through import DeviceGrid, StraightThrough
from mi_dogsplat.training.strategy.quantise import SHARE, Quantisation
from mi_dogsplat.training.train import Trainer
from splat_scenes import random_splats, rounded

ULP = 2.0**-24  # of a number from 0.5 to 1, as the largest component of a quaternion is
STEPS = 60
LONG = 400


def tables(name: str, model: Splats) -> tuple[FileGrids, Palette]:
    grids = CODED[name](Extents.of(model), Steps())
    return grids, grids.palette(model, 1 / 8)


@pytest.mark.parametrize("degree", [0, 2, 3])
@pytest.mark.parametrize("name", CODED)
def test_the_device_has_the_numbers_of_the_file(name, degree, tmp_path):
    """Oracle: the codec itself, from the bytes of a file."""
    model = nearest_to_identity(rounded(random_splats(500, seed=degree, degree=degree, dog_share=0)))
    grids, palette = tables(name, model)
    optimizer = SplatOptimizer(model, LearningRates(1.0, 10))
    found = StraightThrough(grids, palette, optimizer.bands)(optimizer.params)
    for key, value in found.items():
        optimizer.assign(key, value.numpy().reshape(optimizer.numpy(key).shape))
    write_model(tmp_path / f"model.{name}", optimizer.to_splats())
    back, device = read_model(tmp_path / f"model.{name}").splats, optimizer.to_splats()
    back, device = (m.select(np.lexsort(m.means.T)) for m in (back, device))
    for values in ("means", "log_scales", "logit_opacities", "sh_coeffs"):
        assert np.array_equal(getattr(back, values), getattr(device, values)), values
    assert np.array_equal(back.quats[:, :3], device.quats[:, :3])
    assert np.abs(back.quats[:, 3] - device.quats[:, 3]).max() <= ULP


def test_any_quaternion_keeps_its_sign_and_the_component_that_is_left_out():
    model = rounded(random_splats(300, seed=4, degree=0, dog_share=0))
    grids, palette = tables("spz", model)
    found = StraightThrough(grids, palette, ())(SplatOptimizer(model, LearningRates(1.0, 10)).params)["quats"]
    found, unit = found.numpy().reshape(-1, 4), model.quats / np.linalg.norm(model.quats, axis=1, keepdims=True)
    assert np.linalg.norm(found, axis=1) == pytest.approx(1, abs=1e-6)
    assert np.abs(found - unit).max() < 4 * Steps().rotation / 511


@pytest.mark.parametrize("name", CODED)
def test_device_and_host_round_alike_to_the_bit(name):
    """Numbers at the cuts, around them, and far beyond the ends; denormal ones are 0 on the device."""
    model = rounded(random_splats(200, seed=0, degree=1, dog_share=0))
    grids = tables(name, model)[0]
    for grid in (*grids.means, grids.log_scales, grids.three, grids.logit_opacities, grids.sh_dc, grids.sh_rest):
        near = [np.nextafter(grid.cuts, np.float32(end)) for end in (-np.inf, np.inf)]
        x = np.concatenate([grid.cuts, *near, grid.values, [-1e30, 1e30]]).astype(np.float32)
        x = x[(x == 0) | (np.abs(x) > np.finfo(np.float32).tiny)]
        assert np.array_equal(DeviceGrid(grid)(mi.Float(x)).numpy(), grid.snap(x))


def test_gradients_pass_straight_through():
    model = rounded(random_splats(50, seed=1, degree=2, dog_share=0))
    optimizer = SplatOptimizer(model, LearningRates(1.0, 10))
    params = optimizer.params
    found = StraightThrough(*tables("sog", model), optimizer.bands)(params)
    rng = np.random.default_rng(0)
    sent = {name: rng.normal(size=dr.width(value)).astype(np.float32) for name, value in found.items()}
    for name, value in found.items():
        dr.set_grad(value, mi.Float(sent[name]))
        dr.enqueue(dr.ADMode.Backward, value)
    dr.traverse(dr.ADMode.Backward)
    for name, value in params.items():
        assert np.array_equal(dr.grad(value).numpy(), sent[name]), name


# --- trainings ---


def config_of(data, **changes) -> TrainConfig:
    usual: dict[str, Any] = {"preset": "3dgs", "steps": STEPS, "sh_degree": 1, "max_primitives": 300}
    return TrainConfig(str(data), **(usual | {"log_every": 10, "test_every": 30, "format": "sog"} | changes))


def trained(trainer: Trainer, until: int = STEPS) -> Trainer:
    trainer.begin()
    while trainer.step_count < until:
        trainer.step()
    return trainer


def test_a_training_for_ply_has_no_quantisation_and_one_for_others_no_dog(data):
    dataset = load_dataset(data)
    for preset in ("ours", "3dgs"):
        names = {name: Trainer(config_of(data, preset=preset, format=name), dataset).states for name in ("ply", "spz")}
        assert "quantisation" not in names["ply"] and "quantisation" in names["spz"]
        assert not {"dogcontrol", "dogactivation"} & set(names["spz"])


def test_nothing_is_rounded_before_the_last_part(data):
    dataset = load_dataset(data)
    until = STEPS - round(SHARE * STEPS)
    plain, quantised = (trained(Trainer(config_of(data, format=f), dataset), until) for f in ("ply", "spz"))
    tables = quantised.states["quantisation"]
    assert tables.palette is None  # nor was there one before: what was drawn is the model
    if lanes_add_in_turn(mi.variant()):  # else no two trainings have the same bits
        states = plain.state(), quantised.state()
        assert all(np.array_equal(a, states[1][name]) for name, a in states[0].items() if "optimizer" in name)
    quantised.step()
    assert tables.palette is not None


@pytest.mark.parametrize("name", CODED)
def test_the_model_of_a_run_is_that_of_its_file(data, name, tmp_path):
    from mi_dogsplat.runs.evaluation import evaluate_model
    from mi_dogsplat.runs.run import train

    metrics = train(config_of(data, format=name), tmp_path / "run")
    path = tmp_path / "run" / f"point_cloud.{name}"
    back, ply = (m.select(np.lexsort(m.means.T)) for m in (read_model(path).splats, read_ply(path.with_suffix(".ply"))))
    assert metrics["bytes"] == path.stat().st_size and back.n_splats == ply.n_splats
    for values in ("means", "log_scales", "logit_opacities", "sh_coeffs"):
        assert np.array_equal(getattr(back, values), getattr(ply, values)), values
    views = evaluate_model(path, data)
    assert np.mean([v["psnr"] for v in views.values()]) == pytest.approx(metrics["test"]["psnr"], abs=1e-3)
    rows = history_of(tmp_path / "run")
    assert any(event["kind"] == "quantised" for row in rows for event in row.get("events", []))


def test_grids_and_palette_follow_in_fifteen_rounds_and_are_left_alone_in_the_last_quarter(monkeypatch):
    renewed, step = [], 0
    quantiser, coding = Quantiser("sog"), Coding(degrees=np.zeros(1, np.int64), labels=np.zeros(4, np.int64))
    monkeypatch.setattr(Quantiser, "_renew", lambda *_: renewed.append(step))
    optimizer = SplatOptimizer(rounded(random_splats(4, degree=0, dog_share=0)), LearningRates(1.0, 10))
    for step in range(300):
        quantiser.before_step(coding, optimizer, [], RasterOptions(), step, 300)
    assert renewed == list(range(0, 226, 15))
    coding.degrees[:] = 1  # other bands than those of the model: at once
    quantiser.before_step(coding, optimizer, [], RasterOptions(), step, 300)
    assert renewed[-1] == step == 299


@pytest.mark.slow
def test_a_run_that_sees_its_file_loses_less_than_one_that_is_rounded_at_the_end(data):
    """The coarser the grids, the plainer: scales in steps of 1, positions in those of two small scales."""
    dataset, steps = load_dataset(data), replace(Steps(), log_scale=16, position=2.0)
    recipe = replace(RECIPES["3dgs"], quantisation=Quantisation("sog", steps))
    seen = trained(Trainer(config_of(data, format="ply", steps=LONG), dataset, recipe), LONG)
    plain = trained(Trainer(config_of(data, format="ply", steps=LONG), dataset), LONG)
    rounded_at_the_end = snapped("sog", plain.optimizer.to_splats(), steps)
    errors = []
    for model in (seen.optimizer.to_splats(), rounded_at_the_end, plain.optimizer.to_splats()):
        seen.optimizer = SplatOptimizer(model, LearningRates(1.0, 10))
        errors.append(seen.training_l1())
    assert errors[2] < errors[0] < errors[1]


@pytest.mark.parametrize("stop", [52, 57])
def test_a_run_that_is_resumed_in_its_last_part_has_the_same_bits(data, stop, ordered):
    dataset = load_dataset(data)
    whole = trained(Trainer(config_of(data), dataset))
    state = trained(Trainer(config_of(data), dataset), stop).state()
    again = Trainer(config_of(data), dataset)
    again.restore(state)
    trained(again)
    for name, values in whole.state().items():
        assert name == "seconds" or np.array_equal(values, again.state()[name]), name


def test_primitives_that_leave_take_their_labels_along(data):
    trainer = trained(Trainer(config_of(data), load_dataset(data)), 50)
    state = trainer.states["quantisation"]
    before, keep = state.labels.copy(), np.arange(0, trainer.optimizer.n, 2)
    trainer.optimizer.keep(keep)
    assert np.array_equal(state.labels, before[keep]) and len(state.weights) == len(keep)
    trainer.step()
    assert trainer.optimizer.n == len(keep)
    assert Quantised("sog", 3).text == "quantised for sog: palette of 3"


@pytest.mark.parametrize("name", CODED)
def test_bands_that_are_not_there_stay_zero(data, name, tmp_path):
    """Primitives of degree 0 and 1 mixed, set as compaction sets them, before and while the file is seen."""
    trainer = trained(Trainer(config_of(data, format=name), load_dataset(data)), 40)
    degrees = np.arange(trainer.optimizer.n) % 2
    trainer.optimizer.set_sh_degrees(degrees)
    shape = trainer.optimizer.numpy("sh1_coeffs").shape
    trainer.optimizer.assign("sh1_coeffs", np.random.default_rng(0).normal(size=shape) * 0.3)  # none rounds to zero
    trained(trainer, 55)
    assert np.array_equal(trainer.optimizer.sh_degrees, degrees)
    degrees = np.where(np.arange(len(degrees)) % 3, degrees, 0)
    trainer.optimizer.set_sh_degrees(degrees)
    trained(trainer)
    model = trainer.optimizer.to_splats()
    assert model.mixed_sh and np.bincount(model.sh_degrees)[1] <= (degrees == 1).sum()
    write_model(tmp_path / f"model.{name}", model)
    back = read_model(tmp_path / f"model.{name}").splats
    has_bands = np.abs(back.sh_coeffs[:, 1:]).max(axis=(1, 2)) > 0
    assert has_bands.sum() == (model.sh_degrees == 1).sum() > 0
