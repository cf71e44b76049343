"""Training options about images: random backgrounds, images on disk, floaters near cameras; and all at once."""

import gc
import json
import shutil
import tracemalloc
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.datasets.dataset import Recording, View, held
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.engine.parameters import device_array, device_bytes
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.picture import over_background, premultiplied
from mi_dogsplat.runs import run
from mi_dogsplat.runs.checkpoint import load_checkpoint
from mi_dogsplat.scene.appearance import APPEARANCE, read_appearance
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.events import Dropped
from mi_dogsplat.training.images.loss import PhotometricLoss
from mi_dogsplat.training.images.photographs import Photographs
from mi_dogsplat.training.images.read_ahead import READ_AHEAD
from mi_dogsplat.training.memory_budget import budget
from mi_dogsplat.training.strategy.sieve import near_cameras
from mi_dogsplat.training.train import Trainer
from photographs import PIXELS, SHAPE, changed, config_of, image_of, left_half, planes_of, trained, write_masks
from PIL import Image
from same_numbers import assert_same_numbers


def test_a_random_background_is_another_at_each_step_behind_render_and_photograph(alpha_data):
    dataset = load_dataset(alpha_data)
    photographs, rng = Photographs(dataset, 1.0, random=True), np.random.default_rng(0)
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


@pytest.mark.parametrize("keep_targets", [True, False])
def test_an_image_that_is_held_as_bytes_is_the_same_to_the_loss(data, keep_targets):
    dataset = load_dataset(data)
    as_bytes = replace(dataset, train=[held(view) for view in dataset.train])
    assert all(view.pixels is not None for view in as_bytes.train)
    as_floats = changed(dataset, lambda k, image: image)
    assert all(view.pixels is None for view in as_floats.train)
    render = planes_of(np.random.default_rng(1).uniform(0, 1, (*SHAPE, 3)).astype(np.float32))
    for view in range(3):
        (l1, loss, gradient), expected = (
            Photographs(each, 0.0, keep_targets=keep_targets).compare(render, view, 0) for each in (as_bytes, as_floats)
        )
        assert_same_numbers(l1.numpy(), expected[0].numpy())
        assert_same_numbers(loss.numpy(), expected[1].numpy())
        assert_same_numbers(image_of(gradient), image_of(expected[2]))


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
        trainer = trained(dataset, steps=150, background=background)
        holes = [trainer.picture(v).alpha[v.image[..., 3] < 0.01] for v in dataset.train]
        coverage[background] = float(np.concatenate(holes).mean())
    assert coverage["random"] < 0.2 * coverage["white"], coverage


def test_a_random_background_needs_alpha(data):
    with pytest.raises(DataError, match="random needs images with alpha"):
        Photographs(load_dataset(data), 0.0, random=True)


# --- images on disk ---


@pytest.mark.parametrize("downscale", [1, 2])
@pytest.mark.parametrize("alpha", [False, True])
def test_views_on_disk_are_the_views_in_memory(data, alpha_data, alpha, downscale):
    path = alpha_data if alpha else data
    memory, disk = load_dataset(path, downscale), load_dataset(path, downscale, on_disk=True)
    assert disk.has_alpha == alpha and [v.name for v in disk.views] == [v.name for v in memory.views]
    for ours, theirs in zip(disk.views, memory.views, strict=True):
        assert ours.n_bytes == 0 and np.array_equal(ours.image, theirs.image)
        assert np.array_equal(ours.camera.K, theirs.camera.K) and ours.camera.width == theirs.camera.width


def test_an_alpha_channel_that_is_opaque_everywhere_is_none_on_disk_either(data, tmp_path):
    copied = Path(shutil.copytree(data, tmp_path / "opaque"))
    for path in copied.rglob("*.png"):
        Image.open(path).convert("RGBA").save(path)
    for on_disk in (False, True):
        dataset = load_dataset(copied, on_disk=on_disk)
        assert not dataset.has_alpha and all(view.image.shape[2] == 3 for view in dataset.views)


def test_an_image_that_disappears_is_named(data, tmp_path):
    path = tiny_data.write_tiny_data(tmp_path)
    dataset = load_dataset(path, on_disk=True)
    (path / "images" / "3.png").unlink()
    with pytest.raises(DataError, match="3.png"):
        dataset.views[[v.name for v in dataset.views].index("3")].image  # noqa: B018


def test_training_from_disk_is_the_same_training(data):
    losses = []
    for on_disk in (False, True):
        trainer = Trainer(config_of(data_on_disk=on_disk), load_dataset(data, on_disk=on_disk))
        for _ in range(20):
            trainer.step()
        losses.append((trainer.losses.take()["l1"], trainer.training_l1()))
    assert losses[0] == pytest.approx(losses[1], rel=1e-3)


