"""The training loss and its hand-written gradient, against a float64 twin and scikit-image."""

import numpy as np
import pytest
from mi_dogsplat.support.llvm import choose_llvm

choose_llvm()
mi = pytest.importorskip("mitsuba", reason="needs pip install mitsuba")
dr = pytest.importorskip("drjit")

from mi_dogsplat.engine.parameters import device_array  # noqa: E402
from mi_dogsplat.training.images.blur import gaussian_window  # noqa: E402
from mi_dogsplat.training.images.loss import PhotometricLoss  # noqa: E402

C1, C2 = 0.01**2, 0.03**2
SIZES = [(13, 9), (33, 17), (64, 40), (5, 3), (1, 1), (1, 40), (40, 1), (8, 8), (9, 16), (101, 75)]  # W, H


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("llvm_ad_rgb")


def blur_matrix(n: int) -> np.ndarray:
    """[n, n]: row i holds the window centred on i, zeros outside the image."""
    offset = np.subtract.outer(np.arange(n), np.arange(n)) + 5
    return np.where((offset >= 0) & (offset <= 10), np.take(gaussian_window(), offset.clip(0, 10)), 0.0)


def ssim_map(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """SSIM per pixel and channel in float64, by its definition; x, y [3, H, W]."""
    along_y, along_x = blur_matrix(x.shape[1]), blur_matrix(x.shape[2])

    def mean(image: np.ndarray) -> np.ndarray:
        return along_y @ image @ along_x.T

    mx, my = mean(x), mean(y)
    covariance = mean(x * y) - mx * my
    variances = mean(x * x) - mx**2 + mean(y * y) - my**2
    return (2 * mx * my + C1) * (2 * covariance + C2) / ((mx**2 + my**2 + C1) * (variances + C2))


def twin(x: np.ndarray, y: np.ndarray, dssim_weight: float = 0.2) -> tuple[float, float, float]:
    """L1, 1 - SSIM and the loss in float64; x is clamped to [0, 1]."""
    x = x.clip(0, 1)
    l1, dssim = float(np.abs(x - y).mean()), float(1 - ssim_map(x, y).mean())
    return l1, dssim, (1 - dssim_weight) * l1 + dssim_weight * dssim


def finite_differences(x: np.ndarray, y: np.ndarray, step: float = 1e-6) -> np.ndarray:
    gradient = np.zeros_like(x)
    for i in np.ndindex(*x.shape):
        for sign in (1, -1):
            moved = x.copy()
            moved[i] += sign * step
            gradient[i] += sign * twin(moved, y)[2] / (2 * step)
    return gradient


def pictures(width: int, height: int, low: float = 0.0, high: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A target with structure and a noisy copy in [low, high]; float32 values in float64 arrays [3, H, W]."""
    rng = np.random.default_rng(width * 1000 + height)
    v, u = np.mgrid[:height, :width]
    y = 0.5 + 0.3 * np.sin(np.stack([u / 3 + v / 5, u / 4 - v / 3, v / 2]))
    y += rng.uniform(-0.1, 0.1, y.shape)
    x = y + rng.normal(0, 0.15, y.shape)
    return x.clip(low, high).astype(np.float32).astype(float), y.astype(np.float32).astype(float)


def run(x: np.ndarray, y: np.ndarray, loss: PhotometricLoss | None = None):
    """Numbers (l1, dssim, loss) and the gradient [3, H, W]; x goes in as three planes."""
    loss = loss or PhotometricLoss()
    planes = [dr.detach(device_array(plane), preserve_type=False) for plane in x]
    target = loss.target(y.transpose(1, 2, 0).astype(np.float32))
    *values, gradient = loss.value_and_gradient(planes, target)
    return [v[0] for v in values], np.stack([g.numpy() for g in gradient]).reshape(x.shape)


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_values_equal_those_of_the_float64_twin(width, height):
    x, y = pictures(width, height)
    values, gradient = run(x, y)
    assert values == pytest.approx(twin(x, y), abs=2e-6)
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize(("width", "height"), [(13, 9), (17, 4), (5, 3), (1, 1), (1, 40), (23, 1)])
def test_gradient_equals_finite_differences_at_every_pixel(width, height):
    x, y = pictures(width, height, 0.05, 0.95)
    x[np.abs(x - y) < 1e-4] += 1e-3  # away from the kink of |x - y|
    _, gradient = run(x, y)
    expected = finite_differences(x, y)
    error = np.abs(gradient - expected)
    tolerance = 1e-3 * np.abs(expected) + 1e-4 * np.abs(expected).max()
    at = map(tuple, np.argwhere(error > tolerance))
    wrong = [f"{i}: {gradient[i]:.4g}, not {expected[i]:.4g}" for i in at]
    assert not wrong, "\n".join(wrong)


def test_pixels_outside_0_1_are_clamped_and_have_no_gradient():
    x, y = pictures(13, 9)
    x[0, 2, 3], x[1, 4, 4], x[2, 0, 0] = 1.5, -0.25, 1.0
    values, gradient = run(x, y)
    assert values == pytest.approx(twin(x, y), abs=2e-6)
    assert gradient[0, 2, 3] == 0 and gradient[1, 4, 4] == 0
    assert gradient[2, 0, 0] != 0  # the border itself is not clamped


def test_joined_planes_give_what_three_planes_give():
    x, y = pictures(33, 17)
    loss, Float = PhotometricLoss(), dr.detached_t(mi.Float)
    target = loss.target(y.transpose(1, 2, 0))
    *_, planes = loss.value_and_gradient([Float(p.ravel().astype(np.float32)) for p in x], target)
    *_, joined = loss.value_and_gradient(Float(x.ravel().astype(np.float32)), target)
    np.testing.assert_array_equal(np.concatenate([p.numpy() for p in planes]), joined.numpy())


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_l1_alone_is_that_of_the_whole_loss(width, height):
    x, y = pictures(width, height, -0.3, 1.3)
    loss, Float = PhotometricLoss(), dr.detached_t(mi.Float)
    target = loss.target(y.transpose(1, 2, 0))
    for image in ([Float(p.ravel().astype(np.float32)) for p in x], Float(x.ravel().astype(np.float32))):
        assert loss.l1(image, target)[0] == pytest.approx(twin(x, y)[0], abs=2e-6)


def test_planes_may_be_unevaluated_and_attached_to_a_graph():
    x, y = pictures(13, 9)
    loss = PhotometricLoss()
    target = loss.target(y.transpose(1, 2, 0))
    planes = [mi.Float(p.ravel().astype(np.float32)) for p in x]
    dr.enable_grad(planes)
    *_, value, gradient = loss.value_and_gradient([2 * p - p for p in planes], target)
    assert value[0] == pytest.approx(twin(x, y)[2], abs=2e-6)
    assert not any(dr.grad_enabled(g) for g in gradient)


def test_the_inner_pixels_of_ssim_equal_those_of_scikit_image():
    metrics = pytest.importorskip("skimage.metrics", reason="needs pip install scikit-image")
    x, y = pictures(64, 40)
    _, theirs = metrics.structural_similarity(
        x, y, channel_axis=0, gaussian_weights=True, sigma=1.5, truncate=3.5, use_sample_covariance=False,
        data_range=1.0, full=True,
    )  # fmt: skip
    np.testing.assert_allclose(ssim_map(x, y)[:, 5:-5, 5:-5], theirs[:, 5:-5, 5:-5], atol=1e-12)


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_equal_constant_images_have_no_loss_and_a_finite_gradient(value):
    x = np.full((3, 21, 30), value)
    (l1, dssim, loss), gradient = run(x, x)
    assert l1 == 0
    assert abs(dssim) < 1e-5 and abs(loss) < 1e-5
    assert np.isfinite(gradient).all()
    assert np.abs(gradient).max() * x.size < 0.05  # where a visible error has a gradient of order 1


def test_black_on_white_has_a_finite_gradient():
    x, y = np.zeros((3, 12, 12)), np.ones((3, 12, 12))
    values, gradient = run(x, y)
    assert values == pytest.approx(twin(x, y), abs=2e-6)
    assert np.isfinite(gradient).all() and (gradient < 0).any()


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_the_weight_mixes_l1_and_dssim(weight):
    x, y = pictures(16, 11)
    (l1, dssim, loss), gradient = run(x, y, PhotometricLoss(weight))
    assert loss == pytest.approx((l1, dssim)[int(weight)], abs=1e-7)
    if weight == 0:
        np.testing.assert_allclose(gradient, np.sign(x - y) / x.size, rtol=1e-6)


def test_image_sizes_share_their_kernels():
    """Nothing depends on a size but what is opaque, nor on how NumPy happens to align memory."""
    loss, forms = PhotometricLoss(), {}
    sizes = [(13, 9), (40, 24), (64, 40), (27, 50), (1, 40), (33, 21), (50, 27), (70, 3)]
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for width, height in sizes:
            dr.kernel_history_clear()
            run(*pictures(width, height), loss)
            for k in dr.kernel_history():
                if k["type"] == dr.KernelType.JIT:
                    forms.setdefault(k["operation_count"], set()).add(k["hash"])
    counts = {operations: len(found) for operations, found in forms.items()}
    assert counts and set(counts.values()) == {1}, counts


def test_a_step_takes_four_kernels_one_to_join_the_planes_and_reductions():
    x, y = pictures(40, 24)
    loss, Float = PhotometricLoss(), dr.detached_t(mi.Float)
    target = loss.target(y.transpose(1, 2, 0))
    planes = [Float(p.ravel().astype(np.float32)) for p in x]
    dr.eval(planes)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        result = loss.value_and_gradient(planes, target)
        kernels = [k["type"] for k in dr.kernel_history()]
    assert kernels.count(dr.KernelType.JIT) == 5, result


def test_wrong_shapes_are_named():
    loss, Float = PhotometricLoss(), dr.detached_t(mi.Float)
    with pytest.raises(ValueError, match=r"\(4, 5\).*\[height, width, 3\]"):
        loss.target(np.zeros((4, 5)))
    with pytest.raises(ValueError, match="planes of .20, 20, 21. values, target 5x4 needs three of 20"):
        planes = [dr.zeros(Float, n) for n in (20, 20, 21)]
        loss.value_and_gradient(planes, loss.target(np.zeros((4, 5, 3))))
