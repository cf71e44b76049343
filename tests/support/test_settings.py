"""Settings that are flags too: what is said about a field, and which values are refused."""

import json
import re
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.settings import Setting, check_settings, settings_of, unfit
from mi_dogsplat.training.config import TrainConfig


@dataclass(frozen=True)
class Some:
    many: Annotated[int | None, Setting("how many", least=2)] = None
    share: Annotated[float, Setting("of all", "X", least=0, most=1)] = 0.5
    far_away: Annotated[str, Setting("which", choices=("a", "b"))] = "a"
    size: Annotated[tuple[int, int] | None, Setting("of pictures")] = None
    target: Annotated[str | float, Setting("what is left")] = "10%"
    small: Annotated[bool, Setting("whether")] = False
    plain: int = 0

    def __post_init__(self) -> None:
        check_settings(self)


def test_fields_say_their_type_and_what_they_are_for_in_order():
    found = settings_of(Some)
    assert list(found) == ["many", "share", "far_away", "size", "target", "small"]
    assert found["many"] == (int | None, Setting("how many", least=2)) and found["share"][1].metavar == "X"


@pytest.mark.parametrize("kind", [TrainConfig, CaptureConfig, PictureOptions])
def test_every_field_of_a_configuration_says_what_it_is_for(kind):
    found = settings_of(kind)
    assert list(found) == [field.name for field in fields(kind)]
    assert all(setting.help for _, setting in found.values())


def test_values_within_their_bounds_are_taken_and_so_is_none_where_a_type_has_it():
    for some in (Some(), Some(many=None, size=None), Some(many=2), Some(share=1.0, far_away="b", plain=-9)):
        check_settings(some)
    assert TrainConfig("photos", steps=None) == TrainConfig("photos")  # pyright: ignore[reportArgumentType]


def test_a_setting_without_default_cannot_be_none():
    with pytest.raises(DataError, match="^--data: None has the wrong type; use a string$"):
        TrainConfig(None)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"many": 1}, "--many: 1 is out of range; use at least 2"),
        ({"share": 1.5}, "--share: 1.5 is out of range; use 0 to 1"),
        ({"share": float("nan")}, "--share: nan is out of range; use 0 to 1"),
        ({"far_away": "c"}, '--far-away: "c" is unknown; use a or b'),
        ({"many": 2.5}, "--many: 2.5 has the wrong type; use an integer"),
        ({"many": "3"}, "--many: '3' has the wrong type; use an integer"),
        ({"many": True}, "--many: True has the wrong type; use an integer"),
        ({"size": (24, 18.5)}, "--size: (24, 18.5) has the wrong type; use 2 integers"),
        ({"size": 24}, "--size: 24 has the wrong type; use 2 integers"),
        ({"target": [5]}, "--target: [5] has the wrong type; use a string or a number"),
        ({"small": "false"}, "--small: 'false' has the wrong type; use True or False"),
        ({"share": None}, "--share: None has the wrong type; use a number"),
        ({"target": None}, "--target: None has the wrong type; use a string or a number"),
        ({"far_away": None}, "--far-away: None has the wrong type; use a string"),
        ({"small": None}, "--small: None has the wrong type; use True or False"),
    ],
)
def test_other_values_are_one_line_that_names_the_flag(given, line):
    with pytest.raises(DataError, match=f"^{re.escape(line)}$"):
        Some(**given)


def test_numbers_of_numpy_paths_and_lists_become_what_a_file_of_a_run_can_hold():
    numbers: dict[str, Any] = {"many": np.int64(3), "share": np.float32(0.5), "target": np.int32(5), "small": np.True_}
    others: dict[str, Any] = {"far_away": Path("a"), "size": [4.0, 3]}
    some = Some(**numbers, **others)
    assert some == Some(many=3, share=0.5, far_away="a", size=(4, 3), target=5, small=True)
    assert json.loads(json.dumps(asdict(some)))["size"] == [4, 3]
    for size in (np.array([4, 3]), [np.int64(4), np.float32(3)]):
        arrays: dict[str, Any] = {"size": size}
        assert json.dumps(Some(**arrays).size) == "[4, 3]"


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({}, ""),
        ({"many": None, "share": 1, "far_away": "of a later version"}, ""),
        ({"share": None}, "share"),
        ({"share": True}, "share"),
        ({"share": 2}, "share"),
        ({"share": float("nan")}, "share"),
        ({"many": 2.0}, "many"),
        ({"many": 3, "far_away": ["a"], "share": "x"}, "far_away"),
    ],
)
def test_the_first_value_that_a_field_cannot_have_is_named(values, name):
    assert unfit(Some, values) == name
