"""The glue between the viewer and viser, which carries pictures to browsers and their cameras back.

viser calls back from threads of its own; they only leave notes. All rendering is done by the one thread that calls
``Server.serve``, because a variant and its kernels belong to a thread.
"""

from __future__ import annotations

import io
import logging
import math
import time
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets.dataset import Dataset
from ..datasets.world import read_world
from ..render.framing import automatic_camera, drawn_without_data, robust_sphere, vertical
from ..render.picture import background_color
from ..render.picture_options import PictureOptions
from ..scene.cameras import Camera
from ..scene.drawing import Drawing, DrawnAs, drawn_as
from ..scene.kinds import kinds_of
from ..scene.orientation import up_of_cameras
from ..scene.splats import Splats
from ..support.arguments import checks_arguments
from ..support.errors import DataError, interruptible
from ..support.variants import require_arrays
from ..support.wording import counted
from .address import require_address
from .renderer import Renderer
from .source import Source
from .view_state import Pace, Pose, Settings

POLL_SECONDS = 1.0  # between looks at the file
IDLE_SECONDS = 0.01  # between looks at the visitors
BACKGROUNDS = {"black": 0.0, "grey": 0.5, "white": 1.0}
HEIGHTS = (120, 1440, 20)  # of the full picture: least, most, step
QUALITY = {"small": 70, "full": 95}  # of a JPEG
NEAREST, FURTHEST = 0.01, 1e4  # from the point that visitors turn about, in radii of a model that is small, or large


class Server:
    """A viewer on a port; ``serve`` renders until ``stop`` is called, or for a number of seconds.

    Args:
        source: the model; it is polled while the viewer runs.
        dataset: its photographs, if there are any.
        background: grey level of ``BACKGROUNDS``.
        options: how to draw it, before what the source says; a near_clip of None is smaller where a model without data
            is small.
    """

    def __init__(
        self,
        source: Source,
        dataset: Dataset | None = None,
        background: float = 0.0,
        options: PictureOptions = PictureOptions(),
        host: str = "127.0.0.1",
        port: int = 8080,
    ):
        import viser

        logging.getLogger("websockets.server").setLevel(logging.CRITICAL)  # it would tell of every tab that is closed
        found = source.poll()
        assert found is not None  # a new source has something to say
        splats, self.what = found
        self.source, self.options, self._trouble = source, options, ""
        self._of_data = read_world(dataset.path).drawing if dataset else Drawing()
        views = [*dataset.test, *dataset.train] if dataset else []
        drawn = self._drawn(splats, bool(views))
        options.require_for(drawn.linear)
        self.renderer = Renderer(splats, drawn, views, source.appearance)
        self.settings = Settings(background=background, sh_degree=splats.sh_degree)
        self.visitors: dict[int, tuple[Any, Pace]] = {}
        self._running, self._polled = True, time.monotonic()
        require_address(host, port)
        with redirect_stdout(io.StringIO()):  # its banner; ours is a line
            self.viser = viser.ViserServer(host=host, port=port, label="dogsplat", verbose=False)
        self.url = f"http://{self.viser.get_host()}:{self.viser.get_port()}"
        self._start_at(views[0].camera if views else automatic_camera(splats, self.drawing.up), splats)
        self._make_panel()
        self.viser.on_client_connect(self._arrived)
        self.viser.on_client_disconnect(self._left)

    @property
    def drawing(self) -> Drawing:
        """What the source says of its model, and where it says nothing of axes and unit, the data."""
        return self.source.drawing.over(self._of_data)

    def _drawn(self, splats: Splats, beside_views: bool) -> DrawnAs:
        """How a model of the source is drawn, which its file may say."""
        said = self.options.drawing, self.source.drawing
        return drawn_as(*said) if beside_views else drawn_without_data(splats, *said)

    def _start_at(self, camera: Camera, splats: Splats) -> None:
        """Let visitors begin at a camera and turn about the middle of the model."""
        initial, (centre, radius) = self.viser.initial_camera, robust_sphere(splats)
        self._nearest, self._furthest = NEAREST * min(radius, 1.0), FURTHEST * max(radius, 1.0)
        forward = camera.w2c[2, :3]
        distance = max(float(forward @ (centre - camera.position)), self._nearest)
        cameras, said = [view.camera for view in self.renderer.views], self.drawing.up
        up = vertical(splats, said) if said or not cameras else up_of_cameras(np.stack([c.c2w for c in cameras]))
        self.viser.scene.set_up_direction(tuple(up))
        initial.position = tuple(camera.position)
        initial.look_at = tuple(camera.position + distance * forward)
        initial.fov = 2 * math.atan(0.5 * camera.height / camera.fy)

    def _make_panel(self) -> None:
        gui, settings = self.viser.gui, self.settings
        grey = next(name for name, level in BACKGROUNDS.items() if level == settings.background)
        least, most, step = HEIGHTS
        degree = settings.sh_degree
        self._show = gui.add_dropdown("Show", self.renderer.choices, initial_value=settings.show)
        self._height = gui.add_slider("Height in pixels", least, most, step, settings.height)
        self._degree = gui.add_slider("SH degree", 0, max(degree, 1), 1, degree, disabled=degree == 0)
        self._grey = gui.add_dropdown("Background", list(BACKGROUNDS), initial_value=grey)
        self._gain = gui.add_slider("Error times", 1, 20, 1, settings.gain)
        self._statistics = gui.add_markdown(self.statistics(""))
        for control in (self._show, self._height, self._degree, self._grey, self._gain):
            control.on_update(lambda _: self._take_settings())

    def _take_settings(self) -> None:
        self.settings = Settings(
            self._show.value,
            int(self._height.value),
            int(self._degree.value),
            BACKGROUNDS[self._grey.value],
            float(self._gain.value),
        )
        self._everybody_changed()

    def _everybody_changed(self) -> None:
        for _, pace in list(self.visitors.values()):
            pace.changed()

    def _arrived(self, client: Any) -> None:
        pace = Pace()
        self.visitors[client.client_id] = client, pace
        # viser has bounds of its own, whatever the unit: the first turn of a wheel would throw visitors back to them
        client.camera.max_orbit_distance, client.camera.min_orbit_distance = self._furthest, self._nearest
        client.camera.on_update(lambda _: pace.moved(time.monotonic()))
        pace.changed()

    def _left(self, client: Any) -> None:
        self.visitors.pop(client.client_id, None)

    def statistics(self, last: str) -> str:
        """Markdown about the model and the last picture."""
        splats = self.renderer.splats
        counts = f"{counted(splats.n_splats, 'primitive')}, {kinds_of(splats)}, SH degree {splats.sh_degree}"
        scale = self.drawing.scale
        size = "" if scale is None else f"\n\nThe core of it is {2 * robust_sphere(splats)[1] * scale:.3g} m across"
        return f"**{self.source.path.name}**, {self._trouble or self.what}\n\n{counts}{size}\n\n{last}"

    def serve(self, seconds: float = math.inf) -> None:
        """Render what is due, in this thread."""
        end = time.monotonic() + seconds
        while self._running and time.monotonic() < end:
            if time.monotonic() - self._polled > POLL_SECONDS:
                self._reread()
            if not sum(self._attend(client, pace) for client, pace in list(self.visitors.values())):
                time.sleep(IDLE_SECONDS)

    def choose(self, show: str) -> None:
        """Show another of ``renderer.choices`` from now on, as by the panel."""
        self._show.value = show

    def stop(self) -> None:
        """End ``serve`` and close the port."""
        self._running = False
        with redirect_stdout(io.StringIO()):
            self.viser.stop()

    def _reread(self) -> None:
        found, before, self._trouble = None, self._trouble, ""
        try:
            found = self.source.poll()
        except (DataError, OSError) as error:  # in the middle of being written, or gone: the old one stays
            self._trouble = f"shown as it was; {error}"
        self._polled = time.monotonic()
        if found:
            splats, self.what = found
            self._offer_degrees(splats.sh_degree)
            self.renderer.replace(splats, self._drawn(splats, bool(self.renderer.views)), self.source.appearance)
            self._show.options = self.renderer.choices
        if found or self._trouble != before:
            self._everybody_changed()

    def _offer_degrees(self, degree: int) -> None:
        """Let the panel have the SH degrees up to that of another model; who saw all bands goes on seeing all."""
        if degree == self.renderer.splats.sh_degree:
            return
        saw_all = self.settings.sh_degree >= self.renderer.splats.sh_degree
        self._degree.max, self._degree.disabled = max(degree, 1), degree == 0
        self._degree.value = degree if saw_all else min(self.settings.sh_degree, degree)
        self.settings = replace(self.settings, sh_degree=int(self._degree.value))

    def _attend(self, client: Any, pace: Pace) -> bool:
        """Send a visitor the picture that is due, if one is."""
        due = pace.due(time.monotonic())
        if due is None:
            return False
        camera = client.camera
        wxyz, position = (tuple(float(x) for x in values) for values in (camera.wxyz, camera.position))
        try:
            aspect = float(camera.aspect)
        except ZeroDivisionError:  # of a window without an area
            aspect = math.nan
        pose = Pose(wxyz, position, float(camera.fov), aspect)  # type: ignore[arg-type]
        if not pose.makes_sense:  # the picture before stays
            return False
        drawn = self.renderer.draw(pose, self.settings, moving=due == "small")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the visitor may have left while we drew
            client.scene.set_background_image(drawn.image, format="jpeg", jpeg_quality=QUALITY[due])
        if due == "full":
            height, width = drawn.image.shape[:2]
            last = f"{width} x {height} in {drawn.milliseconds:.0f} ms"
            self._statistics.content = self.statistics(f"{last}; {drawn.about}" if drawn.about else last)
        return True


