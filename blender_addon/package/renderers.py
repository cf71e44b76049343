"""The two ways to a picture: the package inside of this process, or its command as another process.

Mitsuba is imported only when a picture is rendered, and nothing else of the add-on needs it. A renderer stays for the
frames that follow: it has loaded Mitsuba and compiled its kernels, and its folder holds what they have in common.
"""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..files.errors import FileError, told
from .folder import own_folder
from .served import Cancelled, RendererError, Served, environment
from .task import SPEAKS

MISSING = (
    "Mitsuba is not there: install the package with \"pip install '.[train,export,mesh]'\" in the folder of its "
    "repository, in any Python, and name its command dogsplat in the preferences of this add-on"
)
WRONG = '"{command}", the command in the preferences of DoG Splat, is not there; correct or clear it'
IDLE_SECONDS = 600  # after which a process ends that no frame has come to
Picture = dict[str, np.ndarray]  # color [H, W, 3], alpha [H, W] and passes, as mi_dogsplat.requests has them
Request = dict[str, Any]
Cancel = Callable[[], bool]
Progress = Callable[[float], None]
Preview = Callable[[Picture], None]
IN_TURNS = threading.Lock()  # the final picture and those of viewports


@contextmanager
def mitsuba() -> Iterator[None]:
    """To import from the package in this process. Raises ``RendererError`` where that cannot be done."""
    try:
        with IN_TURNS:
            import mi_dogsplat  # noqa: F401  (before mitsuba: it chooses the LLVM)
            import mitsuba as mi

            if not (mi.variant() or "").endswith("ad_rgb"):
                mi.set_variant("cuda_ad_rgb", "llvm_ad_rgb")
            yield
    except (ImportError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise RendererError("Mitsuba cannot be used here ({reason})", reason=reason) from error


class InProcess:
    """The package ``mi_dogsplat`` and Mitsuba in Blender's own Python."""

    def __init__(self):
        self.folder, self._remove = own_folder(self)
        self._answerer: Any = None

    @property
    def name(self) -> str:
        """For the status bar."""
        return told("Mitsuba in this process")

    def render(self, request: Request, cancelled: Cancel, progress: Progress, preview: Preview) -> Picture:
        """The picture, step by step. Raises ``Cancelled`` and ``RendererError``."""
        with mitsuba():
            from mi_dogsplat.requests.answer import Answerer
            from mi_dogsplat.requests.request import read_request
        self._answerer = self._answerer or Answerer()
        try:
            steps = self._answerer.answer(read_request(request))
            while not cancelled():
                with IN_TURNS:
                    share, picture = next(steps)
                progress(share)
                if share == 1:
                    return picture
                if picture is not None:
                    preview(picture)
        except ValueError as error:  # DataError, which is one line
            raise RendererError(str(error)) from error
        raise Cancelled

    def convert(self, path: Path, out: Path, bake: bool = False) -> None:
        """A model of any format as a PLY with comments, its DoG kept or baked into plain Gaussians.

        Slopes, curvatures, cuts and shifts stay: the whole primitive nearest to one with a cut is elsewhere. Raises
        ``FileError`` and ``RendererError``.
        """
        try:
            from mi_dogsplat.export.bake import baked
            from mi_dogsplat.formats.read import read_model
            from mi_dogsplat.formats.write import write_model
        except (ImportError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise RendererError("mi_dogsplat cannot be used here ({reason})", reason=reason) from error
        try:
            model = read_model(path)
            write_model(out, replace(model, splats=baked(model.splats)) if bake else model)
        except ValueError as error:  # DataError, which names the file in one line
            raise _file_error(path, str(error)) from error

    def close(self) -> None:
        """Remove its folder."""
        self._remove()


class Command:
    """The command ``dogsplat`` of any Python on this computer, whose process answers one frame after the other."""

    def __init__(self, words: tuple[str, ...]):
        self.words = words
        self.folder, self._remove = own_folder(self)
        self._served: Served | None = None

    @property
    def name(self) -> str:
        """For the status bar."""
        return " ".join(self.words)

    def render(self, request: Request, cancelled: Cancel, progress: Progress, preview: Preview) -> Picture:
        """The picture, through files. Raises ``Cancelled``, which ends the process, and ``RendererError``."""
        if self._served is None or not self._served.lives():
            words = [*self.words, "serve", "--idle", str(IDLE_SECONDS)]
            self._served = Served(words, self.name, self.folder / "log.txt")
        try:
            for share, out in self._served.answers({**request, "out": str(self.folder / "picture.npz")}, cancelled):
                progress(share)
                picture = _read(out) if out else None
                if share == 1:
                    return picture or {}
                if picture:
                    preview(picture)
        except (Cancelled, RendererError):
            self.stop()
            raise
        raise RendererError("{name}: no answer", name=self.name)

    @property
    def process_id(self) -> int | None:
        """Of the process that waits for the next picture; None where there is none."""
        return self._served.process_id if self._served else None

    def convert(self, path: Path, out: Path, bake: bool = False) -> None:
        """As that of ``InProcess``."""
        kept = "--slopes", "keep", "--cuts", "keep", "--shifts", "keep"
        how = "--dog", "bake" if bake else "keep", *kept, "--refine", "0", "--views", "0"
        words = [*self.words, "export", str(path), "-o", str(out), *how]
        text = {"encoding": "utf-8", "errors": "replace", "env": environment()}
        try:
            done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, **text)
        except OSError as error:
            raise RendererError("{name} cannot be started ({reason})", name=self.name, reason=error.strerror) from error
        lines = done.stderr.strip().splitlines() or [told("exit status {status}", status=done.returncode)]
        if done.returncode and lines[-1].startswith(SPEAKS):
            raise _file_error(path, lines[-1].removeprefix(SPEAKS))
        if done.returncode or not out.is_file():  # not what the package says of a file, or not the package at all
            raise RendererError(f"{self.name}: {lines[-1]}")

    def stop(self) -> None:
        """End the process; the next picture starts another."""
        if self._served is not None:
            self._served.end()
        self._served = None

    def close(self) -> None:
        """End the process and remove its folder."""
        self.stop()
        self._remove()


def _read(path: str) -> Picture:
    with np.load(path) as file:
        return {key: file[key] for key in file.files}


def _file_error(path: Path, line: str) -> FileError:
    """Of a line of the package: file, problem, remedy."""
    problem, _, remedy = (line := line.removeprefix(f"{path}: ")).rpartition("; ")
    if not problem:
        return FileError(path, line, "copy or export the file again")
    return FileError(path, problem, remedy)


def converted(command: str, path: Path, out: Path) -> None:
    """Make a PLY of a model that the add-on cannot read by itself. Raises ``FileError``."""
    try:
        choose_renderer(command).convert(path, out)
    except RendererError as error:
        remedy = "install the package mi_dogsplat[export] and name its command in the preferences, or convert it to PLY"
        raise FileError(path, "only the package reads this format, and {reason}", remedy, reason=error) from error


_RESIDENT: dict[tuple[str, ...], InProcess | Command] = {}  # by the words of the command; none: this process


def choose_renderer(command: str = "") -> InProcess | Command:
    """The command of the preferences, else this process, else a command on the PATH. Raises ``RendererError``.

    It is the same one as before, so that it need not start again, until ``close_renderers``; another one where systems
    that clean up old temporary files have taken its folder.
    """
    words = words_of(command)
    if words not in _RESIDENT or not _RESIDENT[words].folder.is_dir():
        close_renderers()
        _RESIDENT[words] = Command(words) if words else InProcess()
    return _RESIDENT[words]


def close_renderers() -> None:
    """End what ``choose_renderer`` has started."""
    while _RESIDENT:
        _RESIDENT.popitem()[1].close()


def _split(command: str) -> tuple[str, ...]:
    """A file, whose name may hold spaces, or words, which may stand in quotes; none where a quote is not closed."""
    whole = os.path.expanduser(command)
    if Path(whole).is_file():
        return (whole,)
    try:
        if sys.platform != "win32":
            return tuple(shlex.split(command))
        words = shlex.split(command, posix=False)  # there a backslash is part of a path
    except ValueError:
        return ()
    return tuple(word[1:-1] if len(word) > 1 and word[0] == word[-1] in "'\"" else word for word in words)


def process_words(command: str = "") -> list[str]:
    """The words that start the package as a process of its own, however it is found. Raises ``RendererError``."""
    return list(words_of(command)) or [sys.executable, "-m", "mi_dogsplat"]


def words_of(command: str) -> tuple[str, ...]:
    """What starts the package; empty: this process. Raises ``RendererError``."""
    if command := command.strip():
        words = _split(command)
        program = os.path.expanduser(words[0]) if words else ""  # only now: a home folder may have spaces in its name
        if not shutil.which(program):
            raise RendererError(WRONG, command=command)
        return (program, *words[1:])
    if importlib.util.find_spec("mitsuba") and importlib.util.find_spec("mi_dogsplat"):
        return ()
    if found := shutil.which("dogsplat"):
        return (found,)
    raise RendererError(MISSING)
