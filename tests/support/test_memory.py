"""What a training takes of memory: foreseen, refused where there is too little, and never outgrown."""

import json
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import tiny_data
from happenings import history_of, records
from mi_dogsplat import write_ply
from mi_dogsplat.cli import main
from mi_dogsplat.datasets import Dataset, View, load_dataset, view_images
from mi_dogsplat.datasets.dataset import no_points
from mi_dogsplat.engine.bands import LISTED, WALKED, BandedView
from mi_dogsplat.runs import run
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.row_groups import DOG, PLANES, SLOPES
from mi_dogsplat.support import control_groups
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.memory import available_memory, bytes_of, peak_memory_mb
from mi_dogsplat.training import memory_budget
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.events import MemoryFull
from mi_dogsplat.training.memory_budget import (
    FIRST_PAIRS,
    MARGIN,
    MOST_BANDS,
    PER_FLOAT,
    PER_PRIMITIVE,
    PER_PRODUCT,
    TARGET,
    Budget,
    budget,
)
from mi_dogsplat.training.optimizer.preconditioning import Preconditioning, n_products
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.cut_activation import CutRule
from mi_dogsplat.training.strategy.dog_control import DogRule
from mi_dogsplat.training.strategy.slope_activation import SlopeRule
from mi_dogsplat.training.train import Trainer
from small_optimizer import RATES, alike, random_model

ROOT = Path(__file__).parents[2]
JOINTLY = Preconditioning(0)


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "3dgs", "steps": 60, "sh_degree": 1, "log_every": 10}
    return TrainConfig(str(data), **(base | changes))


def enough_for(n: int, data: Path) -> str:
    """Memory that just holds ``n`` primitives of as many pairs as are foreseen."""
    known = budget("1G", load_dataset(data), 1)
    assert known
    return str(int((known.fixed + (n + 0.5) * known.each(FIRST_PAIRS)) / MARGIN))


@pytest.mark.parametrize(
    ("recipe", "rows", "entries"),
    [
        (RECIPES["3dgs"], 0, 0),
        (replace(RECIPES["3dgs"], slopes=SlopeRule()), 9, 0),
        (replace(RECIPES["3dgs"], curvatures=SlopeRule()), 6, 0),
        (replace(RECIPES["3dgs"], cuts=CutRule()), 3, 0),
        (replace(RECIPES["3dgs"], slopes=SlopeRule(), cuts=CutRule()), 12, 0),
        (replace(RECIPES["3dgs"], second_cuts=CutRule()), 3, 0),
        (replace(RECIPES["3dgs"], cuts=CutRule(), second_cuts=CutRule()), 6, 0),
        (replace(RECIPES["3dgs"], dog=DogRule()), 4, 0),
        (replace(RECIPES["3dgs"], preconditioning=JOINTLY), 0, 14 * 15 / 2),
        (replace(RECIPES["3dgs"], dog=DogRule(), slopes=SlopeRule(), preconditioning=JOINTLY), 13, 18 * 19 / 2),
        (replace(RECIPES["3dgs"], cuts=CutRule(), second_cuts=CutRule(), preconditioning=JOINTLY), 6, 20 * 21 / 2),
    ],
)
def test_rows_and_products_count_where_they_come_to_all_primitives_that_there_ever_are(data, recipe, rows, entries):
    trainer = Trainer(config_of(data, memory="1G"), load_dataset(data), recipe)
    expected = PER_FLOAT * (14 + 12 + rows) + PER_PRODUCT * entries + PER_PRIMITIVE
    assert trainer.memory and trainer.memory.each(0) == expected


