"""Numbers of a scene that kernels read and do not hold: a lamp moves and a lens focuses without a compiler."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi


def make_opaque(scene: mi.Scene) -> None:
    """Of sensors and emitters; Mitsuba does so itself for most, and leaves out where a rectangle is, what a thin lens
    is like, and how bright a picture of the environment is. Kernels that held them would be compiled for each frame of
    an animation. The values are the same, so nothing made of them has to be made again."""
    lamps = [shape for shape in scene.shapes() if shape.is_emitter()]
    for part in (*scene.sensors(), *lamps, *scene.emitters()):
        params: Any = mi.traverse(part)
        dr.make_opaque([params[name] for name in params.keys()])
