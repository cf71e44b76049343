"""A triangle mesh of a model's surface; behind ``dogsplat mesh``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..datasets import load_dataset
from ..datasets.masks import Masks, without_mask
from ..datasets.world import read_world
from ..export.refine import look_from_near
from ..formats.read import read_source
from ..render.picture_options import PictureOptions
from ..render.vantages import vantage_cameras
from ..runs.masks_of_run import without_masks_of_run
from ..scene.appearance import APPEARANCE, read_appearance
from ..scene.drawing import drawn_as
from ..support.arguments import checks_arguments
from ..support.errors import DataError
from ..support.variants import require_arrays
from .mesh_config import MeshConfig
from .mesh_files import writer_of
from .photograph_colors import photograph_colors
from .surface import surface_of


@dataclass(frozen=True)
class Meshed:
    """What came of it."""

    n_faces: int
    n_views: int
    voxel: float
    """world units"""
    notes: list[str]
    """a line on photographs of which more counts than their masks might leave"""


@checks_arguments
def make_mesh(
    model: str | Path,
    out: str | Path,
    config: MeshConfig = MeshConfig(),
    data: str | Path | None = None,
    options: PictureOptions = PictureOptions(),
    show: Callable[[int, int], None] | None = None,
) -> Meshed:
    """Write the surface of a model as triangles with colours or a texture, in the coordinates of the model; a glTF or
    OpenUSD upright and in metres, as far as the model says, or else the data.

    Args:
        model: the model, of any format.
        out: the .ply, .obj, glTF or OpenUSD to write.
        config: how.
        data: a data set whose training views are fused; without one cameras are placed around and inside. Its
            photographs are only looked at for their colours, where the config asks for these.
        options: how pictures are drawn; what they do not say, the model's file does.
        show: called with the views that are done, each of which is looked at three times, and how many there are.

    Needs a Mitsuba variant. Raises ``DataError``.
    """
    require_arrays()
    model, out = Path(model), Path(out)
    write = writer_of(out, texture=config.texture is not None)
    config.require_use(own_views=bool(data))
    options.require_use(images=bool(data), pictures=True)
    read = read_source(model, out, "mesh")
    splats, drawn = read.splats, drawn_as(options.drawing, read.drawing)
    options.require_for(drawn.linear)
    said, photographs, notes = read.drawing, None, list[str]()
    if data:
        if config.photographs:
            dataset = load_dataset(data, options.shrink, on_disk=True)
        else:
            dataset = load_dataset(data, options.shrink, spp=1, on_disk=True)  # no picture is looked at
        cameras, said = [view.camera for view in dataset.train], said.over(read_world(dataset.path).drawing)
        if config.photographs:
            masks = Masks(config.masks, dataset.train) if config.masks else None
            learned = model.parent / APPEARANCE
            appearance = read_appearance(learned) if learned.is_file() else None
            photographs = photograph_colors(dataset.train, drawn, masks, appearance)
            notes += without_mask(config.masks, (view.name for view in dataset.train))
            notes += without_masks_of_run(model, config.masks)
    else:
        cameras = vantage_cameras(splats, config.views, config.size, 0, config.inside, read.drawing.up)
        if options.near_clip is None:
            drawn = look_from_near(splats, drawn).drawn
    mesh, voxel = surface_of(splats, cameras, drawn, config, show, photographs)
    if not len(mesh.faces):
        problem = "no surface is found that hides half of what is behind it"
        raise DataError(model, problem, "use a smaller --voxel or --near-clip, a larger --reach, or other views")
    write(out, mesh, said)
    return Meshed(len(mesh.faces), len(cameras), voxel, notes)
