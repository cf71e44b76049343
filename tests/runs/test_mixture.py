"""The mixture taken apart, and its error with and without DoG."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import PICTURE_ENDS, View
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.measure.evaluate import evaluate_views
from mi_dogsplat.measure.metrics import evaluate, flip
from mi_dogsplat.render.picture import Picture
from mi_dogsplat.report.run_folder import DOG_PROFILE
from mi_dogsplat.runs import finish, resume
from mi_dogsplat.runs.mixture import (
    SWITCHED_OFF,
    most_different_row,
    row_error,
    write_comparison,
    write_mixture,
)
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.pictures import heat_map, write_png
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.train import Trainer
from PIL import Image
from splat_scenes import make_camera, make_splats, options, random_splats, rounded

EIGHT_BITS = 0.5 / 255 + 1e-6
CAMERA = make_camera(48, 36, 45.0)


def view(name: str, image: np.ndarray) -> View:
    return View(name, CAMERA, image.astype(np.float32))


def flat(color: np.ndarray) -> Picture:
    return Picture(color, np.ones(color.shape[:2], np.float32), None)


def noise(seed: int, height: int = 36, width: int = 48) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 0.9, (height, width, 3)).astype(np.float32)


def pixels(path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image, np.float64) / 255


def red_and_green():
    """A plain red primitive on the left, a green DoG on the right, far from one another."""
    colors = [[0.9, 0, 0], [0, 0.9, 0]]
    return rounded(make_splats([[-0.8, 0, 3], [0.8, 0, 3]], 0.2, 0.9, colors, dog=[1], f_a=0.5, F=0.5))


def test_switched_off_is_what_a_vanishing_pseudo_gaussian_draws():
    splats = rounded(random_splats(30))
    off = splats.plain()
    assert off.n_splats == splats.n_splats and off.n_dog == 0
    vanishing = replace(splats, dog_logit_opacities=np.full(splats.n_dog, -40.0))
    full, expected, got = (tiny_data.picture(s, CAMERA).color for s in (splats, vanishing, off))
    np.testing.assert_allclose(got, expected, atol=1e-6)
    assert np.abs(full - got).max() > 0.05


def test_the_row_is_where_the_pictures_differ_most_whatever_the_sign():
    a = np.full((5, 8, 3), 0.5)
    b = a.copy()
    b[1] += 0.1  # one sign
    b[3, ::2] += 0.2  # both signs, which cancel
    b[3, 1::2] -= 0.2
    assert most_different_row(a, b) == most_different_row(b, a) == 3


def test_the_error_of_a_pixel_is_the_mean_of_its_channels():
    picture, truth = np.zeros((2, 2, 3)), np.zeros((2, 2, 3))
    picture[1, 0], truth[1, 0] = [0.3, 0.0, 0.6], [0.0, 0.3, 0.6]
    np.testing.assert_allclose(row_error(picture, truth, 1), [0.2, 0])
    np.testing.assert_allclose(row_error(picture, truth, 0), [0, 0])


def test_a_comparison_takes_any_two_pictures_and_leaves_them_with_their_profile(tmp_path):
    truth, ours = noise(0), noise(0) * 0.95
    plain = ours.copy()
    plain[20] = 0
    seen = view("a", truth)
    result = write_comparison(lambda v: flat(ours), lambda v: flat(plain), seen, 0.0, tmp_path, "another model")
    assert json.loads((tmp_path / DOG_PROFILE).read_text()) == result
    assert (result["view"], result["row"], result["without"]) == ("a", 20, "another model")
    for key, picture in (("with_dog", ours), ("without_dog", plain)):
        assert result[key]["metrics"] == evaluate(picture, truth)
        np.testing.assert_allclose(result[key]["error"], np.abs(picture - truth)[20].mean(-1), atol=1e-5)
    assert {path.name for path in tmp_path.iterdir()} == {"a_plain.png", "a_plain_error.png", DOG_PROFILE}
    np.testing.assert_allclose(pixels(tmp_path / "a_plain.png"), plain, atol=EIGHT_BITS)
    error = heat_map(flip(plain, truth)[1])  # the scale of every error map: 0..1, not that of this picture
    np.testing.assert_allclose(pixels(tmp_path / "a_plain_error.png"), error, atol=EIGHT_BITS)


def test_pixels_that_a_mask_hides_count_neither_in_the_metrics_nor_in_the_profile(tmp_path):
    truth, mask = noise(0), np.ones((36, 48), np.float32)
    mask[:, :24] = 0
    ours, plain = truth * 0.95, truth * 0.95
    plain[5, :24], plain[20, 24:30] = 0, 0  # the first is hidden
    pictures = (lambda v: flat(ours)), (lambda v: flat(plain))
    result = write_comparison(*pictures, view("a", truth), 0.0, tmp_path, "another model", mask)
    assert result["row"] == 20
    for key, picture in (("with_dog", ours), ("without_dog", plain)):
        assert result[key]["metrics"] == evaluate(picture, truth, "a", mask)
        np.testing.assert_allclose(result[key]["error"], (np.abs(picture - truth).mean(-1) * mask)[20], atol=1e-5)
    np.testing.assert_allclose(pixels(tmp_path / "a_plain.png"), plain, atol=EIGHT_BITS)  # as all pictures, whole


def test_a_masked_run_with_dog_measures_its_mixture_where_it_measures_its_views(data, tmp_path):
    dataset, mask = load_dataset(data), np.ones((tiny_data.HEIGHT, tiny_data.WIDTH), np.float32)
    mask[:, : tiny_data.WIDTH // 2] = 0
    for seen in dataset.views:
        write_png(tmp_path / "masks" / f"{seen.name}.png", mask)
    trainer = Trainer(TrainConfig("data", steps=1, sh_degree=1, masks=str(tmp_path / "masks")), dataset)
    give_dog(trainer)
    views = finish.measured(trainer, dataset, tmp_path)["views"]
    profile = json.loads((tmp_path / "test" / DOG_PROFILE).read_text())
    assert profile["with_dog"]["metrics"] == views[profile["view"]]


def test_an_image_with_alpha_is_compared_over_the_background(tmp_path):
    truth = np.concatenate([noise(1) * 0.25, np.full((36, 48, 1), 0.25)], -1)  # premultiplied
    expected = flat(truth[..., :3] + 0.75)
    result = write_comparison(lambda v: expected, lambda v: expected, view("a", truth), 1.0, tmp_path, "itself")
    assert max(result["with_dog"]["error"] + result["without_dog"]["error"]) < 1e-5


def test_each_kind_is_drawn_alone_from_the_median_view(tmp_path):
    splats = red_and_green()
    views = [view(name, noise(0)) for name in "abc"]
    metrics = {"a": {"psnr": 20.0}, "b": {"psnr": 30.0}, "c": {"psnr": 25.0}}
    write_mixture(splats, views, metrics, tmp_path, options(splats))
    kinds = {name: pixels(tmp_path / f"c_{name}.png") for name in ("gaussian", "dog", "plain")}
    left, right = slice(None, 24), slice(24, None)
    assert kinds["gaussian"][:, left, 0].max() > 0.5 and kinds["gaussian"][:, right].max() == 0
    assert kinds["dog"][:, right, 1].max() > 0.2 and kinds["dog"][:, left].max() == 0
    assert kinds["plain"][:, right, 1].max() > kinds["dog"][:, right, 1].max() + 0.2  # nothing is subtracted
    np.testing.assert_array_equal(kinds["plain"][:, left], kinds["gaussian"][:, left])
    profile = json.loads((tmp_path / DOG_PROFILE).read_text())
    assert profile["view"] == "c" and profile["without"] == SWITCHED_OFF
    assert 14 <= profile["row"] <= 21  # through the middle of the DoG


def test_a_model_of_one_kind_leaves_the_background_of_the_other(tmp_path):
    splats = red_and_green().only_dog()
    write_mixture(splats, [view("a", noise(0))], {"a": {"psnr": 20.0}}, tmp_path, options(splats), background=1.0)
    assert pixels(tmp_path / "a_gaussian.png").min() == 1
    assert pixels(tmp_path / "a_dog.png").min() < 0.9


def test_a_kind_is_drawn_alone_that_has_no_band_of_the_colour_of_the_other(tmp_path):
    splats = red_and_green().with_sh_degrees(np.array([0, 2]))  # as a size of the file may leave them
    whole = write_mixture_of(splats, tmp_path / "whole")
    gaussians = write_mixture_of(splats.only_gaussians(), tmp_path / "gaussians")
    np.testing.assert_array_equal(whole, gaussians)


def write_mixture_of(splats: Splats, out: Path) -> np.ndarray:
    """The picture of its Gaussians alone."""
    write_mixture(splats, [view("a", noise(0))], {"a": {"psnr": 20.0}}, out, RasterOptions(sh_degree=2))
    return pixels(out / "a_gaussian.png")


@pytest.fixture
def trained(data):
    """A trainer that was not trained, and its data."""
    dataset = load_dataset(data)
    return Trainer(TrainConfig("data", steps=1, sh_degree=1), dataset), dataset


def give_dog(trainer: Trainer) -> None:
    """Half of the primitives become DoG, of half the opacity they had."""
    m = tiny_data.N_TRUTH // 2
    dog = {"dog_index": np.arange(m), "dog_logit_opacities": np.zeros(m), "dog_log_scales": np.zeros((m, 3))}
    trainer.optimizer = SplatOptimizer(replace(tiny_data.truth(), **dog), trainer.optimizer.learning_rates)


def test_a_run_with_dog_measures_its_mixture(trained, tmp_path):
    trainer, dataset = trained
    give_dog(trainer)
    views = finish.measured(trainer, dataset, tmp_path)["views"]
    profile = json.loads((tmp_path / "test" / DOG_PROFILE).read_text())
    name = profile["view"]
    assert profile["with_dog"]["metrics"] == views[name]  # the same picture as the one that is measured
    assert profile["without_dog"]["metrics"] != views[name]
    written = {path.stem.removeprefix(name) for path in (tmp_path / "test").glob(f"{name}*.png")}
    assert written | {"_mask"} == {"", *PICTURE_ENDS}  # there are no masks; by which names of views are refused


def test_a_run_without_dog_pays_nothing(trained, tmp_path, monkeypatch):
    trainer, dataset = trained
    monkeypatch.setattr(finish, "write_mixture", lambda *_: pytest.fail("there is no mixture"))
    finish.measured(trainer, dataset, tmp_path)
    expected = {f"{v.name}{end}" for v in dataset.test for end in (".png", "_gt.png", "_error.png", ".exr")}
    assert {path.name for path in (tmp_path / "test").iterdir()} == expected


def test_a_run_without_test_views_has_no_mixture_to_show(trained, tmp_path):
    trainer, dataset = trained
    give_dog(trainer)
    finish.measured(trainer, replace(dataset, test=[]), tmp_path)
    assert not list((tmp_path / "test").iterdir())


def test_a_comparison_of_an_earlier_run_is_forgotten(tmp_path):
    (tmp_path / "test").mkdir()
    (tmp_path / "test" / DOG_PROFILE).write_text("{}")
    (tmp_path / "test" / "a_dog.png").write_text("")
    resume.forget_results(tmp_path)
    assert not list((tmp_path / "test").iterdir())


def test_what_is_compared_is_what_evaluate_views_drew(tmp_path):
    """Beside the same `out`, the FLIP map without DoG has the scale of the one with DoG."""
    seen, picture = view("a", noise(0)), flat(1 - noise(0))
    evaluate_views(lambda v: picture, [seen], 0.0, tmp_path)
    write_comparison(lambda v: picture, lambda v: picture, seen, 0.0, tmp_path, "itself")
    np.testing.assert_array_equal(pixels(tmp_path / "a_error.png"), pixels(tmp_path / "a_plain_error.png"))
    np.testing.assert_array_equal(pixels(tmp_path / "a.png"), pixels(tmp_path / "a_plain.png"))
