"""What a camera sees otherwise than light does, as Cycles has it.

It looks through what is *unseen*. A *holdout* cuts a hole into the picture: it hides what is behind it, and shows
neither itself nor a background. Both cast shadows, and show in mirrors, as everything else does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.device_camera import DeviceCamera
from ..engine.dimmed import dimmed
from ..engine.options import RasterOptions
from ..engine.rasterize import Frame, rasterize
from ..scene.row_groups import CURVATURES, SH, SLOPES
from ..scene.sh_basis import C0
from .drawn import Drawn
from .surfaces import Surfaces, emits

NO_OPACITY = -100.0  # as a logit: far below what is drawn
CHANNEL = "holdout.Y"  # share of a pixel that holdouts cover


@dataclass(frozen=True)
class SplatMasks:
    """Which primitives are unseen, and which are holdouts, [N]; what is both is a holdout. holds: whether there are
    holdouts, which take a pass of their own."""

    unseen: mi.Bool
    holdout: mi.Bool
    holds: bool

    def shown(self, params: dict, linear: bool) -> dict:
        """Parameters of the primitives as the camera sees them: holdouts are black."""
        params = dimmed(params, [dr.select(self.holdout, mi.Float(0), 1)] * 3, linear)
        dropped = self.unseen & ~self.holdout
        return params | {"logit_opacities": dr.select(dropped, NO_OPACITY, params["logit_opacities"])}

    def hole(self, shown: dict, camera: DeviceCamera, options: RasterOptions, stop: mi.Float | None) -> mi.Float:
        """Share of each pixel that holdouts cover, [H*W], of what ``shown`` returns; ``stop`` as in ``rasterize``."""
        if not self.holds:
            return dr.zeros(mi.Float, camera.width * camera.height)
        of_colors = {name for group in (SLOPES, CURVATURES, *SH.values()) for name in (group.index, *group.names)}
        of_colors |= {SLOPES.row, CURVATURES.row}
        white = dr.select(self.holdout, 0.5 / C0, -0.5 / C0)
        params = {name: value for name, value in shown.items() if name not in of_colors}
        params["sh_coeffs"] = dr.ravel(mi.Vector3f(white))  # pyright: ignore[reportArgumentType]
        plain = replace(options, sh_degree=0, depth=False, normal=False)
        return rasterize(params, camera, plain, stop_depth=stop).colors[0]


@dataclass(frozen=True)
class CameraMasks:
    """Of a scene: its primitives (None: all are seen), and of surfaces what is told of a
    ``mi.PreliminaryIntersection3f``; none is both. lamps: the emitters that a camera passes which sees none of them."""

    splats: SplatMasks | None
    unseen: Callable[[Any], mi.Bool]
    holdout: Callable[[Any], mi.Bool]
    lamps: Callable[[Any], mi.Bool] = emits

    def passed(self, also: Callable[[Any], mi.Bool] | None) -> Callable[[Any], mi.Bool]:
        """What rays of the camera pass, as ``surfaces.meet`` asks: what is unseen, and what they pass without masks."""
        if also is None:
            return self.unseen
        return lambda meeting: (self.unseen(meeting) | also(meeting)) & ~self.holdout(meeting)

    def frame(self, drawn: Drawn, seen: Surfaces | None) -> Frame:
        """The splats of a pass in front of its surfaces, as the camera sees them; nothing passes holdouts, whose share
        becomes ``drawn.hole``."""
        params, camera, stop = drawn.params, drawn.view_pass.camera, seen.depth if seen else None
        hole = mi.Float(0)
        if self.splats:
            params = self.splats.shown(params, drawn.linear)
            hole = self.splats.hole(params, camera, drawn.options, stop)
        frame = rasterize(params, camera, drawn.options, stop_depth=stop)
        if seen:
            held = seen.hit & self.holdout(seen.meeting)
            hole += dr.select(held, frame.T, 0)
            frame.T = dr.select(held, 0, frame.T)
        drawn.hole = hole + dr.zeros(mi.Float, dr.width(frame.T))
        return frame
