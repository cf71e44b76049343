"""Exposure, white balance and vignetting of the training images: their steps, what fixes them, what they take up."""

from typing import Any

import numpy as np
import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.reference.image_formation import formed, formed_gradients
from mi_dogsplat.scene.appearance import Appearance, device_of, radii_squared, read_appearance
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.images.appearance import BEND, END, STIFFNESS, LearnedAppearance
from mi_dogsplat.training.images.rows_of_numbers import RowsOfNumbers
from photographs import SHAPE, changed, image_of, planes_of, trained

SIZE = SHAPE[1], SHAPE[0]
CAMERA = Camera(np.eye(4), 30.0, 30.0, SIZE[0] / 2, SIZE[1] / 2, *SIZE)
OF_IMAGES, OF_DEVICES = np.array([[1.0, 0.5, 0], [-1, 0, 0.25]]), np.array([[-0.5, 0]])
STORED = Appearance(["one", "two"], [device_of(CAMERA)], OF_IMAGES, OF_DEVICES)


def test_numbers_begin_as_the_identity():
    image = np.random.default_rng(0).uniform(size=(*SHAPE, 3)).astype(np.float32)
    learned = LearnedAppearance([CAMERA] * 2, 100)
    np.testing.assert_allclose(image_of(learned.applied(planes_of(image), 1, SIZE)), image, atol=1e-6)


def test_a_step_is_adams():
    """Oracle: Kingma and Ba 2015, Alg. 1, with a second moment that forgets sooner."""
    rng, rates = np.random.default_rng(0), np.array([1.0, 0.5])
    rows, expected, m, v = RowsOfNumbers(3, rates), np.zeros(2), np.zeros(2), np.zeros(2)
    for t in range(1, 6):
        g = rng.normal(size=2)
        rows.step(1, array_types().Float(g.astype(np.float32)), 0.1 / t)
        m, v = 0.9 * m + 0.1 * g, 0.95 * v + 0.05 * g * g
        expected -= 0.1 / t * rates * (m / (1 - 0.9**t)) / np.sqrt(v / (1 - 0.95**t))
    np.testing.assert_allclose(rows.numpy()[1], expected, rtol=1e-4)
    assert not rows.numpy()[[0, 2]].any()
    rows = RowsOfNumbers(1, rates, most=0.0)
    rows.step(0, array_types().Float([-1.0, 1.0]), 0.1)
    assert rows.numpy()[0].tolist() == pytest.approx([0, -0.05])


def test_the_loss_has_a_term_that_holds_the_numbers(monkeypatch):
    """A gradient of zero from the photograph leaves that of the term, λ x / (1 + (x / x₀)²) times its weight."""
    learned, taken = LearnedAppearance([CAMERA] * 2, 100), []
    state = learned.state()
    state["images_values"] = np.array([[0.4, -0.1, 0.02], [-0.4, 0.1, -0.02]], np.float32)  # of mean 0
    state["devices_values"] = np.array([[-0.5, 0.03]], np.float32)
    learned.restore(state)
    monkeypatch.setattr(LearnedAppearance, "_step", lambda self, *arguments: taken.extend(arguments[1:]))
    image, step = np.random.default_rng(0).uniform(size=(*SHAPE, 3)), 50
    learned.backward(planes_of(image), planes_of(0 * image), 0, SIZE, step)
    x = np.array([0.4, -0.1, 0.02, -0.5, 0.03])
    weight = formed_gradients(image, radii_squared(CAMERA), x, np.ones_like(image))[1][:3].sum() / image.size
    np.testing.assert_allclose(taken[0].numpy(), weight * STIFFNESS * x / (1 + (x / BEND) ** 2), rtol=1e-4)
    assert taken[1] == pytest.approx(learned.rate * END**0.5)


def test_the_mean_of_the_gains_is_zero_whatever_the_steps_and_after_a_restore():
    rng, learned = np.random.default_rng(0), LearnedAppearance([CAMERA] * 5, 100)
    for k in range(60):
        image, gradient = rng.uniform(size=(*SHAPE, 3)), rng.uniform(0.1, 1, (*SHAPE, 3))
        learned.backward(planes_of(image), planes_of(gradient / image.size), k % 5, SIZE, k)
    again = LearnedAppearance([CAMERA] * 5, 100)
    again.restore(learned.state())
    for each in (learned, again):
        gains = each.stored([""] * 5).of_images
        assert np.abs(gains.mean(axis=0)).max() < 1e-5 < 1e-3 < np.abs(gains).max()
    assert learned.state()["images_values"].mean() < -0.1  # those that Adam moved


