"""Training options about images: exposure, masks, random backgrounds, images on disk; and floaters near cameras."""

import gc
import json
import weakref
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from mi_dogsplat import run
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.datasets.dataset import DiskView, View
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.datasets.masks import read_mask
from mi_dogsplat.engine.composite_derivatives import lanes_add_in_turn
from mi_dogsplat.errors import DataError
from mi_dogsplat.metrics import psnr
from mi_dogsplat.pictures import write_png
from mi_dogsplat.render import over_background, premultiplied
from mi_dogsplat.training import exposure as exposure_module
from mi_dogsplat.training.checkpoint import load_checkpoint
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.exposure import Exposure
from mi_dogsplat.training.loss import PhotometricLoss
from mi_dogsplat.training.photographs import READ_AHEAD, Photographs
from mi_dogsplat.training.sieve import near_cameras
from mi_dogsplat.training.train import Trainer

SHAPE = tiny_data.HEIGHT, tiny_data.WIDTH
PIXELS = tiny_data.WIDTH * tiny_data.HEIGHT


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return tiny_data.write_tiny_data(tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="module")
def alpha_data(tmp_path_factory) -> Path:
    return tiny_data.write_tiny_data(tmp_path_factory.mktemp("alpha"), alpha=True)


def config_of(**settings) -> TrainConfig:
    usual: dict[str, Any] = {"data": "", "preset": "3dgs", "steps": 60, "sh_degree": 0, "max_primitives": 100}
    return TrainConfig(**(usual | settings))


def planes_of(image: np.ndarray) -> list:
    return [mi.Float(np.ascontiguousarray(image[..., c]).ravel()) for c in range(3)]


def image_of(planes: list) -> np.ndarray:
    return np.stack([plane.numpy() for plane in planes], -1).reshape(*SHAPE, 3)


def trained(dataset: Dataset, **settings) -> Trainer:
    trainer = Trainer(config_of(**settings), dataset)
    for _ in range(trainer.config.steps):
        trainer.step()
    return trainer


def changed(dataset: Dataset, change) -> Dataset:
    """The data set with other training images: ``change(number, image)``."""
    train = [View(v.name, v.camera, change(k, v.image).astype(np.float32)) for k, v in enumerate(dataset.train)]
    return Dataset(dataset.path, train, dataset.test, dataset.points, dataset.point_colors, dataset.has_alpha)


# --- exposure ---


def test_the_identity_changes_nothing_and_a_map_is_applied_as_a_matrix():
    image = np.random.default_rng(0).uniform(size=(*SHAPE, 3)).astype(np.float32)
    exposure = Exposure(2, 100)
    assert np.array_equal(image_of(exposure.applied(planes_of(image), 1)), image)
    matrix = np.random.default_rng(1).normal(size=(2, 3, 4)).astype(np.float32)
    matrix[0] = 2 * np.eye(3, 4) - matrix[1]  # their mean is the identity
    exposure.restore(exposure.state() | {"values": matrix.reshape(2, 12)})
    expected = image @ matrix[1, :, :3].T + matrix[1, :, 3]
    assert image_of(exposure.applied(planes_of(image), 1)) == pytest.approx(expected, abs=1e-5)


def test_gradients_through_a_map_are_those_of_finite_differences(monkeypatch):
    """Of the loss Σ weight · exposed, in float64: linear, so that differences are exact."""
    rng = np.random.default_rng(0)
    image, weight = rng.uniform(size=(2, *SHAPE, 3))
    matrix = rng.normal(size=(2, 3, 4))
    matrix[1] = 2 * np.eye(3, 4) - matrix[0]
    exposure = Exposure(2, 100)
    exposure.restore({"values": matrix.reshape(2, 12).astype(np.float32), "t": np.zeros(2)})
    taken = []
    monkeypatch.setattr(Exposure, "_adam", lambda self, view, gradient, step: taken.append(gradient.numpy()))
    through = image_of(exposure.backward(planes_of(image.astype(np.float32)), planes_of(weight), 0, 0))

    def loss(image, matrix):
        return float((weight * (image @ matrix[0, :, :3].T + matrix[0, :, 3])).sum())

    for k in range(12):
        bumped = matrix.copy()
        bumped[0].reshape(12)[k] += 1e-3
        assert taken[0][k] == pytest.approx((loss(image, bumped) - loss(image, matrix)) / 1e-3, rel=1e-4)
    for index in [(0, 0, 0), (5, 7, 1), (30, 40, 2)]:
        bumped = image.copy()
        bumped[index] += 1e-3
        assert through[index] == pytest.approx((loss(bumped, matrix) - loss(image, matrix)) / 1e-3, rel=1e-4)