@pytest.mark.parametrize(
    ("preset", "target", "cap", "left"),
    [
        ("ours_preconditioned", 0.1, None, 0.1),
        ("ours_preconditioned", 0.6, None, 0.6),
        ("ours_preconditioned", 600, 1000, 0.6),
        ("ours_preconditioned", 600, None, 0),
        ("ours_preconditioned", "2kB", None, 0),
        ("ours_second_cuts", 0.6, None, 0.6),
        ("ours_curvatures", 0.6, None, 0.6),
        ("ours", 0.95, None, 0.95),
    ],
)
def test_what_comes_after_the_pruning_counts_where_it_takes_more_than_what_has_gone(data, preset, target, cap, left):
    config = config_of(data, memory="1G", preset=preset, target=target, max_primitives=cap)
    known = Trainer(config, load_dataset(data)).memory
    before = PER_FLOAT * (14 + 12) + PER_PRIMITIVE
    later = {
        "ours": PER_FLOAT * 4,
        "ours_preconditioned": PER_FLOAT * 16 + PER_PRODUCT * 21 * 22 / 2,
        "ours_second_cuts": PER_FLOAT * 19 + PER_PRODUCT * 24 * 25 / 2,
        "ours_curvatures": PER_FLOAT * 25 + PER_PRODUCT * 24 * 25 / 2,
    }[preset]
    assert known and known.each(0) == pytest.approx(max(before, left * (before + later)))
    assert (known.each(0) > before) == (left > 0.5)


def test_entries_of_products_are_as_many_as_foreseen():
    optimizer = SplatOptimizer(
        random_model(3, 1, (0,), rows={"slope_index": (0,), "cut_index": (1,), "second_cut_index": (2,)}),
        replace(RATES, preconditioning=JOINTLY),
    )
    alike(optimizer, 0)
    (products,) = [values for name, values in optimizer.state().items() if name.startswith("products")]
    assert len(products) == n_products((DOG, SLOPES, *PLANES)) == n_products((DOG, *PLANES))


@pytest.mark.parametrize(("model", "rows"), [("sloped_truth", 9), ("dog_model", 4)])
def test_rows_of_a_model_count(data, tmp_path, model, rows):
    write_ply(tmp_path / "model.ply", getattr(tiny_data, model)())
    config = config_of(data, memory="1G", model=str(tmp_path / "model.ply"), preset="ours")
    trainer = Trainer(config, load_dataset(data))
    degree = trainer.optimizer.sh_degree
    assert trainer.memory and trainer.memory.floats == 14 + (3 * (degree + 1) ** 2 if degree else 0) + rows


@pytest.mark.parametrize(
    ("text", "expected"),
    [("4G", 4e9), ("512M", 512e6), ("1.5 GB", 1.5e9), ("2GiB", 2**31), ("16gib", 2**34), ("100", 100), ("3k", 3000)],
)
def test_amounts_are_understood_as_people_write_them(text, expected):
    assert bytes_of(text) == expected


@pytest.mark.parametrize("text", ["", "G", "-1G", "1e9", "4 apples", "1..2G", "nan", "5iB", "9" * 400])
def test_what_is_no_amount_is_one_line_that_names_the_flag(text):
    with pytest.raises(DataError, match="^--memory: .* is not an amount of memory; use a number with K, M, G or T"):
        TrainConfig("data", memory=text)


def test_the_least_of_machine_container_and_shell_counts(tmp_path, monkeypatch):
    def write(name: str, text: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    machine = psutil.virtual_memory()._replace(available=8_000_000 * 1024)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: machine)
    monkeypatch.setattr(control_groups, "OWN", write("cgroup", "4:memory:/box/job\n0::/job\n"))
    monkeypatch.setattr(control_groups, "ROOT", tmp_path / "v2")
    assert available_memory() == 8_000_000 * 1024
    write("v2/job/memory.max", "max\n")
    write("v2/job/memory.current", "5\n")
    assert available_memory() == 8_000_000 * 1024
    write("v2/memory/box/memory.limit_in_bytes", "6000000\n")  # of a group above ours
    write("v2/memory/box/memory.usage_in_bytes", "2000000\n")
    assert available_memory() == 4_000_000
    of_both = "cache 9\ninactive_file 0\ntotal_cache 9\ntotal_inactive_file 500000\n"  # of the group, and those below
    write("v2/memory/box/memory.stat", of_both)  # given back when asked for
    assert available_memory() == 4_500_000
    write("v2/job/memory.max", "3000000\n")
    assert available_memory() == 2_999_995


