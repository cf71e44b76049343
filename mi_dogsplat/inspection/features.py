"""What a model or a scene needs of the kernels, what that costs, and what was left out.

Kernels are specialised while they are traced: what is left out has no instruction, no byte and no parameter in them
(``tests/engine/test_lean.py`` shows it). Operations are counted in the kernels of this machine (``kernel_costs.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..engine.geometry import Cutoffs
from ..engine.kernel_costs import aov_operations, operations, pair_operations, primitive_operations
from ..engine.options import RasterOptions, Settings
from ..engine.walks.aovs import WALKED, walked
from ..plugin.transfer import srgb_to_linear
from ..scene.row_groups import CURVATURES, CUTS, DOG, SECOND_CUTS, SHIFTS, SLOPES, RowGroup
from ..scene.splats import MAX_SH_DEGREE, Splats
from ..support.errors import DataError
from ..support.scene_errors import scene_error
from ..support.scene_loading import load_file
from ..support.wording import count, counted, file_size
from .unneeded import Unneeded, largest_alphas, used_sh_degrees

NEEDED, LEFT_OUT, UNUSED = "needed", "left out", "paid, not needed"
PARAMETERS = 14  # of a Gaussian: centre 3, scales 3, quaternion 4, opacity, colour 3
FLOAT = 4  # bytes, of an index too
CLEAN = "dogsplat clean takes them out"


@dataclass(frozen=True)
class Feature:
    """A line of the list: whether the kernels have it, why, and what it costs there."""

    name: str
    state: str
    reason: str

    def __str__(self) -> str:
        return f"  {self.name:26s}{self.state}: {self.reason}"


def feature(name: str, needed: bool, reason: str, otherwise: str) -> Feature:
    """``needed`` for a reason, or left out for another."""
    return Feature(name, NEEDED, reason) if needed else Feature(name, LEFT_OUT, otherwise)


def model_features(parts: list[Splats], negative_transmittance: bool = True) -> list[Feature]:
    """What primitives need, of one model or of several that are rendered as one."""
    n, variant = sum(s.n_splats for s in parts), mi.variant()
    operations_each = primitive_operations(RasterOptions(0), variant)
    pair = pair_operations(Settings(3), False, variant)
    cost = f"each {_size(PARAMETERS)}, {operations_each:.0f} operations; per pixel {_sum(pair)}"
    gaussians = Feature("Gaussians", NEEDED, f"{counted(n, 'primitive')}; {cost}")
    features = [gaussians, *_dog_features(parts, negative_transmittance)]
    features += _row_features(parts, "slopes", SLOPES, "slopes", (0, 1), "slopes")
    features += _row_features(parts, "curvatures", CURVATURES, "curvatures", (0, 1), "curvatures")
    features += _row_features(parts, "cuts", CUTS, "cuts", (0, 1), "normals")
    features += _row_features(parts, "second cuts", SECOND_CUTS, "cuts", (1, 2), "normals")
    features += [_shift_feature(parts), *_sh_features(parts)]
    return features + [Feature(name, UNUSED, f"{rest}; {CLEAN}") for name, rest in _unneeded_rows(parts)]


def _dog_features(parts: list[Splats], negative_transmittance: bool) -> list[Feature]:
    n, m = sum(s.n_splats for s in parts), sum(s.n_dog for s in parts)
    share, variant = f"{count(m)} of {counted(n, 'primitive')}", mi.variant()
    if m == 0:
        return [Feature("DoG", LEFT_OUT, share), Feature("negative T", LEFT_OUT, "there is no DoG primitive")]
    settings = Settings(3, negative_transmittance=negative_transmittance)
    more = _difference(pair_operations(settings, True, variant), pair_operations(Settings(3), False, variant))
    each = [primitive_operations(RasterOptions(0), variant, *groups) for groups in ((DOG,), ())]
    cost = f"each {_size(DOG.row_size, indices=1)}, {each[0] - each[1]:.0f} operations; per pixel {_sum(more)}"
    faded = sum(int(np.sum(s.dog_opacities * largest_alphas(s)[s.dog_index] < Cutoffs().alpha)) for s in parts)
    features = [Feature("DoG", NEEDED, f"{share}; {cost}; and {FLOAT} bytes for its row in each of {count(n)}")]
    if m < n:
        plain = counted(n - m, "plain primitive")
        rest = f"{plain}, drawn with a kernel of zeros behind the same branch"
        features.append(Feature("branch to DoG", UNUSED, rest))
    if faded:
        features.append(Feature("faded DoG", UNUSED, f"{counted(faded, 'pseudo-Gaussian')} below 1/255 everywhere"))
    amplifies = "where a weight is negative, what lies behind is amplified"
    return [*features, feature("negative T", negative_transmittance, amplifies, "negative_transmittance is false")]


def _row_features(
    parts: list[Splats], name: str, group: RowGroup, setting: str, values: tuple[int, int], zeros: str
) -> list[Feature]:
    """Of rows that some primitives have over their whole extent: slopes, curvatures, cuts or second cuts.

    Args:
        setting, values: what the kernels are specialised to without them and with them.
        zeros: what the rest is drawn with.
    """
    held = f"n_{name.replace(' ', '_')}"
    n, m = sum(part.n_splats for part in parts), sum(getattr(part, held) for part in parts)
    share, variant = f"{count(m)} of {counted(n, 'primitive')}", mi.variant()
    if m == 0:
        return [Feature(name, LEFT_OUT, share)]
    without, with_them = (pair_operations(replace(Settings(3), **{setting: v}), False, variant) for v in values)
    pair = _sum(_difference(with_them, without))
    before = (CUTS,) if group is SECOND_CUTS else ()
    each = [primitive_operations(RasterOptions(0), variant, *groups) for groups in (before, (*before, group))]
    cost = f"each {_size(group.row_size, indices=1)}, {each[1] - each[0]:.0f} operations; per pixel {pair}"
    features = [Feature(name, NEEDED, f"{share}; {cost}; and {FLOAT} bytes for its row in each of {count(n)}")]
    if m < n:
        rest = f"{counted(n - m, 'primitive')} without, drawn with {zeros} of zero: as many operations"
        features.append(Feature(f"{name} of others", UNUSED, rest))
    return features


def _shift_feature(parts: list[Splats]) -> Feature:
    """Places that depend on the view are found once for each primitive: pixels know nothing of them."""
    n, m = sum(s.n_splats for s in parts), sum(s.n_shifts for s in parts)
    share = f"{count(m)} of {counted(n, 'primitive')}"
    if m == 0:
        return Feature("shifts", LEFT_OUT, share)
    each = [primitive_operations(RasterOptions(0), mi.variant(), *groups) for groups in ((SHIFTS,), ())]
    cost = f"each {_size(SHIFTS.row_size, indices=1)}, {each[0] - each[1]:.0f} operations"
    return Feature("shifts", NEEDED, f"{share}; {cost}; and {FLOAT} bytes for its row in each of {count(n)}")


def _sh_features(parts: list[Splats]) -> list[Feature]:
    stored, used = np.hstack([(s.sh_degrees, used_sh_degrees(s)) for s in parts])  # [N] degree of each primitive
    pays = any(Unneeded.of(part).saved_by_mixing > 0 for part in parts)
    features = []
    for degree in range(1, MAX_SH_DEGREE + 1):
        if degree > stored.max(initial=0):
            reason = f"the model has degree {stored.max(initial=0)}"
            features.append(Feature(f"SH degree {degree}", LEFT_OUT, reason))
            continue
        with_it, without = (primitive_operations(RasterOptions(d), mi.variant()) for d in (degree, degree - 1))
        cost = f"each {_size(3 * (2 * degree + 1))}, {with_it - without:.0f} operations"
        zeros = int(((stored >= degree) & (used < degree)).sum())
        zero, wasted = "", file_size(FLOAT * 3 * (2 * degree + 1) * zeros)
        if degree > used.max(initial=0):
            zero = f"all of its coefficients are zero, {wasted}; {CLEAN}; "
        elif zeros:
            cost += f"; zero in {counted(zeros, 'primitive')}, {wasted}"
            cost += ": dogsplat clean --mixed-sh takes them out" if pays else ", less than SH degrees of their own take"
        having = int((stored >= degree).sum())
        share = f"{count(having)} of {counted(len(stored), 'primitive')}; " if any(s.mixed_sh for s in parts) else ""
        features.append(Feature(f"SH degree {degree}", UNUSED if zero else NEEDED, zero + share + cost))
    return features


def choices_of_a_render() -> list[Feature]:
    """What no model asks for by itself."""
    return [
        Feature("background", LEFT_OUT, "black, unless --background or an emitter of the scene asks for another"),
        Feature("antialiasing", LEFT_OUT, "unless its file or --antialiased asks for it"),
        Feature("depth", LEFT_OUT, "unless an .exr or the aovs of a scene ask for it"),
        Feature("other AOVs", LEFT_OUT, "unless --aovs or the aovs of a scene ask for them"),
        DERIVATIVES,
    ]


DERIVATIVES = Feature("derivatives", LEFT_OUT, "unless a parameter is attached: kernels of their own, compiled then")


def scene_features(scene: mi.Scene) -> list[Feature]:
    """What a Mitsuba scene with the integrator ``dogsplat`` or ``dogpath`` needs; of its first sensor."""
    from ..shape_dog import DogShape  # of the active variant

    integrator: Any = scene.integrator()  # to the stubs of Mitsuba any integrator is just that
    variant = mi.variant()
    drawn = integrator.drawn_as(scene)
    parts = [shape.to_splats() for shape in scene.shapes() if isinstance(shape, DogShape)]
    features = model_features(parts, integrator.negative_transmittance)

    features.append(feature("several dog shapes", len(parts) > 1, _joining(parts), "there is one"))
    environment = scene.environment()
    name = environment.class_name() if environment is not None else ""
    behind = f"the emitter {name}, evaluated at every pixel in every render"
    shown, absent = bool(name) and not integrator.hide_emitters, "the scene has no constant or environment emitter"
    features.append(feature("background", shown, behind, "hide_emitters is true" if name else absent))

    others = len(scene.shapes()) - len(parts)
    shown = integrator.name == "dogpath" or integrator.nested is not None
    traced = f"{counted(others, 'other shape')}; traced in every pass, and primitives are compared with their depth"
    if integrator.name == "dogpath":
        traced += "; light paths behind them, and a tree over the primitives for these"
    alone = "no nested integrator renders the other shapes" if others else "there is no other shape"
    features.append(feature("surfaces", shown and others > 0, traced, alone))

    pixel = mi.Float([0.2, 0.4])
    per_pixel = operations(lambda: np.array(srgb_to_linear([pixel] * 3))) / 2
    conversion = f"srgb_primitives; {per_pixel:.0f} operations per pixel of the image"
    features.append(feature("sRGB conversion", not drawn.linear, conversion, "srgb_primitives is false"))

    each = [primitive_operations(RasterOptions(0, antialiased=on), variant) for on in (True, False)]
    filtering = f"antialiased; each {each[0] - each[1]:.0f} operations"
    features.append(feature("antialiasing", drawn.antialiased, filtering, "antialiased is false"))

    for name, planes in (("depth", 1), ("normal", 3)):
        more = _difference(*(pair_operations(Settings(n), False, variant) for n in (3 + planes, 3)))
        blended = f"among the aovs; per pixel {_sum(more, 1)}"
        features.append(feature(name, name in integrator.aovs, blended, "not among the aovs"))
    has_dog = any(s.n_dog for s in parts)
    names = walked(integrator.aovs, has_dog)
    each = aov_operations(names, has_dog, variant) if names else 0
    walk = f"for {', '.join(names)}; per pixel {each:.0f}, no derivative"
    features.append(feature("second walk", bool(names), walk, f"for {', '.join(WALKED)}: not among the aovs"))
    in_film = bool(scene.sensors()) and mi.has_flag(scene.sensors()[0].film().flags(), mi.FilmFlags.Alpha)
    asked = "the aovs" if "alpha" in integrator.aovs else "the film"
    alpha = f"{asked} ask for it; one operation per pixel of the image"
    asks = "alpha" in integrator.aovs or in_film
    features.append(feature("alpha", asks, alpha, "neither the aovs nor the film ask for it"))
    return [*features, DERIVATIVES]


def _joining(parts: list[Splats]) -> str:
    degree = max(s.sh_degree for s in parts)
    padded = sum(s.n_splats for s in parts if s.sh_degree < degree)
    size = FLOAT * (PARAMETERS + 3 * ((degree + 1) ** 2 - 1))
    padding = f", {count(padded)} of them padded to SH degree {degree}" if padded else ""
    return f"{len(parts)}; joined in every render, which copies {size} bytes of each primitive{padding}"


def splat_scene(path: Path) -> mi.Scene | None:
    """The Mitsuba scene at ``path`` if it is one of ``dog`` shapes and the integrator ``dogsplat`` or ``dogpath``."""
    from ..plugin.splat_integrator import SplatIntegrator  # of the active variant
    from ..shape_dog import DogShape

    if path.suffix != ".xml":
        return None
    try:
        scene = load_file(path)
    except DataError:
        raise
    except Exception as error:  # Mitsuba raises several kinds, all of them with a message to show
        raise scene_error(path, error, "Mitsuba cannot load it") from error
    if not isinstance(scene, mi.Scene) or not isinstance(scene.integrator(), SplatIntegrator):
        return None
    return scene if any(isinstance(shape, DogShape) for shape in scene.shapes()) else None


def _unneeded_rows(parts: list[Splats]) -> list[tuple[str, str]]:
    """Names of primitives and DoG rows that no picture shows, and how many there are and take how many bytes."""
    found = [line.partition(": ") for s in parts for line in Unneeded.of(s).described(s)]
    return [(name, rest) for name, _, rest in found if not name.startswith("zero")]  # bands are lines of their own


def _size(parameters: int, indices: int = 0) -> str:
    return f"{parameters} parameters, {FLOAT * (parameters + indices)} bytes"


def _difference(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return a[0] - b[0], a[1] - b[1]


def _sum(passes: tuple[float, float], digits: int = 0) -> str:
    return f"{passes[0]:.{digits}f} + {passes[1]:.{digits}f}"
