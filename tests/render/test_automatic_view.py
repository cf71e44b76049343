"""The view that nobody has named shows all of a model, upright."""

import numpy as np
import pytest
import tiny_data
from mi_dogsplat import write_ply
from mi_dogsplat.film.subject import read_subject
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.render.framing import automatic_camera, likely_up, robust_sphere
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.render.viewpoint import viewpoint
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.scene.splats import Splats
from rendered_files import read_png, render


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_automatic_view_shows_a_model_of_any_size_wherever_it_is(scale, tmp_path):
    splats = tiny_data.truth()
    splats.means = splats.means * np.float32(scale) + np.float32(20 * scale)
    splats.log_scales += np.float32(np.log(scale))
    pixels, depth = automatic_camera(splats).project(splats.means)
    assert (depth > 0).all() and (pixels > 0).all() and (pixels < (800, 600)).all()
    assert np.ptp(pixels[:, 1]) > 250  # and fills the picture
    write_ply(tmp_path / "m.ply", splats)
    render(tmp_path / "m.ply", tmp_path / "v.png", downscale=4)
    assert np.mean(read_png(tmp_path / "v.png").max(axis=2) > 20) > 0.2  # the near clip left it in


def test_a_near_clip_that_is_asked_for_holds_in_the_automatic_view():
    chosen = viewpoint(tiny_data.truth(), options=PictureOptions(near_clip=2.0)).drawn.near_clip
    assert chosen == 2.0 > viewpoint(tiny_data.truth()).drawn.near_clip


@pytest.mark.parametrize(("by_flag", "by_file"), [(None, None), (None, 0.15), (0.01, 0.15)])
def test_a_camera_file_draws_a_small_model_as_a_film_through_that_camera_does(tmp_path, by_flag, by_file):
    """Nearer than is usual only where neither flag nor file says how near."""
    splats = tiny_data.truth()
    splats.means *= np.float32(1e-2)
    splats.log_scales += np.float32(np.log(1e-2))
    model, camera, options = tmp_path / "m.ply", tmp_path / "c.json", PictureOptions(near_clip=by_flag)
    write_model(model, Model(splats, Drawing(near_clip=by_file)))
    write_camera(camera, automatic_camera(splats))
    rendered = viewpoint(splats, camera=camera, options=options, drawing=Drawing(near_clip=by_file)).drawn
    assert rendered == read_subject(model, None, options, chosen=True).drawn
    assert rendered.near_clip == (by_flag or by_file or 0.1 * robust_sphere(splats)[1]) < 0.2


def test_far_outliers_do_not_change_what_is_framed():
    splats = tiny_data.truth()
    centre, radius = robust_sphere(splats)
    splats.means[:3] = 1e6
    moved_centre, larger = robust_sphere(splats)
    assert np.linalg.norm(moved_centre - centre) < 0.2 and larger < 1.5 * radius


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_what_stands_on_a_ground_is_shown_upright(axis, sign):
    rng = np.random.default_rng(0)
    means = rng.uniform(-1, 1, (500, 3)) * (1, 1, 0.02)
    means[:80] = rng.uniform(-0.2, 0.2, (80, 3)) + (0, 0, 0.4)  # a thing on the ground
    means = np.roll(means, axis - 2, axis=1) * sign
    splats = tiny_data.truth().select(np.zeros(500, int))
    splats.means = means.astype(np.float32)
    np.testing.assert_array_equal(likely_up(splats), sign * np.eye(3)[axis])
    camera = automatic_camera(splats)
    thing, ground = (camera.project(means[rows].mean(axis=0))[0][0] for rows in (slice(80), slice(80, None)))
    assert thing[1] < ground[1] and abs(thing[0] - ground[0]) < 30
    assert np.linalg.det(camera.w2c[:3, :3]) == pytest.approx(1)


def test_where_nothing_tells_z_is_up():
    np.testing.assert_array_equal(likely_up(Splats.empty(0)), [0, 0, 1])
    splats = tiny_data.truth().select([0])
    np.testing.assert_array_equal(likely_up(splats), [0, 0, 1])
