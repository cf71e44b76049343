"""A model measured on the photographs of a data set; behind ``dogsplat eval``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

from ..datasets import camera_extent, load_dataset
from ..datasets.dataset import View
from ..datasets.masks import Masks, all_black
from ..formats.read import read_model, require_primitives
from ..measure.evaluate import Measure, evaluate_views, mean_metrics, view_files
from ..measure.lpips import Lpips
from ..render.picture import background_color, picture_of
from ..render.picture_options import PictureOptions
from ..report.run_folder import CONFIG, METRICS
from ..scene.drawing import drawn_as
from ..support.arguments import checks_arguments
from ..support.errors import DataError
from ..support.files import parse_json, remove_parts, write_json
from ..support.locks import locked
from ..support.variants import require_arrays
from .run import prepared


@checks_arguments
def evaluate_model(
    model: str | Path,
    data: str | Path,
    out: str | Path | None = None,
    masks: str | Path | None = None,
    color_correct: bool = False,
    data_on_disk: bool = False,
    options: PictureOptions = PictureOptions(),
    align_poses: bool = False,
) -> dict[str, dict[str, float]]:
    """Metrics of a model file on each test view of a data set (on all views without a split), by the view's name.

    Args:
        model: the model.
        data: the data set.
        out: folder for renders, error maps and ``metrics.json``; None writes nothing.
        masks: folder of masks, named as the images; black pixels do not count.
        color_correct: also measure PSNR after each view's best colour map.
        data_on_disk: decode images when they are due.
        options: how the model is drawn, where its file is not to say so; ``downscale`` shrinks the photographs, and
            ``white`` exposes those of linear radiance, too.
        align_poses: also measure PSNR from the pose near that of each view that fits its photograph best.

    LPIPS is measured where its weights are installed. Needs a Mitsuba variant. Raises ``DataError``.
    """
    require_arrays()
    read = read_model(model)
    require_primitives(Path(model), read, "measure")
    splats, drawn = read.splats, drawn_as(options.drawing, read.drawing)
    options.require_for(drawn.linear)
    dataset = load_dataset(data, options.shrink, on_disk=data_on_disk)
    if options.white is not None and dataset.white is not None:
        dataset = dataset.exposed(options.white)  # as in a training with this white
    drawn = drawn.beside(dataset.white)
    background = background_color(options.background, dataset.has_alpha)
    folder = Path(out) if out else None
    if folder and (folder / CONFIG).exists():
        raise DataError(folder, "is a training run with metrics of its own", "name another folder")
    picture = picture_of(splats, background, drawn, ("depth",) if folder else ())
    split, some = ("test", dataset.test) if dataset.test else ("train", dataset.train)
    mask_folder = Masks(masks, dataset.views) if masks else None
    extent = camera_extent(dataset.train) if align_poses else None
    measure = Measure(mask_folder, color_correct, extent, Lpips.installed(view.camera for view in some))
    with _whole_or_not_at_all(folder, some) if folder else nullcontext():
        views = evaluate_views(lambda view: picture(view.camera), some, background, folder, measure)
        if masks and not views:
            raise all_black(masks, "view that is measured")
        if folder:
            found = {split: mean_metrics(views), "views": views, "n": splats.n_splats}
            write_json(folder / METRICS, found)
    return views


@contextmanager
def _whole_or_not_at_all(folder: Path, views: Sequence[View]) -> Iterator[None]:
    """The folder is ours alone, without the pictures of an earlier measurement. What is raised here, Ctrl-C too, leaves
    nothing of the views there, and no metrics of before; after a kill the metrics are empty."""
    with prepared(folder), locked(folder, "another process is measuring into it"):
        remove_parts(folder)
        try:
            earlier = _measured_before(folder)
            write_json(folder / METRICS, {})  # by which the folder is known, without what was measured before
            _remove_pictures(folder, earlier)
            yield
        except BaseException:
            (folder / METRICS).unlink(missing_ok=True)
            _remove_pictures(folder, [view.name for view in views])
            raise


def _measured_before(folder: Path) -> list[str]:
    """Names of the views that the metrics of a folder are of, whose pictures lie in it."""
    try:
        found = parse_json((folder / METRICS).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # none, or what is left of them
        return []
    views = found.get("views") if isinstance(found, dict) else None
    return [name for name in views or () if Path(name).name == name] if isinstance(views, dict) else []


def _remove_pictures(folder: Path, names: Iterable[str]) -> None:
    for path in (path for name in names for path in view_files(folder, name)):
        path.unlink(missing_ok=True)
