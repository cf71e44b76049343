"""Arguments of public functions, in whose place callers in Python may give something else: paths, and settings."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import ParamSpec, TypeVar

from .errors import DataError
from .settings import settings_of

P = ParamSpec("P")
R = TypeVar("R")
OF_PATHS = {"str", "Path", "None"}  # of which the annotation of a path consists


def require_path(what: str, value: object) -> None:
    """Raise ``DataError``, which says ``what`` the value is, unless it is a path."""
    if not isinstance(value, (str, os.PathLike)):
        raise DataError(what, f"is of the class {type(value).__name__}, not a path", "give a string or a Path")


def checks_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which first of all says in a ``DataError`` which of its paths, and of its settings, is none.

    Its paths are the arguments with the annotation ``Path`` or ``str | Path``, also with ``| None``. The annotations
    are taken as they are written, by ``from __future__ import annotations``: some cannot be evaluated without a variant
    of Mitsuba. Its settings are the arguments whose default is an object of a class of them.
    """
    takes = signature(function)
    kinds = {name: set(str(argument.annotation).split(" | ")) for name, argument in takes.parameters.items()}
    paths = {name: kind for name, kind in kinds.items() if "Path" in kind and kind <= OF_PATHS}
    defaults = {name: type(argument.default) for name, argument in takes.parameters.items()}
    classes = {name: kind for name, kind in defaults.items() if settings_of(kind)}

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = takes.bind(*args, **kwargs).arguments
        except TypeError:
            given = {}  # Python says below what is missing or too much, with the name of the function
        for name, value in given.items():
            what = f"{function.__name__}: {name}"
            if name in paths and not (value is None and "None" in paths[name]):
                require_path(what, value)
            if name in classes and not isinstance(value, classes[name]):
                wanted = classes[name].__name__
                problem = f"is of the class {type(value).__name__}, not {wanted}"
                raise DataError(what, problem, f"give {'an' if wanted[0] in 'AEIO' else 'a'} {wanted}")
        return function(*args, **kwargs)

    return checked
