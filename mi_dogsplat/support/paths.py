"""Arguments that are paths, in whose place callers in Python may give something else."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import ParamSpec, TypeVar

from .errors import DataError

P = ParamSpec("P")
R = TypeVar("R")
OF_PATHS = {"str", "Path", "None"}  # of which the annotation of a path consists


def require_path(what: str, value: object) -> None:
    """Raise ``DataError``, which says ``what`` the value is, unless it is a path."""
    if not isinstance(value, (str, os.PathLike)):
        raise DataError(what, f"{value!r:.80} is no path", "give a string or a Path")


def takes_paths(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which first of all says in a ``DataError`` which of its paths is none.

    Its paths are the arguments with the annotation ``Path`` or ``str | Path``, also with ``| None``. The annotations
    are taken as they are written, by ``from __future__ import annotations``: some cannot be evaluated without a variant
    of Mitsuba.
    """
    takes = signature(function)
    kinds = {name: set(str(argument.annotation).split(" | ")) for name, argument in takes.parameters.items()}
    paths = {name: kind for name, kind in kinds.items() if "Path" in kind and kind <= OF_PATHS}

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = takes.bind(*args, **kwargs).arguments
        except TypeError:
            given = {}  # Python says below what is missing or too much, with the name of the function
        for name, kind in paths.items():
            if name in given and not (given[name] is None and "None" in kind):
                require_path(f"{function.__name__}: {name}", given[name])
        return function(*args, **kwargs)

    return checked
