"""How a command ends: what goes wrong outside of the program is one line on stderr, and an exit status."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from ..runs.stopping import Stopped, stopped_with
from ..support.errors import DataError
from .streams import discard

# what single commands need, and a training for plain images and videos only
EXTRA_OF = {"pycolmap": "poses", "av": "poses", "pillow_heif": "poses", "rawpy": "poses", "skimage": "mesh",
            "fast_simplification": "mesh", "xatlas": "mesh"}  # fmt: skip
SIGPIPE = 13  # by POSIX; Windows has no such signal
STOPPED = "stopped before the end; nothing is half-written"  # of what does not know better


def quiet_pipe(run: Callable[[], int]) -> int:
    """The status of ``run``, or that of SIGPIPE where nobody reads any more, as in ``dogsplat info FILE | head -1``."""
    try:
        try:
            return run()
        finally:
            sys.stdout.flush()  # here, where it can be caught
    except BrokenPipeError:
        discard(sys.stdout)  # or it would be flushed at the very end
        return 128 + SIGPIPE


@contextmanager
def resumable() -> Iterator[None]:
    """Work that is stopped here, by Ctrl-C or SIGTERM, goes on with the same command: ``Stopped`` then says so."""
    with stopped_with("stopped; the same command again goes on from here"):
        yield


def one_line_errors(run: Callable[[], int | None], extra: str = "train", program: str = "dogsplat") -> int:
    """The status of ``run``; 2 for bad input and places that cannot be written, 128 and the signal when stopped.

    ``extra`` of pyproject.toml is where packages come from that are missing; ``program`` begins the line.
    """
    try:
        with stopped_with(STOPPED):
            return run() or 0
    except DataError as error:
        status, line = 2, str(error)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("mi_dogsplat"):
            raise
        extra = EXTRA_OF.get(error.name, extra) if extra == "train" else extra
        status, line = 2, f"this needs the package {error.name}: pip install 'mi_dogsplat[{extra}]'"
    except Stopped as stop:
        status, line = 128 + stop.signal_number, str(stop)
    except MemoryError as error:
        status, line = 2, f"not enough memory ({error or 'no more to be had'}); ask for fewer pixels or primitives"
    except OSError as error:  # of writing: what is read is looked at where it is read
        if isinstance(error, BrokenPipeError) or not error.strerror:
            raise
        place = f"{error.filename}: " if error.filename else ""
        status, line = 2, f"{place}{error.strerror}; check the place, its permissions and its space"
    with suppress(OSError):  # of a terminal that was closed
        print(f"{program}: {line}", file=sys.stderr)
    return status
