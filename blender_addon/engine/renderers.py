"""The two ways to the exact picture: the package inside of this process, or its command as another process.

Mitsuba is imported only when a picture is rendered, and nothing else of the add-on needs it.
"""

from __future__ import annotations

import importlib.util
import json
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..cameras.camera import Camera
from ..files.errors import FileError
from ..files.model import Model
from ..files.ply import write_ply

BAND_ROWS = 128  # between two looks at whether the user has cancelled
POLL_SECONDS = 0.1
MISSING = (
    "Mitsuba is not there: install the package with \"pip install 'mi_dogsplat[train]'\" in any Python "
    "and name its command dogsplat in the preferences of this add-on"
)
Picture = dict[str, np.ndarray]  # color [H, W, 3] sRGB values over black, alpha [H, W], depth [H, W]; from the top


class Cancelled(Exception):
    """The user does not want the picture any more."""


class RendererError(RuntimeError):
    """No picture, and why, in one line."""


@dataclass(frozen=True)
class Settings:
    """What the integrator needs to know besides model and camera."""

    near_clip: float
    antialiased: bool


class InProcess:
    """The package ``mi_dogsplat`` and Mitsuba in Blender's own Python."""

    name = "Mitsuba in this process"

    def render(self, model: Model, camera: Camera, settings: Settings, cancelled: Callable[[], bool],
               progress: Callable[[float], None]) -> Picture:  # fmt: skip
        """The picture, band by band. Raises ``Cancelled`` and ``RendererError``."""
        try:
            import mi_dogsplat  # noqa: F401  (before mitsuba: it chooses the LLVM)
            import mitsuba as mi
            from mi_dogsplat.engine.parameters import upload
            from mi_dogsplat.engine.rasterize import RasterOptions
            from mi_dogsplat.render.picture import render_picture
            from mi_dogsplat.scene.cameras import Camera as PackageCamera
            from mi_dogsplat.scene.splats import Splats

            if not (mi.variant() or "").endswith("ad_rgb"):
                mi.set_variant("cuda_ad_rgb", "llvm_ad_rgb")
        except (ImportError, RuntimeError) as error:
            raise RendererError(f"Mitsuba cannot be used here ({' '.join(str(error).split())})") from error
        index = np.flatnonzero(model.is_dog)
        params = upload(Splats(
            model.means, model.log_scales, model.quats[:, [1, 2, 3, 0]], model.logit_opacities, model.sh_coeffs,
            index, model.dog_logit_opacities[index], model.dog_log_scales[index],
        ))  # fmt: skip
        options = RasterOptions(sh_degree=model.sh_degree, antialiased=settings.antialiased, depth=True)
        bands = []
        for top in range(0, camera.height, BAND_ROWS):
            if cancelled():
                raise Cancelled
            rows = min(BAND_ROWS, camera.height - top)
            band = PackageCamera(camera.w2c, camera.fx, camera.fy, camera.cx, camera.cy - top, camera.width, rows)
            film = (0.0, -float(top), float(camera.width), float(camera.height - top))
            picture = render_picture(params, band, options, 0.0, settings.near_clip, film=film)
            bands.append((picture.color, picture.alpha, picture.depth))
            progress((top + rows) / camera.height)
        return dict(zip(("color", "alpha", "depth"), map(np.concatenate, zip(*bands, strict=True)), strict=True))

    def convert(self, path: Path, out: Path) -> None:
        """A model of any format as a PLY, with DoG and comments. Raises ``FileError`` and ``RendererError``."""
        try:
            from mi_dogsplat.formats.read import read_model
            from mi_dogsplat.formats.write import write_model
        except (ImportError, RuntimeError) as error:
            raise RendererError(f"mi_dogsplat cannot be used here ({' '.join(str(error).split())})") from error
        try:
            write_model(out, read_model(path))
        except ValueError as error:  # DataError, which names the file in one line
            raise _file_error(path, str(error)) from error


