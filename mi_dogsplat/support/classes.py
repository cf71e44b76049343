"""Arguments of a wrong class, which callers in Python may give."""

from __future__ import annotations


def require_class(what: str, value: object, wanted: type, remedy: str) -> None:
    """Raise ``ValueError``, which says ``what`` the value is and what to give instead, unless it is of a class."""
    if not isinstance(value, wanted):
        raise ValueError(f"{what} is of the class {type(value).__name__}, not {wanted.__name__}; {remedy}")
