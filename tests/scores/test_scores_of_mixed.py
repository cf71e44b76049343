"""Scores, weights and AOVs of models whose primitives have SH degrees of their own: those of the padded model."""

import numpy as np
import pytest
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.view import prepare, prepare_both
from mi_dogsplat.engine.walks.aovs import composite_aovs
from mi_dogsplat.engine.walks.composite import composite_over
from mi_dogsplat.engine.walks.fisher import composite_fisher, patch_blocks
from mi_dogsplat.engine.walks.weights import composite_weights
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.score import ScoreRule
from mi_dogsplat.scores.training_views import TrainingViews
from same_numbers import assert_same_numbers
from splat_scenes import options, random_splats, rounded, tilted_camera

CAMERA = tilted_camera(24, 18, f=20.0)
KINDS = ("released", "leave-one-out", "leave-dog-out")


def models() -> tuple[Splats, Splats]:
    """One and the same, mixed and padded; sRGB values beyond 0..1 among its colours."""
    n = 40
    mixed = rounded(random_splats(n, seed=2)).with_sh_degrees(np.random.default_rng(0).integers(0, 4, n))
    return mixed, mixed.uniform_sh()


def assert_close(a: np.ndarray, b: np.ndarray):
    assert np.ptp(b) > 0
    np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4 * np.abs(b).max())


@pytest.mark.parametrize("rule", [ScoreRule(), *(ScoreRule(kind) for kind in KINDS)], ids=lambda rule: rule.kind)
def test_scores(rule):
    on_device = [DeviceCamera.upload(CAMERA)]
    ours, padded = (rule(upload(s), TrainingViews(on_device, options(s), 0.3), 0) for s in models())
    assert_close(ours, padded)


def rows(columns: list) -> np.ndarray:
    return np.stack([column.numpy().astype(np.float64) for column in columns])


def test_fisher_information():
    def products(splats: Splats) -> np.ndarray:
        pictured, patches = prepare_both(upload(splats), DeviceCamera.upload(CAMERA), options(splats), patch_blocks())
        return rows(composite_fisher(patches, composite_over(pictured, 0.3)))

    ours, padded = (products(splats) for splats in models())
    assert_close(ours, padded)


def test_blending_weights_and_aovs_look_at_no_colour():
    """With the constant colour alone, which asks for no group."""
    def walk(splats: Splats) -> list[np.ndarray]:
        view = prepare(upload(splats), DeviceCamera.upload(CAMERA), RasterOptions(0))
        columns, largest = composite_weights(view, composite_over(view, 0.0)[0])
        return [*rows([*columns, largest]), *rows(composite_aovs(view, ("count",), None))]

    for ours, padded in zip(*(walk(splats) for splats in models()), strict=True):
        assert_same_numbers(ours, padded)
