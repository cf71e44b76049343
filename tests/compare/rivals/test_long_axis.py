"""Long-axis split: where the halves are and how large, by rotation matrices."""

import numpy as np
from mi_dogsplat.compare.rivals.long_axis import LongAxisHalves
from mi_dogsplat.training.strategy.densify import Choice, grow_and_remove
from stepped_optimizers import optimizer_of


def rotation(q: np.ndarray) -> np.ndarray:
    x, y, z, w = q / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def test_halves_lie_on_either_side_along_the_longest_axis_smaller_and_fainter():
    optimizer = optimizer_of([0.1, 0.2, 0.3], [0.5, 0.9, 0.2])
    scales = optimizer.numpy("log_scales")
    scales[1] = np.log([0.1, 0.5, 0.2])
    optimizer.assign("log_scales", scales)
    before = {name: optimizer.numpy(name).astype(float) for name in ("means", "quats", "log_scales")}
    split = np.array([True, True, False])
    done = grow_and_remove(
        optimizer, Choice(split, np.zeros(3, bool), np.zeros(3, bool)), 1.6, np.random.default_rng(0), LongAxisHalves()
    )
    assert (done.cloned, done.split, done.removed, optimizer.n) == (0, 2, 0, 5)
    means, after = optimizer.numpy("means"), np.exp(optimizer.numpy("log_scales").astype(float))
    opacity = 1 / (1 + np.exp(-optimizer.numpy("logit_opacities").astype(float)))
    np.testing.assert_array_equal(means[0], before["means"][2].astype(np.float32))
    for k, (a, b) in enumerate(((1, 3), (2, 4))):
        s = np.exp(before["log_scales"][k])
        axis = int(s.argmax())
        way = rotation(before["quats"][k])[:, axis] * 3 * 0.45 * s[axis]
        np.testing.assert_allclose(means[a], before["means"][k] + way, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(means[b], before["means"][k] - way, rtol=1e-5, atol=1e-6)
        expected = np.where(np.arange(3) == axis, s * 0.55, s * np.sqrt(1 - 0.45**2))
        np.testing.assert_allclose(after[[a, b]], [expected, expected], rtol=1e-5)
        np.testing.assert_allclose(opacity[[a, b]], 0.6 * [0.5, 0.9][k], rtol=1e-5)
