"""Metrics and pictures of views: means, backgrounds, files."""

import flip_evaluator
import numpy as np
import OpenEXR
import pytest
import tiny_data
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.measure.evaluate import Measure, evaluate_views, mean_metrics, render_milliseconds
from mi_dogsplat.render.picture import Picture
from mi_dogsplat.support import pipeline
from mi_dogsplat.support.files import PART
from mi_dogsplat.support.srgb import srgb_to_linear
from PIL import Image

PERFECT = {"psnr": 100.0, "ssim": 1.0, "flip": 0.0, "l1": 0.0}


def view(name: str, image: np.ndarray) -> View:
    height, width = image.shape[:2]
    return View(name, tiny_data.cameras(1, width, height)[0], image.astype(np.float32))


def noise(seed: int, channels: int = 3, height: int = 16, width: int = 24) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 0.9, (height, width, channels)).astype(np.float32)


def flat(color: np.ndarray, alpha: float = 1.0, depth: bool = False) -> Picture:
    shape = color.shape[:2]
    planes = np.full(shape, alpha, np.float32)
    return Picture(color, planes, np.full(shape, 3.5, np.float32) if depth else None)


def test_a_perfect_render_has_perfect_metrics_and_a_worse_one_worse():
    views = [view("a", noise(0)), view("b", noise(1))]
    results = evaluate_views(lambda v: flat(v.image), views, 0.0)
    assert list(results) == ["a", "b"]
    for values in results.values():
        assert values == pytest.approx(PERFECT, abs=1e-6)
    results = evaluate_views(lambda v: flat(v.image + np.float32(0.1)), views, 0.0)
    for values in results.values():
        assert values["psnr"] == pytest.approx(20, abs=1e-3) and values["l1"] == pytest.approx(0.1, abs=1e-5)
        assert values["ssim"] < 1 and values["flip"] > 0


def test_an_image_with_alpha_is_compared_over_the_background():
    alpha = noise(2, 1)
    image = np.concatenate([noise(3) * alpha, alpha], -1)  # premultiplied
    for background in (0.0, 1.0):
        expected = image[..., :3] + (1 - alpha) * background
        results = evaluate_views(lambda v, e=expected: flat(e), [view("a", image)], background)
        assert results["a"]["psnr"] == pytest.approx(100, abs=1e-3)


def test_the_mean_of_the_views_is_per_metric_and_empty_without_views():
    results = {"a": dict.fromkeys(PERFECT, 1.0), "b": dict.fromkeys(PERFECT, 2.0)}
    assert mean_metrics(results) == dict.fromkeys(PERFECT, 1.5)
    assert mean_metrics({}) == {} and evaluate_views(lambda v: flat(v.image), [], 0.0) == {}


def test_each_view_leaves_its_render_its_truth_its_error_and_an_exr(tmp_path):
    views = [view("a", noise(0)), view("b", noise(1))]
    evaluate_views(lambda v: flat(1 - v.image, depth=True), views, 0.0, tmp_path / "test")
    names = {f"{v}{end}" for v in "ab" for end in (".png", "_gt.png", "_error.png", ".exr")}
    assert {path.name for path in (tmp_path / "test").iterdir()} == names
    render, truth = (np.asarray(Image.open(tmp_path / "test" / n)) for n in ("a.png", "a_gt.png"))
    assert abs(render / 255 - (1 - views[0].image)).max() < 0.002
    assert abs(truth / 255 - views[0].image).max() < 0.002
    error = np.asarray(Image.open(tmp_path / "test" / "a_error.png"))
    assert error.shape == render.shape and error.max() > 100

    channels = OpenEXR.File(str(tmp_path / "test" / "a.exr")).channels()
    assert set(channels) == {"RGBA", "depth.Z", "error.Y"}
    assert (channels["depth.Z"].pixels == 3.5).all()
    np.testing.assert_allclose(channels["RGBA"].pixels[..., :3], srgb_to_linear(1 - views[0].image), atol=1e-3)


def test_the_mask_of_a_view_that_has_one_lies_beside_its_pictures(tmp_path):
    views = [view(name, noise(0, height=40, width=60)) for name in "02"]
    masks = Masks(mask_folder(tmp_path / "masks"), views)
    evaluate_views(lambda v: flat(v.image), views, 0.0, tmp_path / "test", Measure(masks))
    assert [path.name for path in (tmp_path / "test").glob("*_mask.png")] == ["2_mask.png"]
    expected = masks.of(views[1])
    assert expected is not None
    counts = np.asarray(Image.open(tmp_path / "test" / "2_mask.png").convert("L")) > 0
    np.testing.assert_array_equal(counts, expected > 0)


