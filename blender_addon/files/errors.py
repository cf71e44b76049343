"""The one exception for bad input: it names the file, what is wrong and what to do, on one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_rpt as rpt_


class FileError(ValueError):
    """``str(e)`` is one line: ``<path>: <problem>; <remedy>``. Operators show it as it is.

    Both are in the language of Blender's interface; ``problem`` is a template where there are ``values``.
    """

    def __init__(self, path: str | Path, problem: str, remedy: str, **values: Any):
        super().__init__(readable(" ".join(f"{path}: {told(problem, **values)}; {rpt_(remedy)}".split())))


def told(text: str, **values: Any) -> str:
    """A message in the language of Blender's interface, values put in; errors among these are translated too."""
    if not values:
        return rpt_(text)
    return rpt_(text).format(**{key: _part(value) for key, value in values.items()})


def readable(text: str | Path) -> str:
    """As Blender's names and messages can have it: names of files may be bytes that no text has in UTF-8."""
    return str(text).encode("utf-8", "replace").decode("utf-8")


def type_name(data: Any) -> str:
    """What Blender's interface calls the type of an object, a camera or the like."""
    types = data.bl_rna.properties["type"]
    return iface_(types.enum_items[data.type].name, types.translation_context)


def _part(value: Any) -> Any:
    return rpt_(str(value)) if isinstance(value, Exception) else value
