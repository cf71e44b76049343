"""The metrics against scikit-image, against closed forms, and at their edges."""

import json

import flip_evaluator
import numpy as np
import pytest
from mi_dogsplat.measure import metrics

SHAPE = (48, 61, 3)


@pytest.fixture
def pair() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)  # some structure along the rows, not noise alone
    truth = np.cumsum(rng.uniform(-0.2, 0.2, SHAPE), axis=1).clip(-0.5, 0.5) + 0.5
    image = np.clip(truth + rng.normal(0, 0.05, SHAPE), 0, 1)
    return image.astype(np.float32), truth.astype(np.float32)


def test_psnr_equals_that_of_scikit_image(pair):
    skimage_metrics = pytest.importorskip("skimage.metrics", reason="needs pip install scikit-image")
    image, truth = pair
    expected = skimage_metrics.peak_signal_noise_ratio(
        truth.astype(float), image.astype(float), data_range=1.0
    )
    assert metrics.psnr(image, truth) == pytest.approx(expected, rel=1e-12)


def test_ssim_equals_that_of_scikit_image_away_from_the_border(pair):
    skimage_metrics = pytest.importorskip("skimage.metrics", reason="needs pip install scikit-image")
    image, truth = pair
    mean, expected = skimage_metrics.structural_similarity(
        truth.astype(float),
        image.astype(float),
        data_range=1.0,
        channel_axis=2,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    ours = metrics.ssim_map(image, truth)
    inside = (slice(5, -5), slice(5, -5))
    np.testing.assert_allclose(ours[inside], expected[inside], rtol=0, atol=1e-10)
    assert ours[inside].mean() == pytest.approx(mean, abs=1e-10)


def test_ssim_at_the_border_takes_everything_outside_as_zero():
    rng = np.random.default_rng(3)
    image, truth = rng.random((12, 13, 3)), rng.random((12, 13, 3))
    offsets = np.arange(-5, 6)
    window = np.exp(-0.5 * (offsets / 1.5) ** 2)
    window = np.outer(window, window) / window.sum() ** 2

    def windowed(plane: np.ndarray) -> float:  # at the pixel (0, 0): only a quarter of the window lies inside
        return float(np.sum(window[5:, 5:] * plane[:6, :6]))

    x, y = image[..., 1], truth[..., 1]
    mx, my = windowed(x), windowed(y)
    vx, vy, vxy = windowed(x * x) - mx**2, windowed(y * y) - my**2, windowed(x * y) - mx * my
    expected = (2 * mx * my + 1e-4) * (2 * vxy + 9e-4) / ((mx**2 + my**2 + 1e-4) * (vx + vy + 9e-4))
    assert metrics.ssim_map(image, truth)[0, 0, 1] == pytest.approx(expected, rel=1e-12)


def test_l1_is_the_mean_absolute_difference():
    truth = np.full(SHAPE, 0.5)
    image = truth.copy()
    image[::2] += 0.25
    image[1, 2] -= 0.25  # what is darker adds to it, too
    image[0, 2] = 0.5
    assert metrics.l1(image, truth) == pytest.approx(0.125)


def test_flip_takes_its_inputs_as_srgb_encoded(pair):
    image, truth = pair

    def linear(v: np.ndarray) -> np.ndarray:
        return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)

    _, expected, _ = flip_evaluator.evaluate(
        linear(truth), linear(image), "LDR", inputsRGB=False, applyMagma=False
    )
    mean, error_map = metrics.flip(image, truth)
    assert mean == pytest.approx(expected, abs=1e-5)
    assert error_map.shape == SHAPE[:2]
    assert error_map.mean(dtype=float) == pytest.approx(mean)
    assert 0 <= error_map.min() and error_map.max() <= 1


def test_flip_map_is_largest_where_the_difference_is(pair):
    _, truth = pair
    image = truth.copy()
    image[30:34, 40:44] = 1 - image[30:34, 40:44]
    _, error_map = metrics.flip(image, truth)
    row, column = np.unravel_index(np.argmax(error_map), error_map.shape)
    assert 28 <= row < 36 and 38 <= column < 46


