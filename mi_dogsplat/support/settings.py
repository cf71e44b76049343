"""Settings that are flags too: beside its type a field says what it is for, and which values it may have.

    steps: Annotated[int, Setting("training steps", least=1)] = 7000

The command line makes its flags and their help from this, so that no source line is read. tyro was tried for it: it
draws boxes where we have one line, wants four packages, and ``dogsplat --help`` takes a tenth of a second more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NoReturn, get_args, get_type_hints

from .errors import DataError


@dataclass(frozen=True)
class Setting:
    """What there is to say about a field of a settings class."""

    help: str
    metavar: str = ""  # what stands for the value in the help, a word for each; empty: as its type has it
    least: float = -math.inf
    most: float = math.inf
    choices: tuple[str, ...] = ()


@cache
def settings_of(kind: type) -> dict[str, tuple[Any, Setting]]:
    """Type and ``Setting`` of each field that has one, in their order."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: (h.__origin__, h.__metadata__[0]) for name, h in hints.items() if hasattr(h, "__metadata__")}


def check_settings(config: object) -> None:
    """Raise ``DataError`` for the first field that is out of its range or none of its choices; None is always right."""
    for name, (_, setting) in settings_of(type(config)).items():
        value, least, most = getattr(config, name), setting.least, setting.most
        if value is None:
            continue
        if setting.choices and value not in setting.choices:
            refuse(name, f'"{value}" is unknown', "use " + " or ".join(setting.choices))
        if not _in_range(value, setting):
            wanted = f"at least {least:g}" if most == math.inf else f"{least:g} to {most:g}"
            refuse(name, f"{value} is out of range", f"use {wanted}")


def unfit(kind: type, values: Mapping[str, Any]) -> str:
    """Name of the first of ``values``, as JSON holds them, that is of another type than the field of the settings class
    ``kind`` or out of its range; empty if there is none. Choices are not looked at."""
    for name, value in values.items():
        hint, setting = settings_of(kind)[name]
        types = get_args(hint) or (hint,)
        fits = isinstance(value, types) or (type(value) is int and float in types)
        if not fits or (isinstance(value, bool) and bool not in types):
            return name
        if value is not None and not _in_range(value, setting):
            return name
    return ""


def _in_range(value: Any, setting: Setting) -> bool:
    if math.isinf(setting.least) and math.isinf(setting.most):
        return True
    return setting.least <= value <= setting.most  # NaN is in no range


def refuse(name: str, problem: str, remedy: str) -> NoReturn:
    """Raise the ``DataError`` for a setting, named as its flag."""
    raise DataError("--" + name.replace("_", "-"), problem, remedy)
