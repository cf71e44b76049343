"""Training on linear radiance: the tone curve, steps of colours, the unit of radiance, and what is refused."""

import json
import shutil
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hdr_data import bright_truth, write_hdr_data
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.exr import read_exr
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.runs.checkpoint import CHECKPOINT
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scores.score import ScoreRule, energies
from mi_dogsplat.scores.training_views import TrainingViews
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.pictures import write_radiance
from mi_dogsplat.support.srgb import linear_to_srgb, linear_to_srgb_log, srgb_log_to_linear
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.images.photographs import Photographs
from mi_dogsplat.training.images.tone_curve import SrgbLog
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.point_radiance import point_radiance
from mi_dogsplat.training.strategy.options import Options
from mi_dogsplat.training.train import Trainer
from mi_dogsplat.viewer.source import Source
from tiny_data import cameras, truth, write_tiny_data

SETTINGS = {"steps": 40, "preset": "3dgs", "max_primitives": 300}


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return write_hdr_data(tmp_path_factory.mktemp("hdr") / "data")


@pytest.fixture(scope="module")
def run(data, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("hdr") / "run"
    train(TrainConfig(str(data), checkpoint_seconds=0, **SETTINGS), out)
    return out


def test_the_curve_is_srgb_up_to_white_then_a_logarithm_and_its_slope_that_of_differences():
    x = np.concatenate([np.linspace(-0.1, 1.2, 400), np.geomspace(1.2, 1e4, 100)])
    curve = SrgbLog()
    y, slope = curve(mi.Float(x)).numpy(), curve.slope(mi.Float(x)).numpy()
    below = x <= 1
    np.testing.assert_allclose(y[below], linear_to_srgb(x[below]), atol=2e-6)
    np.testing.assert_allclose(y[~below], 1 + 1.055 / 2.4 * np.log(x[~below]), rtol=1e-5)
    np.testing.assert_allclose(y, linear_to_srgb_log(x), rtol=1e-5, atol=2e-6)
    np.testing.assert_allclose(srgb_log_to_linear(linear_to_srgb_log(x)), x, rtol=1e-12, atol=1e-15)
    fine, h = array_types().Double, 1e-6 * np.maximum(1, np.abs(x))
    differences = (curve(fine(x + h)).numpy() - curve(fine(x - h)).numpy()) / (2 * h)
    corner = np.abs(x - 0.0031308) < 1e-2  # where the standard itself has one
    np.testing.assert_allclose(slope[~corner], differences[~corner], rtol=1e-3)


def test_the_gradient_of_the_loss_is_that_of_differences_above_white_too(data):
    dataset = load_dataset(data)
    photographs = Photographs(dataset, 0.0)
    rng = np.random.default_rng(0)
    shape = dataset.train[0].image.shape
    planes = [mi.Float(rng.uniform(0.01, 30, shape[0] * shape[1])) for _ in range(3)]
    _, _, gradient = photographs.compare(planes, 0, 0)
    direction = [rng.normal(size=shape[0] * shape[1]) * plane.numpy() for plane in planes]
    expected = sum(float(g.numpy() @ d) for g, d in zip(gradient, direction, strict=True))

    def loss(t: float) -> float:
        moved = [mi.Float(plane.numpy() + t * d) for plane, d in zip(planes, direction, strict=True)]
        return float(photographs.compare(moved, 0, 0)[1][0])

    assert expected == pytest.approx((loss(2e-2) - loss(-2e-2)) / 4e-2, rel=1e-2)


def test_colours_far_above_white_take_steps_in_proportion_to_their_brightness():
    def steps(factor: float) -> np.ndarray:
        splats = bright_truth()
        splats.sh_coeffs[:, 0] = np.abs(splats.sh_coeffs[:, 0]) + 10  # all above white
        splats = brightened(splats, factor)
        optimizer = SplatOptimizer(splats, LearningRates(1.0, 100), SrgbLog())
        for name in ("sh_dc", "sh_rest"):
            dr.set_grad(optimizer.params[name], mi.Float(np.ones(dr.width(optimizer.params[name])) / factor))
        optimizer.step()
        return (optimizer.to_splats().sh_coeffs - splats.sh_coeffs) / factor

    one, eight = steps(1.0), steps(8.0)
    assert np.abs(one).min() > 1e-5 and one.max() < 0
    np.testing.assert_allclose(eight, one, rtol=1e-2)


def test_a_scene_in_another_unit_trains_alike(data, run, tmp_path):
    write_hdr_data(tmp_path / "data", unit=1000.0)
    found = train(TrainConfig(str(tmp_path / "data"), **SETTINGS), tmp_path / "run")["test"]
    one, thousand = (read_model(folder / "point_cloud.ply").drawing for folder in (run, tmp_path / "run"))
    assert thousand.white == pytest.approx(1000 * (one.white or 0), rel=1e-3)
    expected = json.loads((run / "metrics.json").read_text())["test"]
    for name in ("psnr", "psnr_mu"):  # halves of another unit are rounded otherwise
        assert found[name] == pytest.approx(expected[name], abs=0.3), name


def test_in_a_unit_that_is_a_power_of_two_larger_the_training_has_the_same_bits(data, tmp_path, ordered):
    def trained(folder: Path) -> Trainer:
        trainer = Trainer(TrainConfig(str(folder), **SETTINGS), load_dataset(folder))
        for _ in range(5):
            trainer.step()
        return trainer

    shutil.copytree(data, tmp_path / "data")
    for image in (tmp_path / "data" / "images").iterdir():
        write_radiance(image, 64 * read_exr(image))  # halves of a model that is brighter may round otherwise
    small, large = trained(data), trained(tmp_path / "data")
    assert large.dataset.white == 64 * (small.dataset.white or 0)
    np.testing.assert_array_equal(large.optimizer.to_splats().sh_coeffs, small.optimizer.to_splats().sh_coeffs)


def test_the_metrics_have_what_a_screen_does_not_show(run, data):
    metrics = json.loads((run / "metrics.json").read_text())["test"]
    assert {"psnr", "ssim", "flip", "l1", "psnr_mu", "hdr_flip"} == set(metrics)
    assert json.loads((run / "config.json").read_text())["white"] == load_dataset(data).white


def test_the_viewer_shows_a_checkpoint_in_the_radiance_of_its_images(run):
    model = read_model(run / "point_cloud.ply")
    source = Source(run)
    (run / "point_cloud.ply").touch()
    source.poll()
    assert source.drawing.linear and source.drawing.white == model.drawing.white
    (run / CHECKPOINT).touch()
    found = source.poll()
    assert found is not None
    splats, what = found
    assert what.startswith("step")
    kept = splats.select(splats.opacities >= 1 / 255)
    np.testing.assert_allclose(kept.sh_coeffs, model.splats.sh_coeffs, rtol=1e-5, atol=1e-6)


def test_points_that_are_clipped_begin_with_the_radiance_of_the_images(data):
    dataset = load_dataset(data)
    found = point_radiance(dataset) * dataset.white
    colors = np.maximum(0, 0.5 + 0.28209479 * bright_truth().sh_coeffs[:, 0])
    clipped = dataset.point_colors.max(axis=1) >= 0.99
    assert clipped.any() and found[clipped].max() > 3
    known = ~clipped & (dataset.point_colors.min(axis=1) > 0.2)
    ratio = found[known] / colors[known]
    assert np.std(np.log(ratio)) < 0.05  # one gain for all


def test_random_primitives_are_grey_on_the_screen(tmp_path, data):
    content = json.loads((data / "transforms.json").read_text())
    del content["ply_file_path"]
    (data / "without.json").write_text(json.dumps(content))
    trainer = Trainer(TrainConfig(str(data), initial_primitives=50), load_dataset(data / "without.json"))
    colors = 0.5 + 0.28209479 * trainer.optimizer.to_splats().sh_coeffs[:, 0]
    assert 0.4 - 1e-3 < linear_to_srgb(colors).min() and linear_to_srgb(colors).max() < 0.6 + 1e-3


def test_scores_count_what_is_seen_through_the_curve():
    camera = [DeviceCamera.upload(cameras(1)[0], 0.2)]
    options = RasterOptions(sh_degree=0)
    lamps = truth().uniform_sh(0)
    lamps.sh_coeffs[:] = np.abs(lamps.sh_coeffs) + 8
    lamps.logit_opacities[:] = 6  # no pixel between lamps and black background is below white
    rule = ScoreRule("leave-one-out", spectral_weight=0.0)

    def spatial(curve: SrgbLog | None, factor: float) -> np.ndarray:
        views = TrainingViews(camera, options, 1e3 * factor, curve=curve)
        return energies(rule, upload(brightened(lamps, factor)), views, 0)[0]

    one = spatial(SrgbLog(), 1.0)
    np.testing.assert_allclose(spatial(SrgbLog(), 16.0), one, rtol=2e-2, atol=1e-3 * one.max())
    raw = spatial(None, 1.0)
    np.testing.assert_allclose(spatial(None, 16.0), 256 * raw, rtol=2e-2, atol=0.256 * raw.max())


@pytest.mark.parametrize(("format", "size"), [("ply", 3020), ("spz", 410), ("sog", 7030)])
def test_a_file_of_linear_images_is_not_larger_than_its_target(data, tmp_path, format, size):
    config = TrainConfig(str(data), steps=20, max_primitives=100, sh_degree=1, target=f"{size}B", format=format)
    train(config, tmp_path)
    assert (tmp_path / f"point_cloud.{format}").stat().st_size <= size


def test_bytes_are_divided_by_what_is_seen_through_the_curve(data):
    trainer = Trainer(TrainConfig(str(data), **SETTINGS), load_dataset(data))
    score = trainer.importance(ScoreRule("leave-one-out", spectral_weight=0.0))
    removal = Options.of(trainer, trainer.optimizer.to_splats()).removal
    np.testing.assert_allclose(removal / np.linalg.norm(removal), score, rtol=1e-5)


def test_what_does_not_fit_together_is_refused_in_one_line(data, run, tmp_path):
    write_tiny_data(tmp_path / "png")
    write_model(tmp_path / "srgb.ply", truth())
    write_model(tmp_path / "linear.ply", Model(truth(), Drawing(linear=True)))

    def error(**settings) -> str:
        config = TrainConfig(**settings)
        with pytest.raises(DataError) as raised:
            Trainer(config, load_dataset(config.data))
        return str(raised.value)

    assert "its colours are display-referred sRGB, the images are linear" in error(
        data=str(data), model=str(tmp_path / "srgb.ply")
    )
    png = str(tmp_path / "png")
    linear = str(tmp_path / "linear.ply")
    assert "its colours are linear radiance, the images are display" in error(data=png, model=linear)
    assert "--white: is for linear images" in error(data=png, white=3.0)
    assert "--appearance: is for photographs" in error(data=data, appearance=True)


def test_white_that_is_given_is_that_of_the_run(data):
    trainer = Trainer(TrainConfig(str(data), white=7.0), load_dataset(data))
    assert trainer.dataset.white == 7 and trainer.drawing == Drawing(False, trainer.near_clip, True, white=7.0)


def test_a_linear_model_is_pruned_in_its_own_radiance(data, run):
    model = run / "point_cloud.ply"
    trainer = Trainer(TrainConfig(str(data), model=str(model), steps=10), load_dataset(data))
    np.testing.assert_allclose(trainer.model().sh_coeffs, read_model(model).splats.sh_coeffs, rtol=1e-4, atol=1e-5)
