"""Light paths between surfaces, every segment of which gathers the splats that it passes.

Notation (Vicini et al. 2021, path replay; Veach 1997, multiple importance sampling)
    β           throughput of a path up to its vertex
    S, T        of a segment: radiance that splats send along it, and what they let pass of that behind
    L           radiance that a path brings; in a replay what of it is still to come
    δL          derivative of the radiance, or of the loss with respect to it

A path is traced vertex by vertex, with all lanes that are still on their way in one wavefront: those that have ended
leave it. Random numbers belong to a pixel and a vertex, so that a replay has the same ones, and so do two renders of
which parameters differ a little.

Both strategies, sampling of emitters and of BSDFs, find a light behind splats weakened by the same T; the weights that
combine them do not know it. Splats that emit are found by BSDF sampling alone, with the weight 1.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import mis_weight

from .transfer import emitted

RR_MAX = 0.95  # probability to go on that Russian roulette gives at most, as in Mitsuba's own integrators
STREAM = 0x9E3779B9  # seeds of neighbouring vertices are far apart


@dataclass
class Limits:
    """When paths end: after ``max_depth`` segments (None: never), by Russian roulette from ``rr_depth`` on."""

    max_depth: int | None
    rr_depth: int
    hide_environment: bool  # from the camera


@dataclass
class Lanes:
    """Paths on their way: each has sampled the direction of its next segment, or comes from the camera."""

    pixel: Any  # of the wavefront that began
    origin: Any  # of the segment
    direction: Any
    β: Any
    η: Any  # product of relative indices of refraction
    L: Any  # that is still to come; in a replay only
    pdf: Any  # of the direction, of BSDF sampling
    delta: Any  # whether only BSDF sampling finds what lies in this direction
    at: Any  # vertex where the segment begins, and its normal
    normal: Any

    def select(self, index: Any) -> Lanes:
        """Some of them."""
        dr.eval(vars(self))
        return Lanes(**{f.name: dr.gather(type(v := getattr(self, f.name)), v, index) for f in fields(self)})


@dataclass
class Replay:
    """What a derivative pass knows, and finds."""

    mode: dr.ADMode
    L: Any  # of the primal pass
    δL: Any  # backward: of the loss with respect to L; forward: what comes out
