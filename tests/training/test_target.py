"""Targets as people write them."""

import json
from dataclasses import asdict

import pytest
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.target import checked_target, target_bytes


@pytest.mark.parametrize(
    ("written", "target"),
    [(0.1, 0.1), ("0.1", 0.1), ("10%", 0.1), ("2.5 %", 0.025), ("99%", 0.99), (20_000, 20_000.0), ("20000", 20_000.0),
     ("2e4", 20_000.0), ("1", 1.0), ("2MB", "2MB"), ("1.5 MiB", "1.5MiB"), ("500kb", "500kb"), ("800B", "800B")],
)  # fmt: skip
def test_ratios_counts_and_sizes_are_told_apart_and_stay_what_they_are(written, target):
    assert checked_target(written) == target and type(checked_target(written)) is type(target)
    assert checked_target(checked_target(written)) == target


@pytest.mark.parametrize(
    ("written", "size"),
    [("2MB", 2_000_000), ("500kB", 500_000), ("2MiB", 2 * 2**20), ("1.5GB", 1_500_000_000), ("2KiB", 2048),
     ("800B", 800), ("2M", None), ("20000", None), ("10%", None), ("MB", None), (2.0, None)],
)  # fmt: skip
def test_sizes_are_in_bytes(written, size):
    assert target_bytes(written) == size


@pytest.mark.parametrize(
    "written", ["0", "-3", "2.5", "1.0", "100%", "0%", "many", "2M", "0MB", "-2MB", "", "nan", "1e999"]
)
def test_what_is_neither_is_refused_in_one_line(written):
    with pytest.raises(DataError, match=r"^--target: .*is not a target; use a ratio.*2MB") as caught:
        TrainConfig("photos", target=written)
    assert "\n" not in str(caught.value)


def test_a_configuration_with_a_size_is_written_and_read():
    config = TrainConfig("photos", target="2 MB", format="spz")
    assert config.target_bytes == 2_000_000
    assert TrainConfig(**json.loads(json.dumps(asdict(config)))) == config
    assert TrainConfig("photos", target="10%").target_bytes is None


def test_counts_are_refused_with_all_of_their_digits():
    with pytest.raises(DataError, match=r"1,234,567 primitives are not fewer than --max-primitives 1,000,000;"):
        TrainConfig("photos", target=1_234_567, max_primitives=1_000_000)
    with pytest.raises(DataError, match="--target: 1,234,567 needs pruning"):
        TrainConfig("photos", preset="3dgs", target=1_234_567).require_pruning()
