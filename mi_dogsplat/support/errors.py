"""The one exception for bad input: it names the file, what is wrong and what to do, on one line."""

from __future__ import annotations

from pathlib import Path

QUOTED = 600  # characters of a name, or of what quotes a file


class DataError(ValueError):
    """Bad input. ``str(e)`` is one printable line: ``<path>: <problem>; <remedy>``.

    The command line prints that line and exits with status 2; as a library the exception is a ``ValueError``.
    """

    def __init__(self, path: str | Path, problem: str, remedy: str):
        place, what = (text if len(text) <= QUOTED else text[:QUOTED] + "..." for text in (str(path), problem))
        line = " ".join(f"{place}: {what}; {remedy}".split())
        super().__init__("".join(c if c.isprintable() else ascii(c)[1:-1] for c in line))
        self.path = Path(path)


def gist(error: BaseException) -> str:
    """What went wrong first, in Mitsuba's words but without the Python traceback that it quotes."""
    while error.__cause__ or error.__context__:  # Dr.Jit wraps errors of a render in "see above"
        error = error.__cause__ or error.__context__ or error
    lines = str(error).strip().splitlines() or [type(error).__name__]
    traceback = next((i for i, line in enumerate(lines) if "Traceback (most recent call last)" in line), None)
    if traceback is None:
        return " ".join(lines)
    return " ".join([*lines[:traceback], lines[traceback].split("Traceback")[0], lines[-1]])
