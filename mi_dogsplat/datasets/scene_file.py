"""A Mitsuba scene from its XML, with what is wrong with it on one line; and where its shapes are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..support.errors import DataError
from ..support.scene_errors import as_mitsuba_reads, scene_error
from ..support.scene_limits import require_limits
from ..support.scene_loading import finding_files
from ..support.threads import threads_to_load
from ..support.variants import require_variant
from ..support.wording import counted

GIVE = "give a Mitsuba scene as .xml file"
SPLATTING = {"dogsplat", "dogpath"}  # integrators that draw ``dog`` shapes
SURROUNDING = 4.0  # a floor or dome is so many times larger than all that is smaller
FLAT = 0.02  # thickness of a floor, times its diagonal


def load_scene(path: Path, hide_emitters: bool = False, defined: Mapping[str, str] | None = None) -> tuple[Any, bool]:
    """(scene, whether cameras see no lamps). A Mitsuba variant must be set. Raises ``DataError``.

    ``hide_emitters`` sets that parameter of the scene's integrators, whatever the file says; ``defined``: values of its
    parameters by their names. Nothing is merged, so that each shape of the file still has its own bounding box, and
    each sensor its name.
    """
    import mitsuba as mi

    config = _parser_config(path)
    config.merge_meshes = config.merge_equivalent = False
    with _finding_files(path):
        state = mi.parser.parse_file(config, str(path), **(defined or {}))
        mi.parser.transform_all(config, state)
        require_limits(path, state)
        integrators = [node.props for node in state.nodes if node.type == mi.ObjectType.Integrator]
        for properties in integrators if hide_emitters else ():
            properties["hide_emitters"] = True
        hidden = any("hide_emitters" in properties and properties["hide_emitters"] for properties in integrators)
        with threads_to_load():
            scene = mi.parser.instantiate(config, state)
    if not isinstance(scene, mi.Scene):
        raise DataError(path, "its root element is not <scene>", "give a file with a <scene> element")
    if scene.integrator() is None:
        kind = "dogsplat" if has_splats(path) else "path"
        raise DataError(path, "the scene has no integrator", f'add <integrator type="{kind}"/>')
    return scene, hidden


@contextmanager
def _finding_files(path: Path) -> Iterator[Any]:
    """As ``finding_files``; what Mitsuba raises meanwhile is a ``DataError``."""
    try:
        with finding_files(path) as folders:
            yield folders
    except DataError:
        raise
    except Exception as error:  # Mitsuba raises several kinds, all of them with a message to show
        remedy = "correct the scene" if path.suffix.lower() == ".xml" else GIVE
        raise scene_error(path, error, "Mitsuba cannot load it", remedy) from error


def has_splats(path: Path) -> bool:
    """Whether some shapes of a scene are ``dog``; it is read, not loaded. Raises ``DataError``."""
    return bool(_splats_and_integrators(path)[0])


def shows_splats(path: Path) -> bool:
    """Whether a scene has ``dog`` shapes and an integrator that draws them; it is read, not loaded. Raises
    ``DataError``."""
    n_splats, integrators = _splats_and_integrators(path)
    return n_splats > 0 and bool(integrators & SPLATTING)


def warn_of_unseen_splats(path: Path, defined: Mapping[str, str] | None = None) -> None:
    """Warn of ``dog`` shapes in a scene whose integrator does not know splats and leaves them out without a word.

    The scene is read, not loaded. ``defined``: values of its parameters by their names. Raises ``DataError``.
    """
    import mitsuba as mi

    n_splats, integrators = _splats_and_integrators(path, defined)
    if n_splats and integrators and not integrators & SPLATTING:
        log: Any = mi.Log
        unseen = counted(n_splats, "dog shape")
        log(mi.LogLevel.Warn, f"{path}: {unseen} not seen; use the integrator dogsplat or dogpath")


def files_read(path: Path, defined: Mapping[str, str] | None = None) -> tuple[list[Path], dict[str, Path]]:
    """The XML files of a scene, its own and those that it includes, and by the names that it has for them, the files of
    its textures, meshes and other plugins. It is read, not loaded. ``defined``: values of its parameters by their
    names. Raises ``DataError``."""
    import mitsuba as mi

    config = _parser_config(path)
    with _finding_files(path) as folders:
        state = mi.parser.parse_file(config, str(path), **(defined or {}))
        texts = {text for node in state.nodes for _, text in node.props.items() if isinstance(text, str)}
        found = {text: Path(str(folders.resolve(text))) for text in sorted(texts)}
    return [Path(str(file)) for file in state.files], {text: file for text, file in found.items() if file.is_file()}


def _splats_and_integrators(path: Path, defined: Mapping[str, str] | None = None) -> tuple[int, set[str]]:
    """(number of ``dog`` shapes, plugins of the integrators, nested ones included) of a scene. Raises ``DataError``."""
    import mitsuba as mi

    config = _parser_config(path)
    with _finding_files(path):
        state = mi.parser.parse_file(config, str(path), **(defined or {}))
    plugins = [(node.type, node.props.plugin_name()) for node in state.nodes]
    n_splats = plugins.count((mi.ObjectType.Shape, "dog"))
    return n_splats, {name for kind, name in plugins if kind == mi.ObjectType.Integrator}


def _parser_config(path: Path) -> Any:
    import mitsuba as mi

    variant = require_variant()
    if not path.is_file():
        problem = "this is a folder" if path.is_dir() else "no such file"
        raise DataError(path, problem, GIVE)
    as_mitsuba_reads(path)
    return mi.parser.ParserConfig(variant)


def framing_sphere(path: Path, scene: Any) -> tuple[np.ndarray, float, int]:
    """(centre [3], radius, shapes left out) of a sphere around what there is to look at.

    Lamps stand far off and count only where there is nothing else. Left out are floors and domes: shapes that are
    ``SURROUNDING`` times larger than all smaller ones together, and flat or around the scene's first sensor. Raises
    ``DataError``.
    """
    shapes = [shape for shape in scene.shapes() if not shape.is_emitter()] or scene.shapes()
    if not shapes:
        raise DataError(path, "the scene has no shape", "add something to look at, or use --path sensors")
    low, high = (np.array([_corner(shape, end) for shape in shapes]) for end in ("min", "max"))  # [S, 3]
    if not np.isfinite([low, high]).all():
        raise DataError(path, "the bounding box of a shape is not finite", "remove what is infinite or empty")
    sizes = np.linalg.norm(high - low, axis=1)  # [S]
    order = np.argsort(sizes, kind="stable")  # from small to large
    sizes, low, high = sizes[order], low[order], high[order]
    lows, highs = np.minimum.accumulate(low), np.maximum.accumulate(high)  # [S, 3] around all up to this one
    unions = np.linalg.norm(highs - lows, axis=1)  # [S]
    surrounds = (high - low).min(axis=1) < FLAT * sizes  # [S]
    if scene.sensors():
        eye = np.array(scene.sensors()[0].world_transform().translation(), dtype=np.float64).reshape(3)
        surrounds |= ((low < eye) & (eye < high)).all(axis=1)
    kept = len(shapes)
    for k in range(len(shapes) - 1, 0, -1):
        if not surrounds[k]:
            break
        if sizes[k] > SURROUNDING * unions[k - 1]:
            kept = k
    center, radius = (lows[kept - 1] + highs[kept - 1]) / 2, unions[kept - 1] / 2
    if not radius > 0:
        raise DataError(path, "its shapes have no extent", "give --center and --radius, or correct the scene")
    return center, float(radius), len(shapes) - kept


def _corner(shape: Any, end: str) -> np.ndarray:
    """The corner ``min`` or ``max`` of a shape's bounding box, float64 [3]."""
    return np.array(getattr(shape.bbox(), end), dtype=np.float64).reshape(3)