def test_the_step_of_a_map_is_adams_and_other_views_rest():
    """Oracle: Kingma and Ba 2015, Alg. 1, with the rate of the 3DGS release."""
    rng = np.random.default_rng(0)
    exposure, expected, m, v = Exposure(2, 100), np.eye(3, 4).ravel(), np.zeros(12), np.zeros(12)
    Float: Any = dr.detached_t(mi.Float)
    for t in range(1, 6):
        g = rng.normal(size=12)
        exposure._adam(1, Float(g.astype(np.float32)), step=10 * t)
        m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g
        rate = 0.01 * 0.1 ** (10 * t / 100)
        expected -= rate * (m / (1 - 0.9**t)) / (np.sqrt(v / (1 - 0.999**t)) + 1e-15)
    values = exposure.state()["values"]
    assert values[1] == pytest.approx(expected, rel=1e-4) and np.array_equal(values[0], np.eye(3, 4).ravel())


def test_the_mean_of_the_maps_is_the_identity_whatever_adam_does_and_after_a_restore():
    rng, exposure = np.random.default_rng(0), Exposure(5, 100)
    Float: Any = dr.detached_t(mi.Float)
    for step in range(60):
        exposure._adam(step % 5, Float(rng.normal(1, 1, 12).astype(np.float32)), step)
    again = Exposure(5, 100)
    again.restore(exposure.state())
    for maps in (exposure.numpy(), again.numpy()):
        assert maps.mean(axis=0) == pytest.approx(np.eye(3, 4), abs=1e-5)
        assert np.abs(maps - np.eye(3, 4)).max() > 1e-3
    assert exposure.state()["values"].mean(axis=0)[0] < 0.97  # which X alone are not


def test_exposure_takes_up_what_cameras_did_to_single_images(data, monkeypatch):
    monkeypatch.setattr(exposure_module, "RATE", 0.02)
    gains = np.linspace(0.6, 1.4, 8)
    shifted = changed(load_dataset(data), lambda k, image: np.clip(gains[k] * image, 0, 1))
    without, with_maps = (trained(shifted, steps=300, exposure=on, seed=1) for on in (False, True))
    assert with_maps.training_l1() < 0.8 * without.training_l1()
    maps = with_maps.photographs.exposure
    assert maps is not None
    brightness = maps.numpy()[:, range(3), range(3)].mean(axis=1)
    assert np.corrcoef(brightness, gains[: len(brightness)])[0, 1] > 0.9


