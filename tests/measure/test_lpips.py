"""LPIPS: the network against sums written out in float64, the distance against the authors' package, the file."""

import numpy as np
import pytest
from mi_dogsplat.cli import main
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.measure import lpips as module
from mi_dogsplat.measure.evaluate import Measure, evaluate_views, mean_metrics
from mi_dogsplat.measure.lpips import BLOCKS, SCALE, SHIFT, Lpips, weights_path
from mi_dogsplat.render.picture import Picture
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.support.arrays import read_arrays, write_arrays
from mi_dogsplat.support.errors import DataError
from scipy.signal import correlate2d
from small_vgg import install, small_weights
from tiny_data import cameras, truth

REAL = weights_path()  # before the tests hide it, see conftest.py
SIZES = [(16, 16), (33, 18), (21, 210)]  # the last has more pixels than one matrix product takes


def pictures(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[:height, :width] / max(height, width)
    a = np.stack([0.5 + 0.5 * np.sin(9 * x + 4 * y), 0.5 + 0.5 * np.cos(7 * y * x + 2 * x), x * y], -1)
    return a, np.clip(a + 0.2 * np.sin(60 * x)[..., None] * np.sin(45 * y)[..., None], 0, 1)


def slow_features(image: np.ndarray, weights: dict[str, np.ndarray]) -> list[np.ndarray]:
    maps, result, layer = (((2 * image - 1) - SHIFT) / SCALE).transpose(2, 0, 1).astype(float), [], 0
    for block, convolutions in enumerate(BLOCKS):
        if block:
            _, height, width = maps.shape
            maps = np.array([[[m[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].max() for j in range(width // 2)]
                              for i in range(height // 2)] for m in maps])  # fmt: skip
        for _ in range(convolutions):
            kernel, bias = weights[f"kernel_{layer}"].astype(float), weights[f"bias_{layer}"].astype(float)
            sums = [sum(correlate2d(m, k, "same") for m, k in zip(maps, taps, strict=True)) for taps in kernel]
            maps = np.maximum(np.array(sums) + bias[:, None, None], 0)
            layer += 1
        result.append(maps / (np.sqrt((maps**2).sum(0)) + 1e-10))
    return result


@pytest.mark.parametrize("size", SIZES)
def test_the_distance_is_that_of_sums_written_out_in_float64(size):
    weights = small_weights()
    lpips, (a, b) = Lpips(weights), pictures(*size)
    slow = [slow_features(image, weights) for image in (a, b)]
    distance = 0.0
    for block, (x, y) in enumerate(zip(*slow, strict=True)):
        for feature, weight in enumerate(weights[f"linear_{block}"]):
            distance += weight * np.mean((x[feature] - y[feature]) ** 2)
    assert lpips(a, b) == pytest.approx(distance, rel=1e-5) and lpips(a, a) == 0
    assert lpips.distances([a, b, b], a) == [0, lpips(b, a), lpips(b, a)]


@pytest.mark.parametrize("size", [(500, 21), (513, 40), (160, 16)])
def test_bands_change_nothing(size, monkeypatch):
    lpips, (a, b) = Lpips(small_weights()), pictures(*size)
    whole = lpips(a, b)
    for pixels in (1, 100 * size[1], 250 * size[1]):
        monkeypatch.setattr(module, "BAND", pixels)
        assert len(list(module._bands(*size))) > 1 or pixels > size[0] * size[1] // 2
        assert lpips(a, b) == pytest.approx(whole, rel=1e-6)


@pytest.mark.parametrize(
    ("size", "expected"), [((64, 64), 0.37226951), ((37, 53), 0.37235916), ((200, 300), 0.59547138)]
)
def test_the_real_weights_give_what_the_package_lpips_gives(size, expected):
    """Expected: ``lpips.LPIPS(net="vgg")`` of lpips 0.1.4 with torch 2.13.0, float32."""
    if not REAL.exists():
        pytest.skip(f"the weights are not installed ({REAL}); make lpips fetches them")
    assert Lpips(read_arrays(REAL))(*pictures(*size)) == pytest.approx(expected, abs=2e-7)


def test_a_mask_weighs_pixels_at_every_depth():
    lpips, (a, b) = Lpips(small_weights()), pictures(64, 48)
    assert lpips(a, b, np.ones((64, 48))) == lpips(a, b)
    assert lpips(a, b, np.full((64, 48), 0.3)) == pytest.approx(lpips(a, b), rel=1e-6)
    mask = np.zeros((64, 48))
    mask[16:48, 16:32] = 1  # of 16 pixels: whole ones at the last depth, too
    slow, weights = [slow_features(image, small_weights()) for image in (a, b)], small_weights()
    expected = 0.0
    for depth, (x, y) in enumerate(zip(*slow, strict=True)):
        errors = np.tensordot(weights[f"linear_{depth}"], (x - y) ** 2, 1)
        expected += errors[16 >> depth : 48 >> depth, 16 >> depth : 32 >> depth].mean()
    assert lpips(a, b, mask) == pytest.approx(expected, rel=1e-5)


def test_pictures_without_pixels_left_at_the_last_depth_or_of_different_sizes_are_refused():
    for shape in ((15, 40, 3), (40, 40, 4), (40, 40)):
        with pytest.raises(ValueError, match="16 x 16"):
            Lpips(small_weights())(np.zeros(shape), np.zeros(shape))
    with pytest.raises(ValueError, match=r"one size.*\[16, 16, 3\], \[16, 17, 3\]"):
        Lpips(small_weights())(np.zeros((16, 17, 3)), np.zeros((16, 16, 3)))


def test_without_a_file_there_is_none_and_a_broken_file_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    some, small = cameras(1, 16, 16), cameras(1, 40, 15)
    assert Lpips.installed(some) is None
    install(tmp_path)
    lpips = Lpips.installed(some)
    assert Lpips.installed(small) is None
    assert lpips is not None and lpips(*pictures(20, 20)) == Lpips(small_weights())(*pictures(20, 20))
    whole = weights_path().read_bytes()
    weights_path().write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"lpips_vgg16.npz.*make lpips"):
        Lpips.installed([])
    write_arrays(weights_path(), {"kernel_0": np.zeros((4, 3, 3, 3), np.float32)})
    with pytest.raises(DataError, match="make lpips"):
        Lpips.installed([])


def test_views_are_measured_by_it_where_it_is_given(tmp_path):
    lpips, (a, b) = Lpips(small_weights()), pictures(24, 32)
    view, color = View("a", cameras(1, 32, 24)[0], a.astype(np.float32)), (b + 0.5).astype(np.float32)
    alpha = np.ones(color.shape[:2], np.float32)
    results = evaluate_views(lambda v: Picture(color, alpha, None), [view], 0.0, measure=Measure(lpips=lpips))
    assert mean_metrics(results)["lpips"] == pytest.approx(lpips(np.clip(color, 0, 1), a), rel=1e-5)


def test_eval_says_it_where_it_is_installed(data, tmp_path, monkeypatch, capsys):
    model = tmp_path / "model.ply"
    write_ply(model, truth())
    lines = []
    for cache in ("empty", "full"):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / cache))
        assert main(["eval", str(model), str(data)]) in (0, None)
        lines.append(capsys.readouterr().out)
        install(tmp_path / "full")
    assert "LPIPS" not in lines[0] and lines[1].count("LPIPS") == lines[1].count("PSNR") > 1