def test_the_exr_of_a_view_over_white_is_premultiplied_without_the_white(tmp_path):
    color = noise(5)
    over_white = 0.25 * color + 0.75
    evaluate_views(lambda v: flat(over_white, alpha=0.25), [view("a", noise(6))], 1.0, tmp_path)
    channels = OpenEXR.File(str(tmp_path / "a.exr")).channels()
    assert set(channels) == {"RGBA", "error.Y"}  # no depth was rendered
    rgba = channels["RGBA"].pixels
    np.testing.assert_allclose(rgba[..., :3], srgb_to_linear(0.25 * color), atol=1e-3)
    np.testing.assert_allclose(rgba[..., 3], 0.25, atol=1e-3)


def test_a_render_that_is_not_finite_is_told_by_the_name_of_its_view():
    image = noise(0)
    with pytest.raises(ValueError, match="lion.*NaN"):
        evaluate_views(lambda v: flat(np.full_like(v.image, np.nan)), [view("lion", image)], 0.0)


def test_threads_measure_and_write_what_is_measured_one_by_one(tmp_path, monkeypatch):
    views = [view(f"{k}", noise(k, height=40, width=60)) for k in range(7)]
    views[3] = view("3", noise(3, height=20, width=30))
    masks = Masks(mask_folder(tmp_path / "masks"), views)
    for measure in (Measure(), Measure(masks, color_correct=True, align_extent=1.0)):
        found = []
        for cores in (1, 3):
            monkeypatch.setattr(pipeline, "usable_cores", lambda cores=cores: cores)
            out = tmp_path / f"{cores}"
            metrics = evaluate_views(lambda v: flat(1 - v.image, depth=True), views, 0.0, out, measure)
            found.append((list(metrics.items()), {path.name: path.read_bytes() for path in out.iterdir()}))
        assert found[0] == found[1] and len(found[0][0]) == (7 if measure.masks is None else 6)


def mask_folder(folder):
    folder.mkdir()
    for name, grey in (("1", 0), ("2", 255)):
        pixels = np.full((40, 60), grey, np.uint8)
        pixels[:20, :30] = grey
        pixels[20:, 30:] = grey // 2
        Image.fromarray(pixels).save(folder / f"{name}.png")
    return folder


@pytest.mark.parametrize("cores", [1, 3])
def test_a_picture_that_cannot_be_written_is_an_error_and_leaves_no_part(tmp_path, monkeypatch, cores):
    monkeypatch.setattr(pipeline, "usable_cores", lambda: cores)
    (tmp_path / "1.exr").mkdir()  # where a file should be
    views = [view(f"{k}", noise(k)) for k in range(9)]
    with pytest.raises(OSError, match=r"1\.exr"):
        evaluate_views(lambda v: flat(v.image), views, 0.0, tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert "0.exr" in names and "8.png" not in names and not any(name.endswith(PART) for name in names)


def test_flip_is_evaluated_once_for_a_view_and_twice_where_its_map_has_more_pixels_than_its_mean(tmp_path, monkeypatch):
    calls = []

    def counted(*args, **how):
        calls.append(args)
        return flip_of_library(*args, **how)

    flip_of_library = flip_evaluator.evaluate
    monkeypatch.setattr(flip_evaluator, "evaluate", counted)
    views = [view("2", noise(2, height=40, width=60))]
    masks = Masks(mask_folder(tmp_path / "masks"), views)
    for out, measure, times in ((tmp_path, Measure(), 1), (tmp_path, Measure(masks), 2), (None, Measure(masks), 1)):
        calls.clear()
        evaluate_views(lambda v: flat(1 - v.image), views, 0.0, out, measure)
        assert len(calls) == times


def test_render_time_is_the_median_after_a_warm_up(monkeypatch):
    ticks = iter([0.0, 0.010, 1.0, 1.500, 2.0, 2.020])  # start and end of three renders
    monkeypatch.setattr("time.perf_counter", lambda: next(ticks))
    shown = []

    def picture(v):
        shown.append(v.name)
        return flat(v.image)

    assert render_milliseconds(picture, [view("a", noise(0))]) == pytest.approx(20)
    assert shown == ["a"] * 4


def test_a_model_rendered_from_its_own_data_is_nearly_perfect():
    splats = tiny_data.truth()
    views = [
        View(str(i), camera, tiny_data.picture(splats, camera).color) for i, camera in enumerate(tiny_data.cameras(2))
    ]
    results = evaluate_views(lambda v: tiny_data.picture(splats, v.camera), views, 0.0)
    assert mean_metrics(results)["psnr"] > 80