@pytest.mark.parametrize(
    "options",
    [{"exposure": True}, {"background": "random"}, {"masks": "masks", "data_on_disk": True, "near_zone": 0.5}],
)
def test_a_run_with_options_stopped_and_resumed_has_the_bits_of_one_that_was_not(data, alpha_data, tmp_path, options):
    source = alpha_data if "background" in options else data
    if "masks" in options:
        options = options | {"masks": str(write_masks(tmp_path / "masks", load_dataset(source), left_half()))}
    config = config_of(data=str(source), steps=40, log_every=10, checkpoint_seconds=0, **options)

    def stop(row: dict) -> None:
        if row["step"] > 22:
            raise KeyboardInterrupt

    run.train(config, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run.train(config, tmp_path / "parts", stop)
    assert load_checkpoint(tmp_path / "parts" / run.CHECKPOINT)["step"] > 0
    run.train(config, tmp_path / "parts", resume=True)
    whole, parts = (load_checkpoint(tmp_path / name / run.CHECKPOINT) for name in ("whole", "parts"))
    names = [name for name in whole if name.startswith("exposure.")]
    maps = ["exposure.m", "exposure.mean_x", "exposure.t", "exposure.v", "exposure.values"]
    assert sorted(names) == (maps if "exposure" in options else [])
    assert all(np.abs(whole[name]).max() > 0 for name in names)
    if lanes_add_in_turn(mi.variant()):
        assert all(np.array_equal(whole[name], parts[name]) for name in whole if name != "seconds")


# --- masks ---


def write_masks(folder: Path, dataset: Dataset, used: np.ndarray, suffix: str = ".png") -> Path:
    for view in dataset.views:
        write_png(folder / f"{view.name}{suffix}", used.astype(np.float32))
    return folder


def left_half() -> np.ndarray:
    used = np.ones(SHAPE)
    used[:, : SHAPE[1] // 2] = 0
    return used


@pytest.mark.parametrize("options", [{}, {"exposure": True}, {"data_on_disk": True}])
def test_masked_pixels_have_no_gradient_whatever_they_show(data, tmp_path, options):
    dataset = load_dataset(data, on_disk=bool(options.get("data_on_disk")))
    used = left_half()
    config = config_of(masks=str(write_masks(tmp_path, dataset, used)), **options)
    images = np.random.default_rng(0).uniform(0.1, 0.9, (*SHAPE, 3)).astype(np.float32)
    other = np.where(used[..., None] > 0, images, 1 - images)
    results = []
    for image in (images, other):
        l1, loss, gradient = Photographs(config, dataset, 0.0).compare(planes_of(image), 0, 0)
        results.append((float(l1[0]), float(loss[0]), image_of(gradient)))
    (l1, loss, gradient), again = results
    assert (l1, loss) == pytest.approx(again[:2]) and np.abs(gradient - again[2]).max() < 1e-9
    assert not gradient[used == 0].any() and np.abs(gradient[used == 1]).min(axis=1).max() > 0


def test_inside_of_the_mask_and_away_from_its_edge_the_gradient_is_that_without(data, tmp_path):
    dataset, used = load_dataset(data), left_half()
    image = np.random.default_rng(0).uniform(0.1, 0.9, (*SHAPE, 3)).astype(np.float32)
    masked = Photographs(config_of(masks=str(write_masks(tmp_path, dataset, used))), dataset, 0.0)
    free = Photographs(config_of(), dataset, 0.0)
    gradients = [image_of(p.compare(planes_of(image), 2, 0)[2]) for p in (masked, free)]
    inside = slice(None), slice(SHAPE[1] // 2 + 11, None)
    assert gradients[0][inside] == pytest.approx(gradients[1][inside], rel=1e-3, abs=1e-9)


def test_training_with_masks_does_not_learn_what_they_hide(data, tmp_path):
    """A white box walks through the photographs, always somewhere else."""
    clean, used = load_dataset(data), np.ones((8, *SHAPE))
    for k, view in enumerate(clean.train):
        used[k, 2 + 2 * k : 20 + 2 * k, 4 * k : 20 + 4 * k] = 0
        write_png(tmp_path / f"{view.name}.png.png", used[k].astype(np.float32))  # COLMAP's way of naming
    spoiled = changed(clean, lambda k, image: np.where(used[k, ..., None] > 0, image, 1))
    without, hidden = (trained(spoiled, steps=250, masks=m).test_errors()["test_psnr"] for m in (None, str(tmp_path)))
    assert hidden > without + 1, (hidden, without)


def test_what_a_mask_hides_is_not_measured_and_a_view_that_is_all_black_is_left_out(data, tmp_path):
    config = config_of(steps=5, masks=str(tmp_path / "masks"))
    dataset = load_dataset(data)
    write_masks(tmp_path / "masks", dataset, left_half())
    hidden, clean = dataset.test[0], dataset.test[0].image
    spoiled = np.where(left_half()[..., None] > 0, clean, 1 - clean).astype(np.float32)
    found = []
    for image in (clean, spoiled):
        dataset.test[0] = View(hidden.name, hidden.camera, image)
        found.append(trained(dataset, steps=5, masks=config.masks).test_errors())
    assert found[0] == found[1]
    for view in dataset.test:
        write_png(tmp_path / "masks" / f"{view.name}.png", np.zeros(SHAPE, np.float32))
    assert trained(dataset, steps=5, masks=config.masks).test_errors(with_flip=True) == {}


def test_a_run_with_exposure_is_also_measured_after_the_best_map_and_with_masks_where_they_are_white(data, tmp_path):
    dataset = load_dataset(data)
    masks = write_masks(tmp_path / "masks", dataset, left_half())
    metrics = run.train(config_of(data=str(data), steps=20, exposure=True, masks=str(masks)), tmp_path / "run")
    assert metrics["test"]["cc_psnr"] > metrics["test"]["psnr"]
    for name, values in metrics["views"].items():
        pair = [read_image(tmp_path / "run" / "test" / f"{name}{end}.png")[:, SHAPE[1] // 2 :] for end in ("", "_gt")]
        assert values["psnr"] == pytest.approx(psnr(*pair), abs=0.05)  # of pictures of 8 bits


def test_masks_of_any_size_are_scaled_and_read_as_black_or_white(tmp_path):
    write_png(tmp_path / "m.png", np.array([[0, 1], [1, 0.2]], np.float32))
    assert read_mask(tmp_path / "m.png", 4, 6).tolist() == np.kron([[0, 1], [1, 0]], np.ones((3, 2))).tolist()
    assert read_mask(tmp_path / "m.png", 2, 2).tolist() == [[0, 1], [1, 0]]


def test_bad_masks_are_refused_in_one_line(data, tmp_path):
    dataset = load_dataset(data)
    with pytest.raises(DataError, match="no such folder"):
        Photographs(config_of(masks=str(tmp_path / "none")), dataset, 0.0)
    with pytest.raises(DataError, match="has no mask for any"):
        Photographs(config_of(masks=str(tmp_path)), dataset, 0.0)
    (tmp_path / f"{dataset.train[0].name}.png").write_text("no image")
    with pytest.raises(DataError, match="cannot be read"):
        Photographs(config_of(masks=str(tmp_path)), dataset, 0.0)


# --- random backgrounds ---


def test_a_random_background_is_another_at_each_step_behind_render_and_photograph(alpha_data):
    dataset = load_dataset(alpha_data)
    photographs, rng = Photographs(config_of(background="random"), dataset, 1.0), np.random.default_rng(0)
    image = np.random.default_rng(1).uniform(0.1, 0.9, (*SHAPE, 3)).astype(np.float32)
    colors = []
    for _ in range(3):
        photographs.choose_background(rng)
        assert photographs.color
        colors.append(np.array([float(level[0]) for level in photographs.color]))
        rgba = dataset.train[1].image
        truth = rgba[..., :3] + (1 - rgba[..., 3:]) * colors[-1]
        loss = PhotometricLoss()
        expected = loss.value_and_gradient(planes_of(image), loss.target(truth.astype(np.float32)))
        l1, value, gradient = photographs.compare(planes_of(image), 1, 0)
        assert float(l1[0]) == pytest.approx(float(expected[0][0]), rel=1e-5)
        assert float(value[0]) == pytest.approx(float(expected[2][0]), rel=1e-5)
        assert image_of(gradient) == pytest.approx(image_of(expected[3]), rel=1e-3, abs=1e-9)
    assert len(np.unique(np.round(colors, 6))) == 9


def test_with_a_random_background_nothing_opaque_stands_where_the_photograph_is_transparent(alpha_data):
    """The points are those of a whole model, the photographs of its half: the rest may turn white on white only."""
    half, cameras = tiny_data.truth(), tiny_data.cameras()
    half = half.select(half.means[:, 0] > 0)
    whole = load_dataset(alpha_data)
    images = {v.name: premultiplied(tiny_data.picture(half, cameras[int(v.name)]), 0.0) for v in whole.train}
    dataset = changed(whole, lambda k, _: images[whole.train[k].name])
    dataset.point_colors = np.ones_like(whole.point_colors)
    coverage = {}
    for background in ("white", "random"):
        trainer = trained(dataset, steps=300, background=background)
        holes = [trainer.picture(v).alpha[v.image[..., 3] < 0.01] for v in dataset.train]
        coverage[background] = float(np.concatenate(holes).mean())
    assert coverage["random"] < 0.5 * coverage["white"], coverage


def test_a_random_background_needs_alpha(data):
    with pytest.raises(DataError, match="random needs images with alpha"):
        Photographs(config_of(background="random"), load_dataset(data), 0.0)


# --- images on disk ---


@pytest.mark.parametrize("downscale", [1, 2])
@pytest.mark.parametrize("alpha", [False, True])
def test_views_on_disk_are_the_views_in_memory(data, alpha_data, alpha, downscale):
    path = alpha_data if alpha else data
    memory, disk = load_dataset(path, downscale), load_dataset(path, downscale, on_disk=True)
    assert disk.has_alpha == alpha and [v.name for v in disk.views] == [v.name for v in memory.views]
    for ours, theirs in zip(disk.views, memory.views, strict=True):
        assert isinstance(ours, DiskView) and np.array_equal(ours.image, theirs.image)
        assert np.array_equal(ours.camera.K, theirs.camera.K) and ours.camera.width == theirs.camera.width


def test_an_image_that_disappears_is_named(data, tmp_path):
    path = tiny_data.write_tiny_data(tmp_path)
    dataset = load_dataset(path, on_disk=True)
    (path / "images" / "3.png").unlink()
    with pytest.raises(DataError, match="3.png"):
        dataset.views[[v.name for v in dataset.views].index("3")].image  # noqa: B018
    with pytest.raises(AttributeError):
        dataset.views[0].nothing  # type: ignore[attr-defined]  # noqa: B018


def test_training_from_disk_is_the_same_training(data):
    losses = []
    for on_disk in (False, True):
        trainer = Trainer(config_of(data_on_disk=on_disk), load_dataset(data, on_disk=on_disk))
        for _ in range(20):
            trainer.step()
        losses.append((trainer.take_losses()["l1"], trainer.training_l1()))
    assert losses[0] == pytest.approx(losses[1], rel=1e-3)


def test_only_a_few_images_from_disk_are_held_at_a_time_and_each_is_read_once_per_turn(data):
    dataset = load_dataset(data, on_disk=True)
    alive: list[weakref.ref] = []

    class Counted(DiskView):
        def __getattr__(self, name: str) -> np.ndarray:
            image = super().__getattr__(name)
            alive.append(weakref.ref(image))
            return image

    train: list[View] = [Counted(v.name, v.camera, lambda v=v: v.image.copy()) for v in dataset.train] * 3
    many = Dataset(dataset.path, train, dataset.test, dataset.points, dataset.point_colors, False)
    trainer = Trainer(config_of(data_on_disk=True), many)
    assert not alive and not trainer.photographs._kept
    for k in range(1, len(train) + 1):
        trainer.step()
        gc.collect()
        assert sum(ref() is not None for ref in alive) <= READ_AHEAD + 1
        assert len(alive) <= k + READ_AHEAD
    assert len(alive) == len(train)
    trainer.step()  # reads ahead for the next turn, which a measurement makes stale
    trainer.training_l1()
    trainer.photographs.l1(planes_of(np.zeros((*SHAPE, 3), np.float32)), 0)
    gc.collect()
    assert sum(ref() is not None for ref in alive) <= READ_AHEAD + 1


# --- near cameras ---


def test_near_cameras_finds_what_brute_force_finds():
    rng = np.random.default_rng(0)
    means, positions = rng.normal(size=(3000, 3)).astype(np.float32), rng.normal(size=(20, 3))
    expected = [any(np.linalg.norm(mean - position) < 0.4 for position in positions) for mean in means.astype(float)]
    assert near_cameras(means, positions, 0.4).tolist() == expected and 0 < sum(expected) < 3000


def test_primitives_in_the_near_zone_are_dropped_with_a_note(data):
    dataset = load_dataset(data)
    trainer = Trainer(config_of(near_zone=1.0, log_every=5, steps=1000), dataset)
    means = trainer.optimizer.numpy("means")
    means[:7] = dataset.train[2].camera.position + 0.3
    trainer.optimizer.set("means", means)
    n, rows = trainer.optimizer.n, [trainer.step() for _ in range(5)]
    assert rows[:4] == [{}] * 4 and rows[4]["event"] == "dropped 7 primitives near cameras"
    assert trainer.optimizer.n == n - 7 and trainer.begin() == {}
    with pytest.raises(DataError, match="--near-zone"):
        trained(dataset, near_zone=100.0, log_every=5)


def test_options_are_written_to_the_run_and_a_whole_run_uses_them(data, tmp_path):
    masks = write_masks(tmp_path / "masks", load_dataset(data), left_half())
    options: dict[str, Any] = {"exposure": True, "masks": str(masks), "data_on_disk": True, "near_zone": 0.5}
    config = TrainConfig(str(data), preset="ours", target=0.5, steps=40, sh_degree=1, max_primitives=80, **options)
    metrics = run.train(config, tmp_path / "run")
    assert metrics["n_dog"] > 0 and np.isfinite(metrics["test"]["psnr"])
    assert json.loads((tmp_path / "run" / "config.json").read_text()).items() >= options.items()


def test_over_background_of_a_frame_is_that_of_a_photograph(alpha_data):
    dataset = load_dataset(alpha_data)
    for background in (0.0, 1.0):
        photographs = Photographs(config_of(), dataset, background)
        truth = over_background(dataset.train[0].image, background)
        l1, _, _ = photographs.compare(planes_of(truth), 0, 0)
        assert float(l1[0]) == pytest.approx(0, abs=1e-6)
