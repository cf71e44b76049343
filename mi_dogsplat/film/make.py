"""From a model or a Mitsuba scene and a camera path to a film; behind ``dogsplat film``."""

from __future__ import annotations

from pathlib import Path

from ..formats.read import require_primitives
from ..render.picture_options import PictureOptions
from ..render.scene_to_draw import SceneOptions, scene_to_draw
from ..support.arguments import checks_arguments
from ..support.variants import require_arrays
from .chosen_path import chosen_path
from .data_cameras import data_cameras
from .film_config import PATHS, FilmConfig
from .model_frames import ModelFrames
from .orbit import Surroundings, around_model
from .output import output_of
from .record import Film, Progress, record
from .scene_frames import SceneFrames
from .scene_path import path_through
from .subject import read_subject


@checks_arguments
def make_film(
    model: str | Path,
    out: str | Path,
    data: str | Path | None = None,
    config: FilmConfig = FilmConfig(),  # noqa: B008, it is immutable
    options: PictureOptions = PictureOptions(),
    progress: Progress = lambda done, n, what: None,
) -> Film:
    """Render a film of a model.

    Args:
        model: a model file, or a run folder, which knows its data and how it was trained.
        out: a video ``.mp4``; or pictures: a folder, or a name with a number such as ``frames/%04d.exr``. What ends in
            a slash is a folder, even where its name has a point.
        data: the data set whose cameras the path follows or stands on.
        config: the path, and how its pictures become a film.
        options: how the model is drawn; what they do not say, the run or the file of the model does.
        progress: gets the number of finished frames, that of all, and the path in words.

    Needs a Mitsuba variant. A film that is stopped (Ctrl-C, SIGTERM) leaves no file; of numbered pictures the whole
    ones stay, and the same call goes on after them. Raises ``DataError``; ``Stopped`` when asked to stop.
    """
    require_arrays()
    output, model = output_of(out, config), Path(model)
    subject = read_subject(model, data, options, chosen=config.path not in PATHS)
    require_primitives(model, subject.model, "film")
    options.require_for(subject.drawn.linear)
    splats, up = subject.model.splats, subject.up

    def around() -> Surroundings:
        return around_model(splats, up, config.fov)

    path = chosen_path(config, subject.data, up, around, subject.missing, subject.model)
    return record(output, path, lambda: ModelFrames(subject, output.in_linear_light), config, progress)


@checks_arguments
def make_scene_film(
    scene: str | Path,
    out: str | Path,
    data: str | Path | None = None,
    config: FilmConfig = FilmConfig(),  # noqa: B008, it is immutable
    options: SceneOptions = SceneOptions(),  # noqa: B008, it is immutable
    progress: Progress = lambda done, n, what: None,
) -> Film:
    """Render a film of a Mitsuba scene, by the scene's own integrator.

    Args:
        scene: its file, .xml.
        out, config, progress: as of ``make_film``. OpenEXR holds linear radiance and every channel of the film.
        data: a data set in the coordinates of the scene, whose cameras the path follows or stands on.
        options: how the scene is drawn, and which of its sensors goes along the path.

    Where nothing else is said the path is an orbit that begins with the picture of the sensor, and pictures have the
    size of its film. Needs, leaves and raises what ``make_film`` does.
    """
    require_arrays()
    output = output_of(out, config)
    drawn = scene_to_draw(Path(scene), options)
    path = path_through(drawn, data_cameras(data), config)
    return record(output, path, lambda: SceneFrames(drawn), config, progress)