def test_gains_reach_as_far_however_many_views_a_step_has():
    one, four = (LearnedAppearance([CAMERA] * 50, 4000, k) for k in (1, 4))
    assert four.rate == pytest.approx(one.rate / 4)


def test_each_device_has_its_vignetting():
    wide, other = (Camera(np.eye(4), f, f, 5, 5, 10, 10) for f in (8.0, 16.0))
    learned = LearnedAppearance([wide, other, wide], 100)
    assert len(learned.devices) == 2 and learned.device_of_view == [0, 1, 0]
    assert device_of(wide) == device_of(Camera(np.eye(4), 4.0, 4.0, 2.5, 2.5, 5, 5))  # the same pictures, smaller


def test_the_numbers_take_up_what_the_camera_did_to_single_images(data):
    dataset, rng = load_dataset(data), np.random.default_rng(3)
    gains = rng.uniform(-2, 0, (len(dataset.train), 1)) + rng.uniform(-0.2, 0.2, (len(dataset.train), 3))
    numbers = [np.append(g, [0, 0]) for g in gains]
    r_sq = radii_squared(dataset.train[0].camera)
    shifted = changed(dataset, lambda k, image: np.clip(formed(image, r_sq, numbers[k]), 0, 1))
    without, learned = (trained(shifted, steps=240, appearance=on, seed=1) for on in (False, True))
    assert learned.training_l1() < 0.85 * without.training_l1()
    found = learned.appearance()
    assert without.appearance() is None and found is not None
    exposures = found.of_images.mean(1), gains.mean(1)
    assert np.corrcoef(*exposures)[0, 1] > 0.9


def test_what_is_learned_is_written_and_read_again(tmp_path):
    STORED.write(tmp_path / "appearance.json")
    read = read_appearance(tmp_path / "appearance.json")
    for name, image in (("one", [1.0, 0.5, 0]), ("two", [-1, 0, 0.25]), ("three", [0, 0, 0]), (None, [0, 0, 0])):
        assert read.numbers(CAMERA, name).tolist() == pytest.approx([*image, -0.5, 0])
    stranger = Camera(np.eye(4), 300.0, 300.0, 5, 5, 10, 10)
    assert read.numbers(stranger, "one").tolist() == [1.0, 0.5, 0, 0, 0]


@pytest.mark.parametrize(
    "text", ["[]", "{}", '{"images": {"a": 1}, "devices": []}', '{"images": {}, "devices": [{"vignetting": [1]}]}', "{",
             '{"images": {}, "devices": [{"shape": [1e400, 75, 100], "vignetting": [0, 0]}]}',
             '{"images": {}, "devices": [{"shape": [100, 75], "vignetting": [0, 0]}]}',
             '{"images": {}, "devices": [{"shape": [true, 75, 100], "vignetting": [0, 0]}]}',
             '{"images": {"a": {"exposure": 1e400, "white_balance": [0, 0, 0]}}, "devices": []}',
             '{"images": {"a": {"exposure": NaN, "white_balance": [0, 0, 0]}}, "devices": []}'],
)  # fmt: skip
def test_a_file_that_holds_something_else_is_named_in_one_line(tmp_path, text):
    path = tmp_path / "appearance.json"
    path.write_text(text)
    with pytest.raises(DataError, match=r"appearance\.json.*--appearance") as error:
        read_appearance(path)
    assert "\n" not in str(error.value)


def test_a_checkpoint_with_the_affine_maps_of_an_earlier_version_is_refused(data):
    trainer: Any = trained(load_dataset(data), steps=1)
    with pytest.raises(ValueError, match="affine colour maps"):
        trainer.restore(trainer.state() | {"exposure.values": np.zeros((8, 12))})


def test_views_keep_their_names(data):
    trainer = trained(load_dataset(data), steps=1, appearance=True)
    names = [view.name for view in trainer.dataset.train if isinstance(view, View)]
    found = trainer.appearance()
    assert found is not None and list(found.names) == names