@dataclass(frozen=True)
class Command:
    """The command ``dogsplat`` of any Python on this computer."""

    words: tuple[str, ...]

    @property
    def name(self) -> str:
        """For the status bar."""
        return " ".join(self.words)

    def render(self, model: Model, camera: Camera, settings: Settings, cancelled: Callable[[], bool],
               progress: Callable[[float], None]) -> Picture:  # fmt: skip
        """The picture, through files in a temporary folder. Raises ``Cancelled`` and ``RendererError``."""
        with tempfile.TemporaryDirectory(prefix="dogsplat_") as name:
            folder = Path(name)
            write_ply(folder / "model.ply", model)
            numbers = {key: getattr(camera, key) for key in ("fx", "fy", "cx", "cy", "width", "height")}
            (folder / "camera.json").write_text(json.dumps({"w2c": camera.w2c.tolist(), **numbers}), encoding="utf-8")
            arguments = ["render", str(folder / "model.ply"), "--camera", str(folder / "camera.json")]
            arguments += ["-o", str(folder / "picture.npz"), "--near-clip", repr(settings.near_clip)]
            arguments += ["--antialiased"] if settings.antialiased else []
            self._run(arguments, folder / "log.txt", cancelled, progress)
            with np.load(folder / "picture.npz") as file:
                return {key: file[key] for key in ("color", "alpha", "depth")}

    def convert(self, path: Path, out: Path) -> None:
        """As that of ``InProcess``."""
        words = [*self.words, "export", str(path), "-o", str(out), "--dog", "keep", "--views", "0"]
        try:
            done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace")
        except OSError as error:
            raise RendererError(f"{self.name} cannot be started ({error.strerror})") from error
        if done.returncode:
            lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
            raise _file_error(path, lines[-1].removeprefix("dogsplat: "))

    def _run(self, arguments: list[str], log: Path, cancelled: Callable[[], bool],
             progress: Callable[[float], None]) -> None:  # fmt: skip
        with log.open("w") as output:
            try:
                files = {"stdin": subprocess.DEVNULL, "stdout": output, "stderr": output}
                process = subprocess.Popen([*self.words, *arguments], **files)
            except OSError as error:
                raise RendererError(f"{self.name} cannot be started ({error.strerror})") from error
            share = 0.0
            try:
                while process.poll() is None:
                    if cancelled():
                        raise Cancelled
                    share += (1 - share) * 0.02  # the command does not tell how far it is
                    progress(share)
                    try:
                        process.wait(POLL_SECONDS)
                    except subprocess.TimeoutExpired:
                        continue
            finally:
                if process.poll() is None:
                    process.kill()
                    process.wait()
        if process.returncode:
            lines = log.read_text(errors="replace").strip().splitlines() or [f"exit status {process.returncode}"]
            raise RendererError(f"{self.name}: {lines[-1]}")


def _file_error(path: Path, line: str) -> FileError:
    """Of a line of the package: file, problem, remedy."""
    problem, _, remedy = line.removeprefix(f"{path}: ").rpartition("; ")
    return FileError(path, problem or line, remedy)


def converted(command: str, path: Path, out: Path) -> None:
    """Make a PLY of a model that the add-on cannot read by itself. Raises ``FileError``."""
    try:
        choose_renderer(command).convert(path, out)
    except RendererError as error:
        remedy = "install the package mi_dogsplat[export] and name its command in the preferences, or convert it to PLY"
        raise FileError(path, f"only the package reads this format, and {error}", remedy) from error


def choose_renderer(command: str = "") -> InProcess | Command:
    """The command of the preferences, else this process, else a command on the PATH. Raises ``RendererError``."""
    if command:
        whole = Path(command).expanduser()  # may hold spaces
        words = (str(whole),) if whole.is_file() else tuple(shlex.split(command, posix=sys.platform != "win32"))
        if not shutil.which(words[0]):
            raise RendererError(
                f'"{command}", the command in the preferences of DoG Splat, is not there; correct or clear it'
            )
        return Command(words)
    if importlib.util.find_spec("mitsuba") and importlib.util.find_spec("mi_dogsplat"):
        return InProcess()
    if found := shutil.which("dogsplat"):
        return Command((found,))
    raise RendererError(MISSING)
