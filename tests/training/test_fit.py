"""A model fitted to pictures from given cameras: it comes nearer to them, as they were drawn, and forgets nothing."""

from dataclasses import replace

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.fit import Look, fit

CAMERAS = tiny_data.cameras(4)
PLAIN = Look()


def pictures(splats: Splats, look: Look = PLAIN) -> list[np.ndarray]:
    options, params = RasterOptions(sh_degree=splats.sh_degree), upload(splats)
    return [render_picture(params, c, options, look.background, look.drawn).color for c in CAMERAS]


def error(splats: Splats, truth: list[np.ndarray], look: Look = PLAIN) -> float:
    return float(np.mean([np.square(a - b).mean() for a, b in zip(pictures(splats, look), truth, strict=True)]))


def disturbed(splats: Splats) -> Splats:
    rng = np.random.default_rng(3)
    return replace(
        splats,
        log_scales=splats.log_scales + rng.normal(0, 0.2, splats.log_scales.shape),
        logit_opacities=splats.logit_opacities + rng.normal(0, 0.3, splats.n_splats),
        sh_coeffs=splats.sh_coeffs + rng.normal(0, 0.05, splats.sh_coeffs.shape),
    )


@pytest.mark.parametrize("look", [PLAIN, Look(1.0, DrawnAs(True, 0.05))])
@pytest.mark.parametrize("truth", [tiny_data.truth(), tiny_data.dog_model()], ids=["plain", "DoG"])
def test_a_disturbed_model_comes_back_to_its_pictures(truth, look):
    images, start, losses = pictures(truth, look), disturbed(truth), []
    found = fit(start, CAMERAS, images, 150, look, after_step=lambda _, loss: losses.append(loss))
    assert error(found, images, look) < 0.2 * error(start, images, look)
    assert len(losses) == 150 and np.mean(losses[-20:]) < 0.5 * np.mean(losses[:20])
    assert found.n_splats == truth.n_splats and np.array_equal(found.dog_index, truth.dog_index)
    assert found.sh_degree == truth.sh_degree


def test_the_drawing_is_that_of_the_pictures():
    """What shows its own pictures has no loss at its first step; drawn in another way it has."""
    truth, look = tiny_data.truth(), Look(1.0, DrawnAs(True, 2.9))
    images = pictures(truth, look)

    def first_loss(how: Look) -> float:
        losses = []
        fit(truth, CAMERAS, images, 1, how, after_step=lambda _, loss: losses.append(loss))
        return losses[0]

    assert first_loss(look) < 1e-4
    for other in (Look(0.0, look.drawn), Look(1.0, DrawnAs(True, 0.1)), Look(1.0, DrawnAs(False, 2.9))):
        assert first_loss(other) > 1e-3, other


def test_a_fit_is_the_same_again_and_leaves_its_start_alone(ordered):
    truth = tiny_data.truth()
    images, start = pictures(truth), disturbed(truth)
    before = start.means.copy(), start.log_scales.copy()
    first, second, other = (fit(start, CAMERAS, images, 12, seed=seed) for seed in (0, 0, 1))
    assert all(np.array_equal(getattr(first, name), getattr(second, name)) for name in vars(first))
    assert not np.array_equal(first.means, other.means)
    assert np.array_equal(start.means, before[0]) and np.array_equal(start.log_scales, before[1])


def test_no_step_changes_nothing_and_wrong_input_is_told():
    truth = tiny_data.truth()
    images = pictures(truth)
    none = fit(truth, CAMERAS, images, 0)
    assert all(np.array_equal(getattr(none, name), getattr(truth, name)) for name in vars(truth))
    with pytest.raises(ValueError, match="4 cameras, 3 pictures"):
        fit(truth, CAMERAS, images[:3], 1)
    with pytest.raises(ValueError, match="0 cameras"):
        fit(truth, [], [], 1)
    with pytest.raises(ValueError, match=r"\(36, 20, 3\)"):
        fit(truth, CAMERAS, [*images[:3], images[3][:, :20]], 1)
    with pytest.raises(ValueError, match="no primitive"):
        fit(Splats.empty(1), CAMERAS, images, 1)