def test_only_a_few_images_from_disk_are_held_at_a_time_and_each_is_read_once_per_turn(data):
    dataset = load_dataset(data, on_disk=True)
    alive: list[weakref.ref] = []

    def read(view: View) -> Recording:
        recording = view.recording
        alive.append(weakref.ref(recording.image))
        return recording

    train = [View(v.name, v.camera, lambda v=v: read(v)) for v in dataset.train] * 2
    many = Dataset(dataset.path, train, dataset.test, dataset.points, dataset.point_colors, False)
    trainer = Trainer(config_of(data_on_disk=True), many)
    assert not alive
    for k in range(1, len(train) + 1):
        trainer.step()
        gc.collect()
        assert sum(ref() is not None for ref in alive) <= READ_AHEAD + 1
        assert len(alive) <= k + READ_AHEAD
    assert len(alive) == len(train)
    trainer.step()  # reads ahead for the next turn, which a measurement makes stale
    trainer.training_l1()
    assert len(alive) >= 2 * len(train)  # nothing is kept from the turn before
    trainer.photographs.l1(planes_of(np.zeros((*SHAPE, 3), np.float32)), 0)
    gc.collect()
    assert sum(ref() is not None for ref in alive) <= READ_AHEAD + 1


def test_masks_are_held_as_bytes_or_read_with_their_images(data, tmp_path, monkeypatch):
    read, of, uploaded = [], Masks.of, []
    monkeypatch.setattr(Masks, "of", lambda self, view: read.append(view.name) or of(self, view))

    def watched(values: np.ndarray, dtype: Any = None) -> Any:
        if values.ndim == 2:  # a mask; images have channels
            uploaded.append(dtype)
        return device_array(values, dtype)

    monkeypatch.setattr("mi_dogsplat.training.images.photographs.device_array", watched)
    folder = str(write_masks(tmp_path, load_dataset(data), left_half()))
    (tmp_path / f"{load_dataset(data).train[0].name}.png").unlink()
    l1, plain, byte = {}, budget("1G", load_dataset(data), 0), device_bytes()
    for on_disk in (False, True):
        dataset = load_dataset(data, on_disk=on_disk)
        read.clear()
        uploaded.clear()
        trainer = Trainer(config_of(masks=folder, data_on_disk=on_disk, memory="1G"), dataset)
        names = [view.name for view in dataset.train]
        assert read == (names[:1] if on_disk else names)  # on disk up to the first that is not black everywhere
        read.clear()
        assert uploaded == ([] if on_disk else [byte] * len(names[1:]))  # the first has none
        if not on_disk:
            assert trainer.memory and plain and trainer.memory.fixed - plain.fixed == len(dataset.train) * PIXELS
        for _ in dataset.train:
            trainer.step()
        l1[on_disk] = trainer.losses.take()["l1"], trainer.training_l1()
        assert len(read) == (2 * len(dataset.train) if on_disk else 0)  # on disk once in each turn
        assert uploaded == [byte] * (2 if on_disk else 1) * len(names[1:])
    assert l1[False] == pytest.approx(l1[True], rel=1e-3)


def test_a_mask_on_disk_that_cannot_be_read_is_named_when_it_is_due(data, tmp_path):
    dataset = load_dataset(data, on_disk=True)
    folder = write_masks(tmp_path, dataset, left_half())
    for view in dataset.train[1:]:  # the first tells that not all are black
        (folder / f"{view.name}.png").write_bytes(b"no picture")
    trainer = Trainer(config_of(masks=str(folder), data_on_disk=True), dataset)
    with pytest.raises(DataError, match=r"\.png"):
        for _ in dataset.train:
            trainer.step()


# --- near cameras ---


def test_near_cameras_finds_what_brute_force_finds():
    rng = np.random.default_rng(0)
    means, positions = rng.normal(size=(3000, 3)).astype(np.float32), rng.normal(size=(20, 3))
    expected = [any(np.linalg.norm(mean - position) < 0.4 for position in positions) for mean in means.astype(float)]
    assert near_cameras(means, positions, 0.4).tolist() == expected and 0 < sum(expected) < 3000


def test_near_cameras_does_not_look_at_each_primitive_from_each_camera():
    """The distances of 20,000 primitives from a thousand cameras would be 160 MB, and take as long as many steps."""
    rng = np.random.default_rng(0)
    means, positions = rng.normal(size=(20_000, 3)), rng.normal(size=(1000, 3)) + 100
    means[[7, 19_999]] = positions[[3, 999]]
    tracemalloc.start()
    near = near_cameras(means, positions, 0.01)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.flatnonzero(near).tolist() == [7, 19_999] and peak < 2e6


def with_seven_beside_a_camera(dataset: Dataset) -> Trainer:
    """A training that drops them at its rows, every five steps."""
    trainer = Trainer(config_of(near_zone=1.0, log_every=5, steps=1000), dataset)
    means = trainer.optimizer.numpy("means")
    means[:7] = dataset.train[2].camera.position + 0.3
    trainer.optimizer.assign("means", means)
    return trainer


