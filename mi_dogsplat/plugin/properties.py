"""Parameters of a plugin, of the type that they are meant to have."""

from __future__ import annotations

from typing import Any

WORDS = {bool: "true or false", int: "an integer", float: "a number", str: "a string"}


def given(props: Any, name: str, kind: type, default: Any = None) -> Any:
    """The parameter ``name``, or the default. Raises ``RuntimeError`` where it is not of ``kind``, as C++ plugins do.

    An integer is a number too, but a string such as ``"false"`` is no boolean.
    """
    if name not in props:
        return default
    value = props[name]
    if not (type(value) is kind or (kind is float and type(value) is int)):
        raise RuntimeError(f'{props.plugin_name()}: "{name}" is {value!r}, it must be {WORDS[kind]}')
    return value