def test_identical_images_give_perfect_values_that_json_can_hold(pair):
    _, truth = pair
    values = metrics.evaluate(truth, truth)
    assert values == pytest.approx({"psnr": metrics.PSNR_CAP, "ssim": 1.0, "flip": 0.0, "l1": 0.0})
    assert json.loads(json.dumps(values, allow_nan=False)) == values


def test_values_are_plain_floats(pair):
    assert {type(value) for value in metrics.evaluate(*pair).values()} == {float}


def test_values_outside_the_display_range_count_as_clamped(pair):
    _, truth = pair
    white = np.ones(SHAPE, np.float32)
    assert metrics.evaluate(white * 3, truth) == metrics.evaluate(white, truth)


def test_a_blurrier_image_is_worse_in_every_metric(pair):
    image, truth = pair
    worse = np.clip(truth + 3 * (image - truth), 0, 1)
    good, bad = metrics.evaluate(image, truth), metrics.evaluate(worse, truth)
    assert bad["psnr"] < good["psnr"] and bad["ssim"] < good["ssim"]
    assert bad["flip"] > good["flip"] and bad["l1"] > good["l1"]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_not_finite_is_named_with_its_place(pair, value):
    image, truth = pair
    image[4, 9, 2] = value
    with pytest.raises(ValueError, match=r"fox_07 has values .* infinite: 1 of 8784, .* row 4, column 9, channel 2"):
        metrics.evaluate(image, truth, name="fox_07")
    with pytest.raises(ValueError, match=r"the truth of fox_07"):
        metrics.evaluate(truth, image, name="fox_07")


def test_shapes_that_differ_are_named_on_both_sides(pair):
    image, truth = pair
    with pytest.raises(ValueError, match=r"\[48, 60, 3\].*\[48, 61, 3\]"):
        metrics.psnr(image[:, :-1], truth)


def test_masked_pixels_are_no_part_of_any_metric_and_the_others_are_weighed_as_before(pair):
    image, truth = pair
    mask = np.ones(SHAPE[:2], np.float32)
    assert metrics.evaluate(image, truth, mask=mask) == pytest.approx(metrics.evaluate(image, truth), rel=1e-12)
    mask[:, :30] = 0
    hidden = np.where(mask[..., None] > 0, image, np.random.default_rng(0).uniform(size=SHAPE))
    found = metrics.evaluate(image, truth, mask=mask)
    assert metrics.evaluate(hidden, truth, mask=mask) == found
    right = slice(None), slice(30, None)
    assert found["l1"] == pytest.approx(metrics.l1(image[right], truth[right]), rel=1e-12)
    assert found["psnr"] == pytest.approx(metrics.psnr(image[right], truth[right]), rel=1e-12)
    ours = np.where(mask[..., None] > 0, image, truth)
    assert found["ssim"] == pytest.approx(metrics.ssim_map(ours, truth)[right].mean(), rel=1e-12)
    assert found["flip"] == pytest.approx(metrics.flip(ours, truth)[1][right].mean(dtype=np.float64), rel=1e-12)


def test_the_corrected_colors_are_those_of_the_best_affine_map(pair):
    truth = 0.2 + 0.5 * pair[1]
    rng = np.random.default_rng(1)
    matrix, offset = np.eye(3) + rng.uniform(-0.1, 0.1, (3, 3)), rng.uniform(-0.05, 0.05, 3)
    exposed = truth @ matrix.T + offset
    assert 0 < exposed.min() and exposed.max() < 1  # no pixel is clamped
    np.testing.assert_allclose(metrics.color_corrected(exposed, truth), truth, atol=1e-9)
    corrected = metrics.color_corrected(pair[0], pair[1])
    errors = corrected - pair[1]  # at the optimum no affine map of the render explains the rest
    assert np.abs(np.einsum("hwi,hwj->ij", pair[0].astype(float), errors)).max() < 1e-8
    assert np.abs(errors.sum((0, 1))).max() < 1e-8
    mask = np.zeros(SHAPE[:2])
    mask[:20] = 1
    exposed[20:] = rng.uniform(size=exposed[20:].shape)
    np.testing.assert_allclose(metrics.color_corrected(exposed, truth, mask)[:20], truth[:20], atol=1e-9)
