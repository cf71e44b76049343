"""A stage of OpenUSD to be looked at: opened without a word on the terminal, its layers, axes, units and places."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..scene.splats import Array
from ..support.errors import DAMAGED, DataError
from ..support.wording import printable
from .usd_files import named_by_content, reason, require_package, require_sound

if TYPE_CHECKING:
    from pxr import Usd, UsdGeom

TURNS = {  # what is right, up and back in a stage, from its own axes, by what is up in it
    "Y": np.eye(4),
    "Z": np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
}
NAMED = 200  # characters of a line about what is not there


@contextmanager
def opened(path: Path) -> Iterator[Usd.Stage]:
    """The stage of a file. Raises ``DataError`` for what the library cannot read, in this or while it is looked at."""
    require_package(path)
    from pxr import Usd

    with looked_at(path):
        require_sound(path)
        with named_by_content(path) as named:
            stage = Usd.Stage.Open(os.path.abspath(named))
            for layer in stage.GetUsedLayers():  # the library keeps those that anybody has open, as they were then
                if not layer.dirty:
                    layer.Reload()
            yield stage


@contextmanager
def looked_at(path: Path) -> Iterator[None]:
    """While the stage of a file is looked at: the library prints nothing, and what is wrong becomes ``DataError``."""
    from pxr import Tf, UsdUtils

    unheard = UsdUtils.CoalescingDiagnosticDelegate()  # what the library would print
    try:
        yield
    except DataError:
        raise
    except Tf.ErrorException as error:
        raise DataError(path, f"cannot be read as OpenUSD ({reason(error)})", DAMAGED) from error
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "check the path and its permissions") from error
    except (ValueError, TypeError, LookupError, OverflowError) as error:
        problem = f"is not OpenUSD that can be used ({error})"
        raise DataError(path, problem, "correct that, or copy or export the file again") from error
    finally:
        del unheard


def layers_of(stage: Usd.Stage) -> list[Path]:
    """The files that a stage is made of; of what lies in a package the package."""
    from pxr import Ar

    paths = (layer.realPath for layer in stage.GetUsedLayers())
    inside = Ar.IsPackageRelativePath
    files = (Ar.SplitPackageRelativePathOuter(path)[0] if inside(path) else path for path in paths)
    return list(dict.fromkeys(Path(file) for file in files if file))


def missing(stage: Usd.Stage) -> list[str]:
    """A line about the first thing that a stage names and that cannot be found or read; none where all is there."""
    broken = stage.GetCompositionErrors()[:1]
    return [f"what cannot be found or read: {printable(' '.join(str(error).split()))[:NAMED]}" for error in broken]


def upright(stage: Usd.Stage) -> Array:
    """The matrix [4, 4] from the axes of a stage to x right, y up, z back. Raises ``ValueError``."""
    from pxr import UsdGeom

    axis = str(UsdGeom.GetStageUpAxis(stage))
    if axis not in TURNS:
        raise ValueError(f"its upAxis is {axis}, neither Y nor Z")
    return TURNS[axis]


def metres_of(stage: Usd.Stage) -> float | None:
    """Metres of a unit, where a stage says so and says more than that a unit is a metre. Raises ``ValueError``."""
    from pxr import UsdGeom

    metres = UsdGeom.GetStageMetersPerUnit(stage) if UsdGeom.StageHasAuthoredMetersPerUnit(stage) else 1.0
    if not 0 < metres < math.inf:
        raise ValueError(f"its metersPerUnit is {metres:g}, not above zero and finite")
    return None if metres == 1.0 else metres


def world_of(prim: Usd.Prim, cache: UsdGeom.XformCache) -> Array:
    """The matrix [4, 4] from the axes of a prim to those of its stage, for columns."""
    from pxr import UsdGeom

    matrix = cache.GetLocalToWorldTransform(prim)
    if not prim.IsA(UsdGeom.Xformable):  # a library that does not know the type takes what is above it alone
        matrix = UsdGeom.Xformable(prim).GetLocalTransformation(cache.GetTime()) * matrix
    return np.array(matrix).T


def moments_of(prim: Usd.Prim) -> set[float]:
    """The time codes at which somebody has said where a prim is; between them the library interpolates."""
    from pxr import UsdGeom

    times: set[float] = set()
    while prim and not prim.IsPseudoRoot():
        hung = UsdGeom.Xformable(prim)
        times |= set(hung.GetTimeSamples() if hung else ())
        if hung and hung.GetResetXformStack():  # what is above it does not move it
            break
        prim = prim.GetParent()
    return times
