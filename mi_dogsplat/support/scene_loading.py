"""Scenes from files and dictionaries as ``mi.load_file`` and ``mi.load_dict`` make them, without what would end the
process (``scene_limits.py``)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from .scene_errors import as_mitsuba_reads
from .scene_limits import require_limits
from .threads import threads_to_load


def load_file(path: Path, defined: Mapping[str, str] | None = None) -> Any:
    """What Mitsuba makes of a file, .xml; ``defined``: values of its parameters by their names.

    A Mitsuba variant must be set. Raises ``DataError`` for a path that Mitsuba cannot be told and for what would end
    the process; for all else what Mitsuba raises.
    """
    import mitsuba as mi

    config = mi.parser.ParserConfig(cast(str, mi.variant()))
    with finding_files(path):
        return _built(path, config, mi.parser.parse_file(config, as_mitsuba_reads(path), **(defined or {})))


def load_dict(path: Path, described: dict[str, Any]) -> Any:
    """What Mitsuba makes of a dictionary, which is that of the file ``path``. Raises as ``load_file``."""
    import mitsuba as mi

    config = mi.parser.ParserConfig(cast(str, mi.variant()))
    return _built(path, config, mi.parser.parse_dict(config, described))


@contextmanager
def finding_files(path: Path) -> Iterator[Any]:
    """Files that a scene names are found beside it, and where its ``<path>`` says. Gives what resolves their names.

    Raises ``DataError`` for a path that Mitsuba cannot be told.
    """
    import mitsuba as mi

    folders: Any = cast(Any, mi.file_resolver)()
    before = [folders[i] for i in range(len(folders))]
    folders.prepend(as_mitsuba_reads(path.parent.resolve()))
    try:
        yield folders
    finally:
        folders.clear()
        for folder in before:
            folders.append(folder)


def _built(path: Path, config: Any, state: Any) -> Any:
    import mitsuba as mi

    mi.parser.transform_all(config, state)
    require_limits(path, state)
    with threads_to_load():
        return mi.parser.instantiate(config, state)
