"""The work-precision curves: a knob of the engine each, whose points trade error for run time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..engine.device_camera import DeviceCamera
from ..engine.geometry import SMOOTH, Cutoffs
from ..engine.options import RasterOptions
from ..engine.parameters import upload
from ..scene.splats import Splats
from ..scores.score import ScoreRule
from ..scores.training_views import TrainingViews
from .scenes import Scene

ALPHA = {"1/64": 1 / 64, "1/128": 1 / 128, "1/255": 1 / 255, "1/512": 1 / 512, "1/1024": 2**-10, "1/4096": 2**-12,
         "2^-20": 2**-20}  # fmt: skip
TRANSMITTANCE = {"1e-1": 1e-1, "1e-2": 1e-2, "1e-3": 1e-3, "1e-4": 1e-4, "1e-5": 1e-5, "1e-6": 1e-6, "0": 0.0}
BOUND = {"16": 16.0, "4": 4.0, "2": 2.0, "1": 1.0, "1/4": 1 / 4, "1/16": 1 / 16}
PATCH = {"1 x 1": 1, "2 x 2": 2, "4 x 4": 4}
KEPT = {"100 %": 1.0, "75 %": 0.75, "50 %": 0.5, "25 %": 0.25, "10 %": 0.1, "5 %": 0.05}
GROUPS = ("alpha cutoff", "transmittance cutoff", "bound", "exponentials", "primitives kept", "SH degree", "DoG",
          "slopes", "curvatures", "cuts", "second cuts", "shifts")  # fmt: skip

LEAVE_ONE_OUT = ScoreRule("leave-one-out", spectral_weight=0.0)


@dataclass(frozen=True, eq=False)
class Subset:
    """Some primitives of a scene, or all, on the host and on the device."""

    splats: Splats
    kept: np.ndarray  # [N'] their rows in the model of the scene
    params: dict

    @staticmethod
    def of(splats: Splats, kept: np.ndarray) -> Subset:
        return Subset(splats, kept, upload(splats))


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a curve: the knob, where it stands, and what the engine is given."""

    group: str
    label: str
    options: RasterOptions
    subset: Subset

    @property
    def key(self) -> tuple[RasterOptions, int]:
        """Equal for points that are the same setting: the default is on every curve."""
        return self.options, id(self.subset)


def points_of(scene: Scene) -> list[Point]:
    """All points of all curves, curve by curve, from coarse to fine; first, in no group, the default and no cutoffs.

    The primitives kept are those with the largest leave-one-out score in this very view (``score.py``).
    """
    splats, cutoffs = scene.splats, Cutoffs()
    default = RasterOptions(sh_degree=splats.sh_degree, antialiased=scene.antialiased)
    whole = Subset.of(splats, np.arange(splats.n_splats))
    camera = DeviceCamera.upload(scene.camera, scene.near_clip)
    view = TrainingViews([camera], default, scene.background)
    order = np.argsort(-LEAVE_ONE_OUT(whole.params, view, seed=0), kind="stable")

    def best(share: float) -> Subset:
        rows = np.sort(order[: max(1, round(share * splats.n_splats))])
        return whole if share == 1 else Subset.of(splats.select(rows), rows)

    def points() -> Iterator[Point]:
        for group, field, values in (
            ("alpha cutoff", "alpha", ALPHA),
            ("transmittance cutoff", "transmittance", TRANSMITTANCE),
            ("bound", "bound", BOUND),
        ):
            for label, value in values.items():
                yield Point(group, label, replace(default, cutoffs=replace(cutoffs, **{field: value})), whole)
        for label, value in PATCH.items():
            yield Point("exponentials", label, replace(default, patch=value), whole)
        for label, value in reversed(KEPT.items()):
            yield Point("primitives kept", label, default, best(value))
        for degree in range(splats.sh_degree + 1) if splats.sh_degree else ():
            yield Point("SH degree", f"degree {degree}", replace(default, sh_degree=degree), whole)
        for kind, number, without in (
            ("DoG", splats.n_dog, splats.plain),
            ("slopes", splats.n_slopes, splats.without_slopes),
            ("curvatures", splats.n_curvatures, splats.without_curvatures),
            ("cuts", splats.n_cuts, splats.without_cuts),
            ("second cuts", splats.n_second_cuts, splats.without_second_cuts),
            ("shifts", splats.n_shifts, splats.without_shifts),
        ):
            if number:
                yield Point(kind, f"without {kind}", default, Subset.of(without(), whole.kept))
                yield Point(kind, f"with {kind}", default, whole)

    exact = replace(default, cutoffs=SMOOTH)
    return [Point("", "default", default, whole), Point("", "no cutoffs", exact, whole), *points()]
