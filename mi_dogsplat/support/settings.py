"""Settings that are flags too: beside its type a field says what it is for, and which values it may have.

    steps: Annotated[int, Setting("training steps", least=1)] = 7000

The command line makes its flags and their help from this, so that no source line is read. tyro was tried for it: it
draws boxes where we have one line, wants four packages, and ``dogsplat --help`` takes a tenth of a second more.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import MISSING, dataclass
from functools import cache
from typing import Any, NoReturn, get_args, get_origin, get_type_hints

from .errors import DataError

WORDS = {bool: "True or False", int: "an integer", float: "a number", str: "a string"}
PLURALS = {int: "integers", float: "numbers", str: "strings"}


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
    """Raise ``DataError`` for the first field that is of another type than its own, out of its range or none of its
    choices. None is right where the type has it, or where it is the default, in place of which another is filled in.

    Numbers of NumPy, paths and lists become what JSON can hold, as files of runs do: numbers, strings and tuples.
    """
    for name, (hint, setting) in settings_of(type(config)).items():
        if getattr(config, name) is None and (type(None) in get_args(hint) or not is_said(config, name)):
            continue
        value, least, most = _typed(name, getattr(config, name), hint), setting.least, setting.most
        object.__setattr__(config, name, value)  # which may be frozen
        if setting.choices and value not in setting.choices:
            refuse(name, f'"{value}" is unknown', "use " + " or ".join(setting.choices))
        if not _in_range(value, setting):
            wanted = f"at least {least:g}" if most == math.inf else f"{least:g} to {most:g}"
            refuse(name, f"{value} is out of range", f"use {wanted}")


def _typed(name: str, given: Any, hint: Any) -> Any:
    """A value as one of the types that its field may have. Raises ``DataError``."""
    value = _of_python(given)
    value = os.fspath(value) if isinstance(value, os.PathLike) else value
    options = (hint,) if get_origin(hint) is tuple else get_args(hint) or (hint,)
    kinds = [kind for kind in options if kind is not type(None)]
    for kind in kinds:
        parts = get_args(kind)
        if parts and isinstance(value, (tuple, list)) and len(value) == len(parts):
            found = [_plain(_of_python(part), of) for part, of in zip(value, parts, strict=True)]
            if None not in found:
                return tuple(found)
        if not parts and (found := _plain(value, kind)) is not None:
            return found
    refuse(name, f"{given!r:.80} has the wrong type", "use " + " or ".join(map(_words, kinds)))


def _of_python(value: Any) -> Any:
    """A number of Python's, or a list, where it is one of NumPy's."""
    return value.tolist() if hasattr(value, "tolist") else value


def _plain(value: Any, kind: type) -> Any:
    """A value of this type, of a number the nearest thing to it; None if it is of another one."""
    if isinstance(value, bool) != (kind is bool):
        return None
    if kind is int and isinstance(value, float) and value.is_integer():
        return int(value)
    return value if isinstance(value, kind) or (kind is float and isinstance(value, int)) else None


def _words(kind: Any) -> str:
    parts = get_args(kind)
    return f"{len(parts)} {PLURALS[parts[0]]}" if parts else WORDS[kind]


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


def is_said(config: object, name: str) -> bool:
    """Whether a setting is another than its default, if it has one; what is usual may be said or not."""
    return getattr(config, name) != getattr(type(config), name, MISSING)


def _in_range(value: Any, setting: Setting) -> bool:
    if math.isinf(setting.least) and math.isinf(setting.most):
        return True
    return setting.least <= value <= setting.most  # NaN is in no range


def refuse(name: str, problem: str, remedy: str) -> NoReturn:
    """Raise the ``DataError`` for a setting, named as its flag."""
    raise DataError("--" + name.replace("_", "-"), problem, remedy)
