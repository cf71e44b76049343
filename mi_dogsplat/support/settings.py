"""Settings that are flags too: beside its type a field says what it is for, and which values it may have.

    steps: Annotated[int, Setting("training steps", least=1)] = 7000

The command line makes its flags and their help from this, so that no source line is read. tyro was tried for it: it
draws boxes where we have one line, wants four packages, and ``dogsplat --help`` takes a tenth of a second more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, NoReturn, get_type_hints

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
        if (math.isfinite(least) or math.isfinite(most)) and not least <= value <= most:  # NaN is in no range
            wanted = f"at least {least:g}" if most == math.inf else f"{least:g} to {most:g}"
            refuse(name, f"{value} is out of range", f"use {wanted}")


def refuse(name: str, problem: str, remedy: str) -> NoReturn:
    """Raise the ``DataError`` for a setting, named as its flag."""
    raise DataError("--" + name.replace("_", "-"), problem, remedy)
