"""What is wrong with a scene, as Mitsuba tells it or a plugin of ours: one line, without what is wrapped around it."""

from __future__ import annotations

import re
from pathlib import Path

from .errors import DataError, gist

PLUGINS = ("dog", "dogsplat", "dogpath")  # their messages begin with their names
_SOURCE = re.compile(r"\[\w+\.\w+:\d+\] ")  # where in Mitsuba
_PLACE = re.compile(
    r"(?:At|(?:Error w|W)hile loading) "
    r'(?:dictionary node "(?P<node>[^"]*)"|(?P<file>.+?) \(line (?P<line>\d+), col \d+\)): '
    r"(?:while processing <include>: )?"
)
_NO_XML = re.compile(r'Parsing of XML file "(?P<file>.+?)" failed: (?P<said>.+) \(line (?P<line>\d+), col \d+\)$')
_UNDEFINED = re.compile(r"undefined parameter: \$(?P<name>\w+)")
_PLUGIN = re.compile(r'failed to instantiate \w+ plugin of type "(?P<type>[^"]+)":\s+(?:\w+: )?')


def as_mitsuba_reads(path: Path) -> str:
    """The path of a scene as text. Raises ``DataError`` for one that is not UTF-8, which Mitsuba cannot be told."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise DataError(path, "its path is not UTF-8, which Mitsuba needs", "rename it") from None
    return str(path)


def located(path: Path, told: str) -> tuple[Path, str, str]:
    """(file, place, what is wrong) of what Mitsuba tells of a scene: place is ``line 3: ``, ``"node": `` or empty.

    Of a file that others include it is the file that is named.
    """
    said, place = _SOURCE.sub("", told, count=1), ""
    while found := _PLACE.match(said):
        said = _SOURCE.sub("", said[found.end() :], count=1)
        if found["file"]:
            path, place = Path(found["file"]), f"line {found['line']}: "
        elif found["node"] != "root":
            place = f'"{found["node"]}": '
    if found := _NO_XML.match(said):
        path, place, said = Path(found["file"]), f"line {found['line']}: ", found["said"]
    return path, place, said


def scene_error(path: Path, error: BaseException, problem: str, remedy: str = "correct the scene") -> DataError:
    """What an exception says about the scene of a file, with the line that it is about where that is known.

    A plugin of ours says by itself what is wrong and what to do; what Mitsuba says follows ``problem`` in parentheses,
    and the remedy that.
    """
    path, place, said = located(path, gist(error))
    if (found := _PLUGIN.match(said)) and found["type"] in PLUGINS:
        said = said[found.end() :]
    if said.startswith(tuple(f"{name}: " for name in PLUGINS)):
        said = re.sub(rf"^\w+: {re.escape(str(path))}: ", "", said)  # a model alone is named once
        return DataError(path, place + said, None)
    if found := _UNDEFINED.match(said):
        by_default = f'<default name="{found["name"]}" value="…"/>'
        remedy = f"give it a value by {by_default}, or by the flag -D of dogsplat render or film"
    return DataError(path, f"{place}{problem} ({said})", remedy)
