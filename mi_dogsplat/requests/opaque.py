"""Numbers of a scene that kernels read and do not hold: a lamp moves and a lens focuses without a compiler."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi


def make_opaque(scene: mi.Scene) -> None:
    """Make the numbers of sensors and emitters opaque. Kernels that held them would be compiled for each frame.

    Mitsuba does so itself for most. It leaves out where a rectangle is, aperture and focus of a thin lens, and the
    scale of an environment map. The values stay the same, so nothing that follows from them has to be made again.
    """
    lamps = [shape for shape in scene.shapes() if shape.is_emitter()]
    for part in (*scene.sensors(), *lamps, *scene.emitters()):
        params: Any = mi.traverse(part)
        dr.make_opaque([params[name] for name in params.keys()])
