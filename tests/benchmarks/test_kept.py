"""What an experiment keeps in a folder is not told as that of other settings, or of another capture."""

from argparse import Namespace
from pathlib import Path

import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig

from benchmarks.training import activation, hdr, rate_distortion, second_order
from benchmarks.training.kept import same_settings


def test_a_folder_is_of_one_capture_and_of_the_same_settings(tmp_path):
    args, out = Namespace(data=str(tmp_path / "fern"), steps=40, sizes=["1MB"]), tmp_path / "out"
    for sizes in (["1MB"], ["2MB"]):
        args.sizes = sizes  # what the settings do not name may change
        same_settings(out, args, "data", ["steps"])
    for name, value in {"steps": 80, "data": str(tmp_path / "fox")}.items():
        with pytest.raises(DataError, match=f"{name} was .* and is .* now"):
            same_settings(out, Namespace(**vars(args) | {name: value}), "data", ["steps"])


def test_a_folder_that_says_nothing_of_its_contents_is_refused(tmp_path):
    (tmp_path / "state.npz").touch()
    with pytest.raises(DataError, match="other contents"):
        same_settings(tmp_path, Namespace(data="fern"), "data", [])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("main", "flags", "changed"),
    [
        (second_order.main, ["DATA", "--steps", "2", "--start", "1", "--views", "1", "--seconds", "0"], "--start"),
        (rate_distortion.main, ["DATA", "--steps", "20", "--counts", "--sizes"], "--steps"),
        (hdr.main, ["--steps", "20", "--runs", "sRGB, log"], "--steps"),
    ],
)
def test_other_settings_in_the_same_folder_are_refused(main, flags, changed, data, tmp_path):
    """The second call would find what the first one has made."""
    flags = [str(data) if flag == "DATA" else flag for flag in flags] + ["--out", str(tmp_path / "out")]
    if main is hdr.main:
        flags += ["--views", "4", "--size", "16", "12", "--spp", "1"]
    main(flags)
    at = flags.index(changed) + 1
    with pytest.raises(DataError, match=f"{changed[2:]} was {flags[at]} and is {int(flags[at]) + 1} now"):
        main([*flags[:at], str(int(flags[at]) + 1), *flags[at + 1 :]])


def test_the_states_of_captures_with_one_name_are_apart(data, tmp_path, monkeypatch):
    monkeypatch.setattr(activation, "_activation", lambda config: 1)
    dataset, out = load_dataset(data), tmp_path / "out"
    for parent in ("one", "other"):
        (tmp_path / parent).mkdir()
        place = Path(tmp_path / parent / "scene")
        place.symlink_to(data) if parent == "one" else place.mkdir()
        config = TrainConfig(str(place), "ours", 20, max_primitives=100)
        activation.pruned_state(config, dataset, out)
    assert len(list(out.glob("*.npz"))) == 2