@checks_arguments
def serve(
    model: str | Path,
    data: str | Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    options: PictureOptions = PictureOptions(),
    show: Callable[[str], None] = print,
) -> None:
    """Show a model file or a run folder in the browser, until Ctrl-C.

    Args:
        model: the model or run; of a run that still trains, its newest checkpoint.
        data: photographs to compare with; None: those of the run.
        host, port: where it listens.
        options: how it is drawn; what they do not say, the run or the file of the model does.
        show: told in one line where to look.

    Needs a Mitsuba variant, which belongs to the calling thread. Raises ``DataError``.
    """
    require_arrays()
    if not 0 < port < 65536:
        raise DataError("--port", f"{port} is not a port", "use 1 to 65535")
    source = Source(Path(model))
    dataset = _dataset(data, source, options)
    options.require_use(images=dataset is not None, pictures=True)
    has_alpha = dataset is not None and dataset.has_alpha
    background = background_color(options.or_trained(source.config).background, has_alpha)
    server = Server(source, dataset, background, options, host, port)
    show(f"{server.url} shows {model}; Ctrl-C ends it")
    try:
        with interruptible():
            server.serve()
    except KeyboardInterrupt:  # the way to end it
        pass
    finally:
        server.stop()


def _dataset(data: str | Path | None, source: Source, options: PictureOptions) -> Dataset | None:
    """The data set that is named, or that of the run if it is still there; either as the run was trained on its own,
    which may have moved."""
    from ..datasets import load_dataset

    path = data or source.data
    if not path:
        return None
    split, on_disk = source.config.get("split", "test"), source.config.get("data_on_disk", False)
    return load_dataset(path, options.or_trained(source.config).shrink, on_disk=on_disk, split=split)
