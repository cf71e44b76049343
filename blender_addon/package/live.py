"""The two ways to the pictures of a viewport, as in ``renderers.py``; each viewport has one of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .folder import own_folder
from .renderers import IDLE_SECONDS, IN_TURNS, mitsuba, words_of
from .served import RendererError, Served

Left = Callable[[], bool]
Pictures = Iterator[tuple[float, np.ndarray]]  # share that is done, [H, W, 4] float32 premultiplied, from the top


class LiveInProcess:
    """The package and Mitsuba in Blender's own Python."""

    def __init__(self):
        self.folder, self.close = own_folder(self)
        self._views: Any = None

    def pictures(self, request: dict[str, Any], left: Left) -> Pictures:
        """Pictures of a request until the last, or until they are ``left``. Raises ``RendererError``."""
        with mitsuba():
            from mi_dogsplat.requests.view_request import read_view_request
            from mi_dogsplat.requests.views import Views
        self._views = self._views or Views()
        try:
            steps = self._views.frames(read_view_request(request), left)
            while True:
                with IN_TURNS:
                    step = next(steps, None)
                if step is None:
                    return
                yield step
        except ValueError as error:  # DataError, which is one line
            raise RendererError(str(error)) from error


class LiveCommand:
    """The command ``dogsplat`` as a process, which is started again if it has ended."""

    def __init__(self, words: tuple[str, ...]):
        self._words = [*words, "serve", "--idle", str(IDLE_SECONDS)]
        self._name = " ".join(words)
        self.folder, self._remove = own_folder(self)
        self._served: Served | None = None

    def pictures(self, request: dict[str, Any], left: Left) -> Pictures:
        """As those of ``LiveInProcess``."""
        if self._served is None or not self._served.lives():
            self._served = Served(self._words, self._name, self.folder / "log.txt")
        camera = request["camera"]
        size = camera["height"], camera["width"], 4
        for share, path in self._served.pictures({**request, "out": str(self.folder / "frame.rgba")}, left):
            yield share, np.fromfile(path, np.float32).reshape(size)

    def close(self) -> None:
        """End the process and remove its folder."""
        if self._served is not None:
            self._served.end()
        self._served = None
        self._remove()


def live_renderer(command: str = "") -> LiveInProcess | LiveCommand:
    """The package as ``choose_renderer`` finds it. Raises ``RendererError``."""
    words = words_of(command)
    return LiveCommand(words) if words else LiveInProcess()
