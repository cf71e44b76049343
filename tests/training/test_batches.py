"""Several views in a step: the mean of their gradients, step sizes that fit it, and nothing lost on the way."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest
from launches import KernelWatch
from mi_dogsplat.compare.rivals import dash, mask_gaussian
from mi_dogsplat.compare.rivals.gaussian_spa import GaussianSpa
from mi_dogsplat.compare.rivals.gns import NaturalSelection
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.reference.gradients import gradients_tiled
from mi_dogsplat.runs import run
from mi_dogsplat.runs.checkpoint import load_checkpoint
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.optimizer.trained_arrays import EPSILON
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.densify import Densification
from mi_dogsplat.training.strategy.strategy import Seen, Strategy, Training, arrays_of
from mi_dogsplat.training.train import Trainer
from PIL import Image
from splat_scenes import SMOOTH_OPTIONS, assert_gradients_equal
from tiny_data import HEIGHT, WIDTH, dog_model

K = 3
UNIT = 1e4  # gradients of a mean over pixels are small


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "3dgs", "steps": 60, "sh_degree": 1, "max_primitives": 100, "log_every": 10}
    return TrainConfig(str(data), **(base | changes))


@pytest.fixture
def gradients(monkeypatch) -> list[dict[str, np.ndarray]]:
    """Those that each step of an optimizer finds on its parameters from now on; none of them moves anything."""
    found: list[dict[str, np.ndarray]] = []

    def note(self: SplatOptimizer, unused=()) -> None:
        found.append({name: dr.grad(value).numpy().copy() for name, value in self.adam.items()})
        for value in self.adam.values():
            dr.clear_grad(value)

    monkeypatch.setattr(SplatOptimizer, "step", note)
    return found


def uneven(trainer: Trainer) -> Trainer:
    """With primitives that are no spheres any more: the turn of a sphere has no derivative but rounding."""
    log_scales = trainer.optimizer.numpy("log_scales")
    trainer.optimizer.assign("log_scales", log_scales + np.random.default_rng(4).normal(size=log_scales.shape) / 2)
    return trainer


@dataclass
class Pictures:
    """State of ``Watch``."""

    adjoints: Any = None
    views: Any = None


@dataclass(frozen=True)
class Watch(Strategy[Pictures]):
    """Keeps the derivatives of the loss by the pictures."""

    def new_state(self, t: Training) -> Pictures:
        return Pictures([], [])

    def after_backward(self, t: Training, state: Pictures, seen: Seen) -> None:
        planes = [plane.numpy().reshape(seen.camera.height, seen.camera.width) for plane in seen.gradient]
        state.adjoints.append(np.stack(planes, -1).astype(np.float64))
        state.views.append(seen.view)


def test_the_gradient_of_a_batch_is_the_sum_of_those_of_its_views_in_float64(data, gradients, monkeypatch):
    """Without cutoffs, where both have derivatives everywhere; of primitives with and without DoG."""
    options = RasterOptions(sh_degree=1, **SMOOTH_OPTIONS)
    monkeypatch.setattr(Trainer, "options", property(lambda self: options))
    recipe = replace(RECIPES["3dgs"], also=(Watch(),))
    trainer = uneven(Trainer(config_of(data, batch_views=K), load_dataset(data), recipe))
    splats = trainer.optimizer.to_splats()
    trainer.optimizer.set_dog(np.arange(0, splats.n_splats, 2), *dog_numbers(splats))
    splats = trainer.optimizer.to_splats()
    trainer.step()
    watched = trainer.states["watch"]
    assert len(set(watched.views)) == K
    expected: dict[str, np.ndarray] = {}
    for view, adjoint in zip(watched.views, watched.adjoints, strict=True):
        camera = trainer.dataset.train[view].camera
        of_view = gradients_tiled(splats, camera, UNIT * adjoint, min_alpha=0, min_transmittance=0)
        expected = {name: values + expected.get(name, 0) for name, values in of_view.items()}
    got = {name: UNIT * values for name, values in gradients[0].items()}
    n = splats.n_splats
    sh = np.concatenate([got.pop("sh_dc").reshape(n, 1, 3), got.pop("sh_rest").reshape(n, -1, 3)[:, 1:]], 1)
    got = {name: values.reshape(expected[name].shape) for name, values in got.items()} | {"sh_coeffs": sh}
    assert_gradients_equal(got, expected)


def dog_numbers(splats: Splats) -> tuple[np.ndarray, np.ndarray]:
    """Logits of f_a and logs of F, of every other primitive."""
    model = dog_model()
    m = len(range(0, splats.n_splats, 2))
    return np.resize(model.dog_logit_opacities, m), np.full((m, 3), model.dog_log_scales[0, 0])


OPTIONS = {
    "plain": {},
    "random background": {"background": "random"},
    "appearance": {"appearance": True},
    "masks, images on disk": {"masks": "masks", "data_on_disk": True},
    "antialiased": {"antialiased": True},
}


def options_of(name: str, data: Path, alpha_data: Path, folder: Path) -> dict[str, Any]:
    """``OPTIONS`` as settings, with the data that fit them."""
    options = dict(OPTIONS[name])
    source = alpha_data if "background" in options else data
    if "masks" in options:
        options["masks"] = str(folder / "masks")
        (folder / "masks").mkdir()
        for path in (source / "images").iterdir():
            picture = np.zeros((HEIGHT, WIDTH), np.uint8)
            picture[:, WIDTH // 2 :] = 255
            Image.fromarray(picture).save(folder / "masks" / path.name)
    return {"data": source, **options}


@pytest.mark.parametrize("name", OPTIONS)
def test_a_batch_sees_what_as_many_steps_see(name, data, alpha_data, gradients, tmp_path):
    """Gradients, statistics of density control, training error: the same views, backgrounds and masks in their order.

    Parameters stand still; the numbers of appearance do not, and their step sizes fall with the steps: so slowly here
    that
    it does not show.
    """
    config = config_of(**options_of(name, data, alpha_data, tmp_path))
    dataset, views = load_dataset(config.data), 30_000 * K  # in all
    single, batch = (uneven(Trainer(replace(config, batch_views=k, steps=views // k), dataset)) for k in (1, K))
    for _ in range(K):
        single.step()
    batch.step()
    *singles, together = gradients
    assert batch.step_count == 1 and single.order == batch.order
    for parameter, values in together.items():
        expected = np.sum([of_view[parameter] for of_view in singles], axis=0, dtype=np.float64)
        np.testing.assert_allclose(values, expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max(), err_msg=parameter)
    means = batch.optimizer.params["means"]
    assert np.abs(together["means"]).max() > 0 and dr.width(means) == 3 * batch.optimizer.n
    for statistic in ("views", "gradient_sum", "max_radius"):
        of = [getattr(trainer.states["densification"], statistic).numpy() for trainer in (single, batch)]
        np.testing.assert_allclose(of[1], of[0], rtol=1e-5, err_msg=statistic)
    assert batch.states["densification"].views.numpy().max() == K
    one, other = single.losses.take(), batch.losses.take()
    assert other == pytest.approx(one, rel=1e-5)


def test_a_step_with_k_views_is_that_of_adam_in_float64_with_the_mean_and_the_scaled_numbers():
    rates = LearningRates(extent=2.0, total_steps=1000, batch_views=4)
    assert rates.at(300) == {name: 2 * rate for name, rate in replace(rates, batch_views=1).at(300).items()}
    optimizer, rng = SplatOptimizer(dog_model(), rates), np.random.default_rng(5)
    optimizer.learn("mine", np.zeros(optimizer.n), 0.01)
    value: dict[str, Any] = {name: optimizer.numpy(name).ravel().astype(np.float64) for name in optimizer.adam}
    m, v = ({name: np.zeros_like(x) for name, x in value.items()} for _ in range(2))
    beta_1, beta_2 = 0.9**4, 0.999**4
    for step in range(6):
        optimizer.schedule(100 * step)
        gradients = {name: rng.normal(size=x.size).astype(np.float32) for name, x in value.items()}
        for name, parameter in optimizer.adam.items():
            for part in (0.25, 0.75):  # of two views, say
                dr.set_grad(parameter, dr.grad(parameter) + dr.opaque(type(parameter), part) * gradients[name])
        optimizer.step()
        at = rates.at(100 * step) | {"mine": 0.02}
        for name, total in gradients.items():
            g = np.float64(total) / 4
            m[name] = beta_1 * m[name] + (1 - beta_1) * g
            v[name] = beta_2 * v[name] + (1 - beta_2) * g**2
            unbiased = m[name] / (1 - beta_1 ** (step + 1)), v[name] / (1 - beta_2 ** (step + 1))
            value[name] = value[name] - at[name] * unbiased[0] / np.sqrt(unbiased[1])
    for name in value:
        np.testing.assert_allclose(optimizer.numpy(name).ravel(), value[name], rtol=1e-5, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("views", [1, 16])
def test_a_gradient_of_the_size_of_epsilon_moves_as_much_in_a_batch(views):
    """With it for long enough a step is 1/√2 of a whole one; the mean of 16 independent ones is a quarter of one."""
    optimizer = SplatOptimizer(dog_model(), LearningRates(1.0, 1000, batch_views=views))
    gradient, before = EPSILON / math.sqrt(views), optimizer.numpy("log_scales")
    entry = Entry.of(optimizer.adam, "log_scales")
    m, v = (dr.full(type(entry.m), x, dr.width(entry.m)) for x in (gradient, gradient**2))
    replace(entry, t=type(entry.t)(1_000_000), m=m, v=v).put(optimizer.adam, "log_scales")
    dr.set_grad(optimizer.adam["log_scales"], views * gradient)
    optimizer.step()
    moved = before - optimizer.numpy("log_scales")
    np.testing.assert_allclose(moved, LearningRates.log_scales * math.sqrt(views / 2), rtol=1e-3)


@pytest.mark.parametrize("views, every, reset_every", [(1, 100, 700), (4, 25, 700), (400, 1, 700)])
def test_refinements_of_density_come_after_as_many_views(views, every, reset_every):
    rule = replace(Densification(), batch_views=views).scaled(7000 / 30_000)
    assert (rule.every, rule.reset_every) == (every, reset_every)


def test_opacities_have_as_many_steps_to_come_back_as_their_size_asks_for():
    assert [replace(Densification(), batch_views=k).scaled(0.01).reset_every for k in (1, 4, 25)] == [500, 250, 100]


RUNS: dict[str, tuple[str, Any]] = {
    "appearance": ("appearance", None),
    "random background": ("random background", None),
    "masks, images on disk": ("masks, images on disk", None),
    "masks that are learned": ("plain", mask_gaussian.RECIPE),
    "resolution that grows": ("plain", dash.RECIPE),
}


@pytest.mark.parametrize("name", RUNS)
def test_a_run_of_batches_stopped_and_resumed_has_the_bits_of_one_that_was_not(
    name, data, alpha_data, tmp_path, ordered
):
    option, recipe = RUNS[name]
    settings = options_of(option, data, alpha_data, tmp_path)
    usual = {"preset": "ours", "batch_views": K, "target": 30, "checkpoint_seconds": 0, "log_every": 7, "steps": 30}
    config = config_of(**usual, **settings)

    def stop(row: dict) -> None:
        if row["step"] > 20:
            raise KeyboardInterrupt

    run.train(config, tmp_path / "whole", recipe=recipe)
    with pytest.raises(KeyboardInterrupt):
        run.train(config, tmp_path / "parts", stop, recipe=recipe)
    stopped_at = load_checkpoint(tmp_path / "parts" / run.CHECKPOINT)["step"]
    assert 0 < stopped_at < config.steps
    run.train(config, tmp_path / "parts", resume=True, recipe=recipe)
    whole, parts = (load_checkpoint(tmp_path / folder / run.CHECKPOINT) for folder in ("whole", "parts"))
    assert whole.keys() == parts.keys()
    for values in whole.keys() - {"seconds"}:
        np.testing.assert_array_equal(whole[values], parts[values], err_msg=values)
    model = [(tmp_path / folder / "point_cloud.ply").read_bytes() for folder in ("whole", "parts")]
    assert model[0] == model[1]


def test_a_run_of_batches_repeats_itself_and_learns(data, ordered):
    rows = []
    for _ in range(2):
        trainer = Trainer(config_of(data, batch_views=K), load_dataset(data))
        rows.append([{k: v for k, v in row.items() if k != "seconds"} for row in run_to_end(trainer)])
    assert rows[0] == rows[1]
    l1 = [row["l1"] for row in rows[0] if "l1" in row]
    assert l1[-1] < 0.7 * l1[0]


@dataclass
class Calls:
    """State of ``Count``."""

    hooks: Any = None


@dataclass(frozen=True)
class Count(Strategy[Calls]):
    """Counts its hooks, and adds one to a gradient for every view."""

    def new_state(self, t: Training) -> Calls:
        return Calls([])

    def before_step(self, t: Training, state: Calls) -> None:
        state.hooks.append("before_step")

    def after_backward(self, t: Training, state: Calls, seen: Seen) -> None:
        state.hooks.append("last" if seen.last else "after_backward")
        logits = t.optimizer.params["logit_opacities"]
        dr.set_grad(logits, dr.grad(logits) + 1)

    def after_step(self, t: Training, state: Calls) -> list:
        state.hooks.append("after_step")
        return []


def test_what_a_strategy_adds_to_each_view_counts_once(data, gradients):
    dataset, recipe = load_dataset(data), replace(RECIPES["3dgs"], also=(Count(),))
    counted, plain = (Trainer(config_of(data, batch_views=K), dataset, r) for r in (recipe, RECIPES["3dgs"]))
    counted.step()
    plain.step()
    assert counted.states["count"].hooks == ["before_step", *["after_backward"] * (K - 1), "last", "after_step"]
    added = gradients[0]["logit_opacities"] - gradients[1]["logit_opacities"]
    np.testing.assert_allclose(added, K, rtol=1e-5)  # of which the optimizer takes a Kth


@pytest.mark.parametrize("strategy", [GaussianSpa(0, 60, every=2), NaturalSelection(0, 60, every=1, gentle=10)])
def test_what_a_strategy_does_once_a_step_it_does_once_a_batch(data, gradients, strategy):
    """Parameters stand still: steps of one view and of three leave the same behind."""
    dataset, left = load_dataset(data), []
    for views in (1, K):
        trainer = Trainer(config_of(data, batch_views=views, target=30), dataset, RECIPES["3dgs"])
        trainer.strategies, trainer.states = [strategy], {strategy.name: strategy.new_state(trainer)}
        for _ in range(4):
            trainer.step()
        learned = {name: trainer.optimizer.numpy(name) for name in sorted(trainer.optimizer.learned)}
        left.append(learned | arrays_of(trainer.states[strategy.name]))
    assert left[0].keys() == left[1].keys() and any(np.any(values != 0) for values in left[0].values())
    for name, values in left[0].items():
        np.testing.assert_array_equal(left[1][name], values, err_msg=name)


def test_a_batch_may_be_larger_than_the_data(data):
    trainer = Trainer(config_of(data, batch_views=20), load_dataset(data))
    trainer.step()
    assert trainer.losses.views == 20 and len(trainer.order) == 3 * len(trainer.photographs) - 20


def test_nothing_is_compiled_after_the_second_step_of_batches(data):
    trainer = Trainer(config_of(data, batch_views=K, steps=30_000), load_dataset(data))
    with KernelWatch() as kernels:
        for _ in range(3):
            trainer.step()
        kernels.forget()
        for _ in range(3):
            trainer.step()
    assert kernels.launched > 100 and not kernels.new


def test_a_batch_of_no_view_is_refused_in_one_line():
    with pytest.raises(DataError, match="--batch-views: 0 is out of range; use at least 1"):
        TrainConfig("photos", batch_views=0)
