"""The error that is usual at each place of a model, against its definition in float64."""

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.masking.usual import in_grey, usual_errors
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.render.picture import picture_of
from mi_dogsplat.scene.drawing import DrawnAs
from splat_scenes import make_camera, random_splats, rounded, tilted_camera

CAMERAS = [tilted_camera(45, 37), make_camera(20, 33, f=25.0)]


def maps(seed: int):
    """Errors and counts of the views, random."""
    rng = np.random.default_rng(seed)
    shapes = [(camera.height, camera.width) for camera in CAMERAS]
    errors = [rng.uniform(0, 0.5, shape).astype(np.float32) for shape in shapes]
    return errors, [rng.random(shape) < 0.8 for shape in shapes]


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("dog_share", [0, 0.5], ids=["plain", "DoG"])
def test_it_is_the_mean_over_what_a_primitive_is_seen_in(dog_share, antialiased):
    splats = rounded(random_splats(60, 4, 1, dog_share, 0, 0.5, 0.5))
    errors, counts = maps(0)
    blended = [reference_score.weights(splats, camera, antialiased=antialiased) for camera in CAMERAS]
    seen = sum((w * c).sum((1, 2)) for (w, _), c in zip(blended, counts, strict=True))
    summed = sum((w * E * c).sum((1, 2)) for (w, _), E, c in zip(blended, errors, counts, strict=True))
    mean = np.concatenate([E[c] for E, c in zip(errors, counts, strict=True)]).mean()
    e = np.where(seen > 0, summed / np.where(seen > 0, seen, 1), mean)
    found = list(usual_errors(splats, CAMERAS, DrawnAs(antialiased), errors, counts))
    for X, (w, _) in zip(found, blended, strict=True):
        expected = np.tensordot(e.clip(0, 1), w, 1) + (1 - w.sum(0)) * mean
        np.testing.assert_allclose(X, expected.clip(0, 1), rtol=1e-3, atol=2e-4)


def test_an_error_that_is_the_same_everywhere_is_usual():
    errors, counts = [np.full((c.height, c.width), 0.1, np.float32) for c in CAMERAS], maps(1)[1]
    for X in usual_errors(rounded(random_splats(60, 4, 1)), CAMERAS, DrawnAs(), errors, counts):
        np.testing.assert_allclose(X, 0.1, atol=1e-4)


def test_what_does_not_count_has_no_say():
    splats, (errors, counts) = rounded(random_splats(60, 4, 1)), maps(2)
    other = [np.where(c, E, 1).astype(np.float32) for E, c in zip(errors, counts, strict=True)]
    first, second = (list(usual_errors(splats, CAMERAS, DrawnAs(), some, counts)) for some in (errors, other))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_nothing_that_counts_is_no_error():
    errors, counts = maps(3)[0], [np.zeros((c.height, c.width), bool) for c in CAMERAS]
    for X in usual_errors(rounded(random_splats(20, 4, 1)), CAMERAS, DrawnAs(), errors, counts):
        assert not X.any()


@pytest.mark.parametrize("kind", ["sloped", "curved", "cut", "shifted"])
def test_colours_give_way_to_greys_and_shapes_do_not(kind):
    splats = getattr(tiny_data, f"{kind}_truth")()
    grey = in_grey(splats, np.full(splats.n_splats, 0.25))
    assert grey.sh_degree == 0 and grey.n_slopes == grey.n_curvatures == 0
    assert (grey.n_cuts, grey.n_shifts) == (splats.n_cuts, splats.n_shifts)
    for camera in tiny_data.cameras()[:2]:
        shown, alpha = picture_of(grey, 0.0)(camera).color, picture_of(splats, 0.0)(camera).alpha
        np.testing.assert_allclose(shown, 0.25 * alpha[..., None].repeat(3, axis=2), atol=1e-5)


def test_of_a_linear_model_errors_are_no_radiance():
    errors, counts = maps(4)
    splats = rounded(random_splats(60, 4, 1))
    usual = [list(usual_errors(splats, CAMERAS, DrawnAs(linear=linear), errors, counts)) for linear in (False, True)]
    for a, b in zip(*usual, strict=True):
        np.testing.assert_array_equal(a, b)
