"""Scenes drawn at random, all features together, through `mi.render`: pictures and gradients of the float64 twin.

Other tests look at one feature, or at pairs. Here is what they do to each other, the sensor's part included.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Splats
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.scene.cameras import Camera
from read_together import read_gradients
from splat_scenes import random_splats, rounded, scene_of, square_camera

SHARES = [f"{rows}_share" for rows in ("dog", "slope", "curvature", "cut", "second_cut", "shift")]
NEAR_A_CUTOFF = 2e-4  # of the threshold: where α may fall on its other side by rounding


@dataclass
class Drawn:
    """A model, a camera and choices, with what the twin makes of them."""

    splats: Splats
    camera: Camera  # of the whole film
    window: tuple[slice, slice]  # rows and columns of the film that are a picture
    background: np.ndarray
    choices: dict[str, Any]  # which the integrator and the twin both have

    @staticmethod
    def of(seed: int) -> "Drawn":
        rng = np.random.default_rng(seed)
        shares = {share: rng.choice([0, 0.3, 1]) for share in SHARES}
        n, degree, mixed = int(rng.choice([1, 7, 40])), int(rng.integers(4)), rng.random() < 0.3
        splats = rounded(random_splats(n, seed, degree, **shares))
        if mixed:
            splats = splats.with_sh_degrees(rng.integers(0, degree + 1, n))
        width, height = (int(size) for size in rng.integers(2, 50, 2))
        centre = {"cx": width * rng.uniform(0.3, 0.7), "cy": height * rng.uniform(0.3, 0.7)}
        camera = square_camera(width, height, f=rng.uniform(0.5, 2) * max(width, height), **centre)
        (left, right), (top, bottom) = ([*sorted(rng.choice(size + 1, 2, replace=False))] for size in (width, height))
        window = (slice(0, height), slice(0, width))
        if rng.random() < 0.4:
            window = slice(top, bottom), slice(left, right)
        choices = {
            "antialiased": bool(rng.random() < 0.5),
            "negative_transmittance": bool(rng.random() < 0.5),
            "near_clip": float(rng.choice([0.2, 2.5])),
        }
        return Drawn(splats, camera, window, rng.uniform(0, 1, 3) * rng.choice([0, 1]), choices)

    def scene(self) -> tuple[mi.Scene, Any]:
        """With its parameters."""
        rows, columns = self.window
        cropped = {
            "crop_offset_x": int(columns.start), "crop_width": int(columns.stop - columns.start),
            "crop_offset_y": int(rows.start), "crop_height": int(rows.stop - rows.start),
        }  # fmt: skip
        sky = {"type": "constant", "radiance": {"type": "rgb", "value": self.background.tolist()}}
        scene = scene_of(
            self.splats, self.camera, film=cropped, extra={"sky": sky}, srgb_primitives=False, **self.choices
        )
        return scene, mi.traverse(scene)

    def image(self, moved: float = 0.0) -> np.ndarray:
        """[h, w, 3] of the window, by the twin, with cutoffs that are stricter by a share of ``moved``."""
        whole = render_tiled(self.splats, self.camera, self.background, moved=moved, **self.choices)
        return whole.image[self.window]

    def away_from_cutoffs(self) -> np.ndarray:
        """[h, w, 1] the pixels in which rounding decides nothing."""
        image, sides = self.image(), [self.image(moved) for moved in (-NEAR_A_CUTOFF, NEAR_A_CUTOFF)]
        return np.all([np.abs(side - image).max(-1, keepdims=True) < 1e-7 for side in sides], axis=0)

    def gradients(self, adjoint: np.ndarray) -> dict[str, np.ndarray]:
        """Of the sum of ``adjoint`` [h, w, 3] times the picture, by the twin."""
        whole = np.zeros((self.camera.height, self.camera.width, 3))
        whole[self.window] = adjoint
        return gradients_tiled(self.splats, self.camera, whole, self.background, **self.choices)


@pytest.mark.parametrize("seed", range(16))
def test_a_random_scene_has_the_picture_and_the_gradients_of_the_twin(seed):
    drawn = Drawn.of(seed)
    scene, params = drawn.scene()
    expected, sure = drawn.image(), drawn.away_from_cutoffs()
    assert sure.mean() > 0.9
    image = mi.render(scene, params).numpy()
    assert image.shape == expected.shape
    np.testing.assert_allclose(image * sure, expected * sure, atol=2e-5 * max(1, np.abs(expected).max()))

    adjoint = np.random.default_rng(seed).normal(size=image.shape) * sure
    expected = drawn.gradients(adjoint)
    arrays = {name: f"splats.{name}" for name in expected if f"splats.{name}" in params}
    assert arrays.keys() == {name for name, values in expected.items() if values.size}
    dr.enable_grad([params[key] for key in arrays.values()])
    params.update()
    dr.backward(dr.sum(mi.render(scene, params) * mi.TensorXf(adjoint.astype(np.float32)), axis=None))
    for name, found in read_gradients(params, arrays, "splats.").items():
        values: Any = expected[name]
        found, atol = found.reshape(values.shape), 2e-3 * max(np.abs(values).max(), 1e-3)
        np.testing.assert_allclose(found, values, atol=atol, err_msg=name)


def test_each_pair_of_features_is_in_one_of_the_scenes():
    having = []
    for seed in range(16):
        drawn = Drawn.of(seed)
        splats, whole = drawn.splats, (slice(0, drawn.camera.height), slice(0, drawn.camera.width))
        having.append({
            "dog": splats.n_dog > 0, "slopes": splats.n_slopes > 0, "curvatures": splats.n_curvatures > 0,
            "cuts": splats.n_cuts > 0, "second cuts": splats.n_second_cuts > 0, "shifts": splats.n_shifts > 0,
            "degrees": len(splats.sh1_index) + len(splats.sh2_index) + len(splats.sh3_index) > 0,
            "window": drawn.window != whole, "sky": drawn.background.any(),
            **{name: drawn.choices[name] for name in ("antialiased", "negative_transmittance")},
        })  # fmt: skip
    missing = [pair for pair in combinations(having[0], 2) if not any(all(scene[f] for f in pair) for scene in having)]
    assert not missing
