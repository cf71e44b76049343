"""``dogsplat info`` of a model: counts, ranges, and what is wrong with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..formats.read import format_of, read_model, size_of
from ..formats.sizes import FileKind, by_part
from ..render.framing import CORE, robust_sphere
from ..scene.drawing import drawn_as
from ..scene.kinds import kinds_of
from ..scene.sh_basis import C0
from ..scene.splats import Splats
from ..support.wording import count, file_size
from .lines import drawn, line, problem_lines, sh_degrees

UNIT_TOLERANCE = 1e-2  # of a quaternion's length
TINY, HUGE = 1e-6, 1.0  # scales, in units of the model's robust radius
INVISIBLE = 1 / 255  # opacity; a primitive below it never changes an 8-bit pixel by itself
FAR = 100.0  # robust radii from the centre
GLARING = 1e6  # colour, in units of white: a picture of the sun has 1e5


def describe_model(path: Path) -> list[str]:
    """Counts, ranges and problems of a model."""
    model = read_model(path)
    splats = model.splats
    size = size_of(path)
    n = splats.n_splats
    lines = [
        f"{path}: model",
        line("format", format_of(path).name),
        line("primitives", f"{count(n)}, {kinds_of(splats)}"),
        line("SH degree", sh_degrees(splats)),
        line("size", file_size(size) + (f", {size / n:.0f} bytes per primitive" if n else "")),
    ]
    if splats.mixed_sh:
        parts = (f"{name} {file_size(part)}" for name, part in by_part(FileKind("ply", model.drawing), splats).items())
        lines.append(line("bytes of", ", ".join(parts)))
    lines += [line("drawn", drawn(model.drawing))] if model.drawing.said() else []
    lines += [line("not read", text) for text in model.left_out]
    if n:
        centre, radius = robust_sphere(splats)
        lines.append(line("centre, radius", f"({_numbers(centre)}), {radius:.4g}: the median; {CORE:.0%} lie within"))
        lines += [line(f"position {axis}", _range(splats.means[:, i])) for i, axis in enumerate("xyz")]
        lines += [line("scale", _range(splats.scales)), line("opacity", _range(splats.opacities))]
        lines.append(line("colour", _range(0.5 + C0 * splats.sh_coeffs[:, 0].astype(np.float64))))
    of_some = {
        "DoG opacity": splats.dog_opacities,
        "DoG scale": splats.dog_scales,
        "slopes": splats.color_slopes,
        "curvatures": splats.brightness_curvatures,
        "cut normals": np.linalg.norm(splats.cut_normals, axis=1),
        "second normals": np.linalg.norm(splats.second_cut_normals, axis=1),
        "shifts": splats.view_shifts,
    }
    lines += [line(name, _range(values)) for name, values in of_some.items() if len(values)]
    return lines + problem_lines(model_problems(splats, drawn_as(model.drawing).white))


def model_problems(splats: Splats, white: float = 1.0) -> list[str]:
    """One sentence per kind of primitive that is broken, wasted, or shown otherwise by other programs.

    ``white``: what is white among its colours.
    """
    if splats.n_splats == 0:
        return ["there is no primitive: every picture of this model is empty"]
    centre, radius = robust_sphere(splats)
    lengths = np.linalg.norm(splats.quats.astype(np.float64), axis=1)  # [N]
    scales = splats.scales  # [N, 3]
    distances = np.linalg.norm(splats.means - centre, axis=1)  # [N]
    brightest = C0 * np.maximum(splats.sh_coeffs.max(axis=(1, 2)), -splats.sh_coeffs.min(axis=(1, 2)))  # [N]
    kinds = [
        (lengths == 0, "a quaternion of length zero, and so no orientation"),
        (
            (abs(lengths - 1) > UNIT_TOLERANCE) & (lengths > 0),
            "a quaternion that is not of unit length: harmless here, but some programs do not normalise",
        ),
        (scales.min(axis=1) < TINY * radius, f"a scale below {TINY * radius:.2g}, a millionth of the radius"),
        (scales.max(axis=1) > HUGE * radius, f"a scale above {HUGE * radius:.2g}, the radius of the model"),
        (splats.opacities < INVISIBLE, "an opacity below 1/255: they cost time and are hardly seen"),
        (distances > FAR * radius, f"a position more than {FAR:.0f} radii from the centre"),
        (brightest > GLARING * white, f"a colour more than {GLARING:,.0f} times as bright as white"),
    ]
    found = ((int(np.sum(which)), text) for which, text in kinds)
    return [f"{count(k)} of {count(splats.n_splats)} have {text}" for k, text in found if k]


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _range(values: np.ndarray) -> str:
    return f"{values.min():.4g} to {values.max():.4g}, median {np.median(values):.4g}"
