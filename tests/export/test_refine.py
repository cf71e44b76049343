"""Baked Gaussians refined: nearer to the photographs of a data set, or without one to the model's own pictures."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import mi_dogsplat.export.refine as refine
import mi_dogsplat.export.write as write
import numpy as np
import pytest
import tiny_data
from command_line import run
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.export.bake import baked
from mi_dogsplat.export.export_config import ExportConfig
from mi_dogsplat.export.losses import Views, mean_psnr
from mi_dogsplat.export.refine import BY_DATA, GREY, Goal, Look, by_data, by_renders, refined, steps_for
from mi_dogsplat.export.write import export_model
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.support.srgb import linear_to_srgb

MODEL = tiny_data.dog_model(0.8, 0.6)
USUAL = DrawnAs(near_clip=0.05)


@pytest.fixture
def model(tmp_path):
    write_ply(tmp_path / "model.ply", MODEL)
    return tmp_path / "model.ply"


def goal_of_cameras() -> Goal:
    cameras = tiny_data.cameras(8)
    return Goal(cameras, Views(cameras, [], 0.0, USUAL).pictures(MODEL), Look(0.0, USUAL), BY_DATA)


@pytest.mark.parametrize("goal, gain", [(goal_of_cameras, 0.6), (lambda: by_renders(MODEL, 60, USUAL), 0.25)])
def test_refined_gaussians_are_nearer_to_the_model_where_nothing_was_fitted(goal, gain):
    """Views of others: from cameras among which they are, and from those that are made up."""
    views = Views(tiny_data.cameras(5), [], 0.0, DrawnAs(near_clip=0.05))
    truth, start, steps = views.pictures(MODEL), baked(MODEL), []
    found = refined(start, goal(), 60, lambda done, total: steps.append((done, total)))
    assert mean_psnr(views.pictures(found), truth) > mean_psnr(views.pictures(start), truth) + gain
    assert found.n_splats == MODEL.n_splats and found.n_dog == 0
    assert steps == [(k + 1, 60) for k in range(60)]


def test_without_data_the_goal_is_what_the_model_shows_on_grey():
    goal = by_renders(MODEL, 6, replace(USUAL, antialiased=True))
    assert len(goal.cameras) == len(goal.pictures) == 6 and goal.look.drawn.antialiased
    assert goal.look.drawn.near_clip <= 0.05 and goal.look.background == GREY
    views = Views(goal.cameras, [], GREY, goal.look.drawn)
    assert all(np.array_equal(a, b) for a, b in zip(views.pictures(MODEL), goal.pictures, strict=True))


def test_with_data_the_goal_is_its_training_photographs(data, alpha_data):
    dataset = load_dataset(data)
    goal = by_data(MODEL, dataset, 100, PictureOptions(), USUAL)
    assert [c is view.camera for c, view in zip(goal.cameras, dataset.train, strict=True)]
    assert all(np.array_equal(a, view.image) for a, view in zip(goal.pictures, dataset.train, strict=True))
    assert len(by_data(MODEL, dataset, 3, PictureOptions(), USUAL).cameras) == 3
    white = by_data(MODEL, load_dataset(alpha_data), 100, PictureOptions(), USUAL)
    assert white.look.background == 1 and white.pictures[0].shape[-1] == 3


def test_a_model_of_linear_radiance_is_fitted_to_its_own_pictures_in_linear_radiance(data):
    dataset = load_dataset(data)
    goal = by_data(MODEL, dataset, 100, PictureOptions(), replace(USUAL, linear=True))
    shown = Views(goal.cameras, [], 0.0, DrawnAs(near_clip=0.05, linear=True)).pictures(MODEL)
    assert len(goal.pictures) == len(dataset.train)
    for linear, srgb in zip(goal.pictures, shown, strict=True):
        assert np.clip(linear_to_srgb(linear), 0, 1) == pytest.approx(srgb, abs=1e-5)


def test_an_export_with_data_comes_nearer_to_its_photographs(model, data, tmp_path):
    exported = export_model(model, tmp_path / "out.ply", ExportConfig(refine=40), data=data)
    stages = {loss.stage: loss.of_photographs or 0 for loss in exported.losses}
    assert list(stages) == ["as it is", "without DoG (bake)", "refined, 40 steps", "read from the file"]
    assert stages["refined, 40 steps"] > stages["without DoG (bake)"] + 1
    assert stages["read from the file"] == pytest.approx(stages["refined, 40 steps"], abs=1e-3)
    assert exported.refine_seconds is not None and exported.refine_seconds > 0


def test_dropped_dog_are_refined_on_demand_only_and_kept_ones_stay(model, tmp_path):
    stages = export_model(model, tmp_path / "out.ply", ExportConfig(dog="drop", views=1)).losses
    assert [loss.stage for loss in stages] == ["as it is", "without DoG (drop)", "read from the file"]
    stages = export_model(model, tmp_path / "out.ply", ExportConfig(dog="drop", views=1, refine=2)).losses
    assert stages[2].stage == "refined, 2 steps"
    export_model(model, tmp_path / "kept.ply", ExportConfig(dog="keep", views=0))
    assert np.array_equal(read_ply(tmp_path / "kept.ply").dog_log_scales, MODEL.dog_log_scales)


@pytest.mark.parametrize("suffix", [".spz", ".sog"])
def test_small_files_are_refined_for_their_grids(model, tmp_path, suffix):
    export_model(model, tmp_path / f"usual{suffix}", ExportConfig(views=0, refine=0))
    steps = []
    config = ExportConfig(views=2, small=True, refine=20)
    refined = export_model(model, tmp_path / f"small{suffix}", config, show=lambda done, of: steps.append(done))
    stages = refined.losses
    rounded = export_model(model, tmp_path / f"rounded{suffix}", ExportConfig(views=2, small=True, refine=0)).losses
    assert [stages[2].stage, rounded[2].stage] == ["refined, 20 steps", "on coarse grids"]
    assert steps == list(range(1, 21))
    for losses in (stages, rounded):  # the file says what was refined
        assert losses[3].of_model == pytest.approx(losses[2].of_model, abs=1e-3)
    usual, small = ((tmp_path / f"{name}{suffix}").stat().st_size for name in ("usual", "small"))
    assert small < 0.9 * usual


def test_baked_ones_are_refined_by_default_where_that_can_be_computed(capsys, model, tmp_path, monkeypatch):
    monkeypatch.setattr(refine, "STEPS", 3)
    status, printed, _ = run(capsys, "export", model, "-o", tmp_path / "out.spz", "--views", "1")
    assert status == 0 and "refined, 3 steps" in printed and "refining took" in printed
    without_variant = type("mi", (), {"variant": staticmethod(lambda: None)})
    monkeypatch.setattr(write, "mi", without_variant)
    assert export_model(model, tmp_path / "out.ply", ExportConfig(views=0)).refine_seconds is None
    assert np.array_equal(read_ply(tmp_path / "out.ply").log_scales, baked(MODEL).log_scales)


@pytest.mark.parametrize(("views", "steps"), [(1, 300), (30, 300), (50, 500), (99, 990), (400, 1000)])
def test_more_photographs_are_given_more_steps(views, steps):
    dataset: Any = SimpleNamespace(train=range(views))
    assert steps_for(dataset) == steps
    assert steps_for(None) == 300
