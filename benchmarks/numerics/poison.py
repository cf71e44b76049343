"""A training run that is poisoned, beside the same run that is not: it recovers, and nothing spreads.

The data set is made here, by the engine, of a known model. In each phase of the recipe (densification, pruning, DoG)
one primitive per entry of ``POISONS`` joins the model: an ordinary one, of a size and a colour that hurt, but for the
values that the entry names. After every step an image and all numbers of the model are looked at.

``python -m benchmarks poison [--steps N] [--preset NAME]``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from mi_dogsplat.datasets import Dataset, View
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.events import Dropped, Event
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.strategy import Strategy, Training
from mi_dogsplat.training.train import Trainer

from ..training.blobs import blobs

STEPS = 400
WIDTH, HEIGHT = 48, 36
N_TRUTH = 60
TARGET = 40
CAP = 150
DISTANCE = 3.0  # of the cameras from the origin


@dataclass(frozen=True)
class Poison:
    """Values of one primitive, by parameter of the optimizer."""

    name: str
    values: dict[str, Any]

    @property
    def finite(self) -> bool:
        return all(np.isfinite(value).all() for value in self.values.values())


NAMES = ("means", "log_scales", "quats", "logit_opacities", "sh_dc", "sh_rest", "dog_logit_opacities", "dog_log_scales")
POISONS = [
    *(Poison(f"{name} {value:g}", {name: value}) for name in NAMES for value in (np.nan, np.inf, -np.inf)),
    Poison("scale 1e-12", {"log_scales": np.log(1e-12)}),
    Poison("scale 1e6", {"log_scales": np.log(1e6)}),
    Poison("opaque, scale 1e6", {"log_scales": np.log(1e6), "logit_opacities": 10.0}),
    Poison("quaternion 0", {"quats": 0.0}),
    Poison("quaternion 1e30", {"quats": 1e30}),
    Poison("logit 1e4", {"logit_opacities": 1e4}),
    Poison("logit -1e4", {"logit_opacities": -1e4}),
    Poison("SH 1e8", {"sh_dc": 1e8}),
    Poison("SH -1e8", {"sh_dc": -1e8}),
    Poison("SH 1e8, view-dependent", {"sh_rest": 1e8}),
    Poison("1e6 away", {"means": 1e6}),
    Poison("on a camera", {"means": (DISTANCE, 0.0, 0.9)}),
    Poison("DoG with F = 1, f_a = 1", {"dog_log_scales": 0.0, "dog_logit_opacities": 1e4}),
]


def data_set(n_train: int = 16, n_test: int = 4) -> Dataset:
    """Views of ``blobs()`` from a ring of cameras around it, and its centres, perturbed, as points."""
    splats, rng = blobs(N_TRUTH), np.random.default_rng(1)
    params, views = upload(splats), []
    n = n_train + n_test
    for i, angle in enumerate(np.linspace(0, 2 * np.pi, n, endpoint=False)):
        position = DISTANCE * np.array([np.cos(angle), np.sin(angle), 0.3 * (-1) ** i])
        camera = Camera(look_at(position, np.zeros(3), "z"), 53.0, 53.0, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
        views.append(View(str(i), camera, render_picture(params, camera, RasterOptions(sh_degree=1)).color))
    points = (splats.means + rng.normal(size=(N_TRUTH, 3)) * 0.05).astype(np.float32)
    colors = np.clip(0.5 + C0 * splats.sh_coeffs[:, 0], 0, 1)
    test = views[2 :: n // n_test]
    return Dataset(Path("poison"), [v for v in views if v not in test], test, points, colors, has_alpha=False)


def config_of(steps: int, preset: str) -> TrainConfig:
    """Settings of both runs."""
    return TrainConfig(
        "poison", preset, steps=steps, target=TARGET, max_primitives=CAP, sh_degree=1, log_every=10,
        test_every=max(1, steps // 20),
    )  # fmt: skip


@dataclass
class Harm:
    """State of ``Poisoning``: counts of what is not finite."""

    not_finite_rows: int = 0
    spread: int = 0
    bad_images: int = 0
    bad_losses: int = 0
    bad_moments: int = 0


@dataclass(frozen=True)
class Poisoning(Strategy[Harm]):
    """Gives ``POISONS`` to the model after some steps, and counts what is not finite; the last strategy of a run."""

    steps: tuple[int, ...]

    def new_state(self, t: Training) -> Harm:
        return Harm()

    def before_step(self, t: Training, state: Harm) -> None:
        if t.step_count in self.steps:
            inject(t)
            state.not_finite_rows += sum(not poison.finite for poison in POISONS)

    def after_step(self, t: Training, state: Harm) -> list[Event]:
        look(t, state)
        return []


def inject(t: Training) -> None:
    """Add ``POISONS`` as rows without moments, copies of an ordinary row but for their values."""
    optimizer, n, k = t.optimizer, t.optimizer.n, len(POISONS)
    before, rows = optimizer.to_splats(), np.arange(n, n + k)
    index = np.concatenate([np.arange(n), np.zeros(k, int)])
    optimizer.rearrange(index, np.arange(n + k) >= n)
    ordinary = {
        "means": np.random.default_rng(2).uniform(-0.4, 0.4, (k, 3)),
        "log_scales": np.log(0.15), "quats": (0.0, 0.0, 0.0, 1.0), "logit_opacities": 1.5,
        "sh_dc": np.array((0.9, -0.4, 0.9)) / C0 / 2, "sh_rest": 0.0,
    }  # fmt: skip
    for name, value in ordinary.items():
        optimizer.assign(name, value, rows)
    is_dog = np.array([any(name.startswith("dog") for name in poison.values) for poison in POISONS])
    m, some = before.n_dog, int(is_dog.sum())
    logits = np.concatenate([before.dog_logit_opacities, np.zeros(some)])
    log_scales = np.concatenate([before.dog_log_scales, np.full((some, 3), np.log(1.6))])
    optimizer.set_dog(np.concatenate([before.dog_index, rows[is_dog]]), logits, log_scales)
    dog_row = m + np.cumsum(is_dog) - 1
    for i, poison in enumerate(POISONS):
        for name, value in poison.values.items():
            optimizer.assign(name, value, dog_row[i : i + 1] if name.startswith("dog") else rows[i : i + 1])


def look(t: Training, harm: Harm) -> None:
    """Count what is not finite after a step."""
    optimizer, state = t.optimizer, t.optimizer.state()
    bad = np.zeros(optimizer.n, bool)
    for name in optimizer.adam:
        values = state[name].reshape(-1, optimizer.row_size[name])
        bad[optimizer.dog_index if name.startswith("dog") else slice(None)] |= ~np.isfinite(values).all(1)
        harm.bad_moments += sum(int(np.sum(~np.isfinite(state[f"{name}.{moment}"]))) for moment in "mv")
    harm.spread += max(0, int(bad.sum()) - harm.not_finite_rows)
    harm.not_finite_rows = int(bad.sum())
    params = {name: dr.detach(value) for name, value in optimizer.params.items()}
    planes, frame = t.render(params, t.step_count % len(t.photographs))
    harm.bad_images += not all(np.isfinite(plane.numpy()).all() for plane in [*planes, frame.T])
    harm.bad_losses += not np.isfinite(float(t.losses.loss_sum[0]))


def poisoned(config: TrainConfig, dataset: Dataset, steps: list[int]) -> tuple[Trainer, Harm]:
    """A run that is given ``POISONS`` after some steps, and what that does to it."""
    poisoning = Poisoning(tuple(steps))
    trainer = Trainer(config, dataset)
    trainer.strategies.append(poisoning)
    trainer.states[poisoning.name] = harm = poisoning.new_state(trainer)
    return trainer, harm


def run(
    steps: int = STEPS, preset: str = "ours", progress: Callable[[str], None] = lambda line: None
) -> dict[str, Any]:
    """Train twice. For JSON; the same every time.

    Returns ``phases``: the steps after which ``POISONS`` were given; ``clean`` and ``poisoned``: [[step, test PSNR]];
    ``events``: [[step, event]] of those that dropped some; counts of primitives ``injected`` and ``dropped``, and of
    what is not finite in the poisoned run: ``spread`` (rows that became so by themselves), ``bad_images``,
    ``bad_losses``, ``bad_moments``; ``psnr_clean`` and ``psnr_poisoned`` in the end.
    """
    dataset = data_set()
    config = config_of(steps, preset)
    recipe = RECIPES[preset].scaled(steps)
    assert recipe.pruning and recipe.dog
    phases = {
        "densification": recipe.densification.stop // 2,
        "pruning": recipe.pruning.start + recipe.pruning.check_every // 2,
        "DoG": recipe.dog.start + steps // 20,
    }
    result: dict[str, Any] = {"phases": phases, "injected": len(POISONS) * len(phases)}
    clean = Trainer(config, dataset)
    trainer, harm = poisoned(config, dataset, list(phases.values()))
    for name, run_of in {"clean": clean, "poisoned": trainer}.items():
        progress(f"training, {name}")
        rows = list(run_to_end(run_of))
        result[name] = [[row["step"], row["test_psnr"]] for row in rows if "test_psnr" in row]
        dropped = [(row, event) for row in rows for event in row.get("events", ()) if event["kind"] == Dropped.kind]
        result["events"] = [[row["step"], row["event"]] for row, _ in dropped]
        result["dropped"] = sum(event["count"] for _, event in dropped)
    counts = {name: count for name, count in asdict(harm).items() if name != "not_finite_rows"}
    return result | counts | {"psnr_clean": result["clean"][-1][1], "psnr_poisoned": result["poisoned"][-1][1]}


def main(flags: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks poison", description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS, help=f"of each training (default: {STEPS})")
    parser.add_argument("--preset", default="ours", help="a recipe that prunes and has DoG (default: ours)")
    args = parser.parse_args(flags)
    set_variant("llvm_ad_rgb")
    result = run(args.steps, args.preset, print)
    for step, event in result["events"]:
        print(f"step {step}: {event}")
    print("test PSNR by step, clean and poisoned:")
    for (step, clean), (_, poisoned) in zip(result["clean"], result["poisoned"], strict=True):
        after = [name for name, at in result["phases"].items() if at < step]
        print(f"{step:6d} {clean:6.2f} {poisoned:6.2f} dB{'  after ' + after[-1] if after else ''}")
    print(", ".join(f"{name} {value}" for name, value in result.items() if isinstance(value, int)))