def test_primitives_in_the_near_zone_are_dropped_with_a_note(data):
    dataset = load_dataset(data)
    trainer = with_seven_beside_a_camera(dataset)
    n, events = trainer.optimizer.n, [trainer.step() for _ in range(5)]
    assert events == [[], [], [], [], [Dropped(7, "primitives near cameras")]]
    assert trainer.optimizer.n == n - 7 and trainer.begin() == []
    with pytest.raises(DataError, match="--near-zone"):
        trained(dataset, near_zone=100.0, log_every=5)


def test_neither_the_state_nor_the_begin_of_a_run_that_goes_on_drops_what_is_near_between_rows(data):
    trainer = with_seven_beside_a_camera(load_dataset(data))
    trainer.step()
    n = trainer.optimizer.n
    assert trainer.sound() and trainer.state()["step"] == 1
    for step in (5, 1):  # after that of a row, too: what densification has put there since waits for the next
        trainer.step_count = step
        assert trainer.begin() == [] and trainer.optimizer.n == n
    assert [trainer.step() for _ in range(4)][-1] == [Dropped(7, "primitives near cameras")]


def test_options_are_written_to_the_run_and_a_whole_run_uses_them(data, tmp_path):
    masks = write_masks(tmp_path / "masks", load_dataset(data), left_half())
    options: dict[str, Any] = {"appearance": True, "masks": str(masks), "data_on_disk": True, "near_zone": 0.5}
    settings: dict[str, Any] = {"preset": "ours", "target": 0.5, "steps": 40, "sh_degree": 1, "max_primitives": 80}
    config = TrainConfig(str(data), **settings, **options)
    metrics = run.train(config, tmp_path / "run")
    assert metrics["n_dog"] > 0 and np.isfinite(metrics["test"]["psnr"])
    assert json.loads((tmp_path / "run" / "config.json").read_text()).items() >= options.items()


def test_over_background_of_a_frame_is_that_of_a_photograph(alpha_data):
    dataset = load_dataset(alpha_data)
    for background in (0.0, 1.0):
        photographs = Photographs(dataset, background)
        truth = over_background(dataset.train[0].image, background)
        l1, _, _ = photographs.compare(planes_of(truth), 0, 0)
        assert float(l1[0]) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    "options",
    [{"appearance": True}, {"background": "random"}, {"masks": "masks", "data_on_disk": True, "near_zone": 0.5}],
)
def test_a_run_with_options_stopped_and_resumed_has_the_bits_of_one_that_was_not(data, alpha_data, tmp_path, options):
    source = alpha_data if "background" in options else data
    if "masks" in options:
        options = options | {"masks": str(write_masks(tmp_path / "masks", load_dataset(source), left_half()))}
    config = config_of(data=str(source), steps=20, log_every=5, checkpoint_seconds=0, **options)

    def stop(row: dict) -> None:
        if row["step"] > 11:
            raise KeyboardInterrupt

    run.train(config, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run.train(config, tmp_path / "parts", stop)
    assert load_checkpoint(tmp_path / "parts" / run.CHECKPOINT)["step"] > 0
    run.train(config, tmp_path / "parts", resume=True)
    whole, parts = (load_checkpoint(tmp_path / name / run.CHECKPOINT) for name in ("whole", "parts"))
    names = [name for name in whole if name.startswith("appearance.")]
    rows = [f"appearance.{part}_{name}" for part in ("devices", "images") for name in ("m", "t", "v", "values")]
    assert sorted(names) == ([*rows, "appearance.mean"] if "appearance" in options else [])
    assert all(np.abs(whole[name]).max() > 0 for name in names)
    if lanes_add_in_turn(mi.variant()):
        assert all(np.array_equal(whole[name], parts[name]) for name in whole if name != "seconds")


def test_a_run_with_appearance_is_also_measured_after_fits_and_with_masks_where_they_are_white(data, tmp_path):
    dataset = load_dataset(data)
    masks = write_masks(tmp_path / "masks", dataset, left_half())
    metrics = run.train(config_of(data=str(data), steps=20, appearance=True, masks=str(masks)), tmp_path / "run")
    assert metrics["test"]["cc_psnr"] > metrics["test"]["psnr"] and metrics["test"]["half_psnr"] > 0
    stored = read_appearance(tmp_path / "run" / APPEARANCE)
    assert list(stored.names) == [view.name for view in dataset.train] and np.abs(stored.of_images).max() > 0
    assert "Appearance of the photographs" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    for name, values in metrics["views"].items():
        pair = [read_image(tmp_path / "run" / "test" / f"{name}{end}.png")[:, SHAPE[1] // 2 :] for end in ("", "_gt")]
        assert values["psnr"] == pytest.approx(psnr(*pair), abs=0.05)  # of pictures of 8 bits