def test_a_limit_of_the_shell_counts():
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (used + (50 << 20), limits[1]))
    try:
        free = available_memory()
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
    assert free is not None and 0 < free <= 50 << 20


def test_the_peak_is_the_largest_resident_size_and_stays_when_memory_is_given_back():
    before = psutil.Process().memory_info().rss
    block = np.ones(200 << 20, np.uint8)
    resident = psutil.Process().memory_info().rss
    assert resident > before + (190 << 20)
    del block
    assert resident / 1e6 - 1 <= peak_memory_mb() <= psutil.virtual_memory().total / 1e6


def test_where_the_system_says_nothing_nothing_is_known(monkeypatch):
    def silent():
        raise FileNotFoundError("/proc/meminfo")

    monkeypatch.setattr(control_groups, "OWN", Path("nowhere"))
    monkeypatch.setattr(psutil, "virtual_memory", silent)
    assert available_memory() is None


def test_without_limits_of_its_own_a_process_can_have_what_the_machine_has(monkeypatch):
    """As on systems other than Linux: no control groups, no limit of the address space to ask for."""
    monkeypatch.setattr(control_groups, "OWN", Path("nowhere"))
    monkeypatch.delattr(psutil, "RLIMIT_AS")
    machine = psutil.virtual_memory()._replace(available=12345)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: machine)
    assert available_memory() == 12345


@pytest.mark.slow
@pytest.mark.parametrize(("n", "width", "height"), [(50_000, 400, 300), (150_000, 400, 300), (50_000, 1200, 900)])
def test_what_is_foreseen_is_what_it_takes(n, width, height):
    """The estimate against the largest resident size of a process that trains."""
    command = [sys.executable, "-m", "tests.helpers.peak_memory", str(n), str(width), str(height)]
    result = json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
    assert result["foreseen_mb"] == pytest.approx(result["peak_mb"], rel=0.2), result
    assert result["pairs"] > n / 2


@pytest.mark.slow
def test_a_view_in_bands_stays_within_the_memory():
    """A view that needs 950 MB otherwise (above)."""
    command = [sys.executable, "-m", "tests.helpers.peak_memory", "50000", "1200", "900", "900M"]
    result = json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
    assert result["in_bands"] and result["peak_mb"] < 900 < result["foreseen_mb"], result


@pytest.mark.usefixtures("ordered")
def test_a_training_has_the_same_bits_in_whatever_memory(data, monkeypatch):
    """In bands, and with targets that are made when they are due."""

    def trained() -> tuple[Trainer, dict]:
        trainer = Trainer(config_of(data, steps=20, preset="ours"), load_dataset(data))
        for _ in range(20):
            trainer.step()
        return trainer, {name: trainer.optimizer.numpy(name) for name in trainer.optimizer.adam}

    ample, expected = trained()
    assert ample.photographs.keep_targets
    monkeypatch.setattr(Budget, "for_pairs", lambda self, n: 0.0)
    monkeypatch.setattr(memory_budget, "TARGETS_SHARE", 0)
    tight, values = trained()
    assert isinstance(tight.render(tight.optimizer.params, 0)[1].view, BandedView)
    assert not tight.photographs.keep_targets
    assert expected.keys() == values.keys()
    for name in expected:
        np.testing.assert_array_equal(values[name], expected[name], err_msg=name)


def test_targets_are_kept_where_they_are_a_small_part_of_the_memory(data):
    dataset = load_dataset(data)
    ample, tight = budget("1G", dataset, 1), budget("1M", dataset, 1)
    assert ample and tight and ample.keep_targets and not tight.keep_targets
    pixels = sum(view.camera.width * view.camera.height for view in dataset.train)
    largest = max(view.camera.width * view.camera.height for view in dataset.train)
    images = sum(view.n_bytes for view in dataset.train)
    assert ample.fixed - tight.fixed == pytest.approx(TARGET * (pixels - largest) - images)


