"""What the work-precision curves are measured on: three clouds made here, of different character, and a given model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..scene.cameras import Camera
from ..scene.kinds import kinds_of
from ..scene.sh_basis import C0
from ..scene.splats import Splats
from ..support.wording import counted

ASPECT = 4 / 3
FOCAL = 1.0  # image widths: 53 degrees from left to right
NEAREST, FARTHEST = 3.0, 7.0  # the clouds lie between these depths and fill the view


@dataclass(frozen=True, eq=False)
class Scene:
    """A model, and how it is looked at."""

    name: str
    what: str  # one line
    splats: Splats
    camera: Camera
    background: float = 0.5  # grey level: not black, so that errors of the transmittance are seen
    near_clip: float = 0.2  # world units
    antialiased: bool = False


def synthetic_scenes(width: int) -> list[Scene]:
    """Three clouds with fixed seeds in pictures of ``width`` pixels: the same clouds at every size."""
    height = round(width / ASPECT)
    camera = Camera(np.eye(4), FOCAL * width, FOCAL * width, width / 2, height / 2, width, height)
    dense = "4,000 mostly opaque primitives: walks end after a few of them"
    faint = "2,000 small primitives of opacity 0.01 to 0.15: no walk ends early, many α lie near the cutoff"
    needles = "3,000 needles with axis ratios to 100, half of them DoG"
    return [
        Scene("dense, opaque", dense, _dense(np.random.default_rng(1)), camera),
        Scene("sparse, faint", faint, _faint(np.random.default_rng(2)), camera),
        Scene("needles and DoG", needles, _needles(np.random.default_rng(3)), camera),
    ]


def model_scene(name: str, splats: Splats, camera: Camera, width: int, **others: Any) -> Scene:
    """A model in a picture of at most ``width`` pixels a side; ``others`` are fields of ``Scene``."""
    scale = min(1.0, width / max(camera.width, camera.height))
    small = camera.resized(max(1, round(scale * camera.width)), max(1, round(scale * camera.height)))
    what = f"{counted(splats.n_splats, 'primitive')}, {kinds_of(splats)}, SH degree {splats.sh_degree}"
    return Scene(name, what, splats, small, **others)


def _dense(rng: np.random.Generator) -> Splats:
    n = 4000
    return _cloud(rng, np.log(0.07) + 0.5 * rng.normal(size=(n, 3)), rng.normal(1.5, 1.5, n))


def _faint(rng: np.random.Generator) -> Splats:
    n = 2000
    return _cloud(rng, np.log(0.05) + 0.5 * rng.normal(size=(n, 3)), _logit(rng.uniform(0.01, 0.15, n)))


def _needles(rng: np.random.Generator) -> Splats:
    n, m = 3000, 1500
    length, ratio = rng.uniform(0.1, 0.5, n), np.exp(rng.uniform(0, np.log(100), n))
    scales = np.stack([length, length / ratio, length / ratio], 1)  # [N, 3]
    dog = {
        "dog_index": np.sort(rng.permutation(n)[:m]),
        "dog_logit_opacities": _logit(rng.uniform(0.2, 0.95, m)),
        "dog_log_scales": rng.normal(0, 0.4, (m, 3)),
    }
    return _cloud(rng, np.log(scales), _logit(rng.uniform(0.1, 0.95, n)), **dog)


def _cloud(rng: np.random.Generator, log_scales: np.ndarray, logits: np.ndarray, **dog: np.ndarray) -> Splats:
    """Primitives all over the view, of random colours (SH degree 3) and orientations."""
    n = len(logits)
    depth = rng.uniform(NEAREST, FARTHEST, n)
    side = rng.uniform(-0.55, 0.55, (n, 2)) * (1, 1 / ASPECT) / FOCAL  # a little beyond the picture, too
    sh_coeffs = 0.1 * rng.normal(size=(n, 16, 3))
    sh_coeffs[:, 0] = (rng.uniform(0, 1, (n, 3)) - 0.5) / C0
    return Splats(
        means=np.column_stack([side * depth[:, None], depth]),
        log_scales=log_scales,
        quats=rng.normal(size=(n, 4)),
        logit_opacities=logits,
        sh_coeffs=sh_coeffs,
        **dog,
    )


def _logit(p: np.ndarray) -> np.ndarray:
    return np.log(p) - np.log1p(-p)