def test_views_with_more_rows_of_tiles_may_be_walked_in_more_bands():
    def pair(height: int) -> float:
        camera = Camera(np.eye(4), 8.0, 8.0, 4.0, height / 2, 8, height)
        view = View("view", camera, np.zeros((height, 8, 3), np.float32))
        known = budget("1G", Dataset(Path(), [view], [], *no_points(), has_alpha=False), 1)
        assert known
        return known.pair

    assert pair(8) == LISTED + WALKED and pair(2000) == LISTED + WALKED / MOST_BANDS


def test_what_pairs_do_not_need_is_room_for_primitives():
    whole, cut = (Budget(1e9, base=2e8, pictures=0, floats=62, pair=pair) for pair in (140, 40))
    assert cut.most_primitives(100) > 2 * whole.most_primitives(100)


def test_a_training_that_cannot_even_start_is_one_line(capsys, data, tmp_path):
    command = ["train", str(data), "-o", str(tmp_path / "run"), "--memory", "150M", "--variant", "llvm_ad_rgb"]
    assert main(command) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and "primitives needs about" in line and "--downscale" in line and "150 MB" in line
    assert not (tmp_path / "run").exists()


def test_a_pruning_that_cannot_start_names_no_flags_of_training_alone(capsys, data, tmp_path):
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    command = ["prune", str(tmp_path / "model.ply"), str(data), "-o", str(tmp_path / "run"), "--memory", "150M"]
    assert main([*command, "--variant", "llvm_ad_rgb"]) == 2
    line = capsys.readouterr().err
    assert line.endswith("; use a larger --downscale, a smaller model, or a larger --memory\n")


def test_primitives_grow_until_the_memory_is_full_and_the_history_says_so(data, tmp_path):
    most = 75
    config = config_of(data, memory=enough_for(most, data))
    unbounded = Trainer(config_of(data), load_dataset(data))
    while unbounded.step_count < config.steps:
        unbounded.step()
    assert unbounded.optimizer.n > 2 * most
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Budget, "most_primitives", lambda self, pairs: most)  # whatever pairs the views have
        run.train(config, tmp_path)
    rows = history_of(tmp_path)
    assert max(row["n"] for row in rows) == most
    assert {record["most"] for record in records(rows, "memory_full")} == {most}


def test_the_cap_falls_as_primitives_touch_more_tiles_and_removes_none():
    known = Budget(1e9, base=2e8, pictures=0, floats=62, pair=140)
    caps = []
    for pairs in (10_000, 100_000, 1_000_000):
        known.pairs = pairs
        caps.append(known.bounded(None, 10_000)[0])
        assert known.pairs == 0
    assert caps[0] > caps[1] > caps[2] > 10_000
    known.pairs = 10**9
    assert known.bounded(None, 10_000) == (10_000, MemoryFull(10_000, "1 GB"))
    assert known.bounded(500, 10_000) == (500, None)


def test_images_that_do_not_fit_are_refused_before_they_are_read(data, tmp_path, monkeypatch):
    monkeypatch.setattr(view_images, "usable_cores", lambda: 2)  # as many are decoded at a time, which takes memory too
    monkeypatch.setattr(view_images, "available_memory", lambda: 150_000)
    with pytest.raises(DataError, match=r"8 images would take .* and 150 kB are free; shrink them: --downscale 2"):
        load_dataset(data)
    (tmp_path / "images").symlink_to(data / "images")
    content = json.loads((data / "transforms.json").read_text())
    (tmp_path / "transforms.json").write_text(json.dumps(content | {"frames": content["frames"][:1]}))
    monkeypatch.setattr(view_images, "available_memory", lambda: 20_000)
    with pytest.raises(DataError, match="1 image would take"):
        load_dataset(tmp_path)
    monkeypatch.setattr(view_images, "available_memory", lambda: 250_000)
    assert len(load_dataset(data).views) == 8


def test_the_memory_is_no_setting_that_a_resumed_run_must_keep(data, tmp_path):
    run.train(config_of(data, steps=4), tmp_path)
    run.train(config_of(data, steps=4, memory="9G", checkpoint_seconds=5), tmp_path, resume=True)
    assert np.isfinite(json.loads((tmp_path / "metrics.json").read_text())["test"]["psnr"])
