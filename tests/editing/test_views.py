"""What views have seen, against their pictures; and what floats before the surface that they see."""

from dataclasses import replace

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.editing.views import FREE_VIEWS, evidence, seen
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.splats import Splats
from splat_scenes import make_splats, rounded

CAMERAS = tiny_data.cameras()


def pictures(splats: Splats, antialiased=False) -> np.ndarray:
    params, options = upload(splats), RasterOptions(sh_degree=splats.sh_degree)
    drawn = DrawnAs(antialiased)
    return np.stack([render_picture(params, camera, options, drawn=drawn).color for camera in CAMERAS])


def with_a_shell(inner: Splats, seed=0) -> Splats:
    """``inner``, and the same at places that no camera sees: far behind, or beside the pictures."""
    hidden = inner.select(np.arange(20))
    hidden.means[:10] += (0, 0, 40)
    hidden.means[10:] *= 0.01
    hidden.log_scales[10:] -= 4
    wall = rounded(make_splats(sphere(400) * 0.3, 0.05, 0.99, 0.2))
    wall = Splats(wall.means, wall.log_scales, wall.quats, wall.logit_opacities + 4, np.zeros((400, 4, 3)))
    parts = (inner.select(np.linalg.norm(inner.means, axis=1) > 0.5), wall, hidden)
    names = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")
    return Splats(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def sphere(n: int) -> np.ndarray:
    k = np.arange(n) + 0.5
    z, angle = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], 1)


@pytest.mark.parametrize("antialiased", [False, True])
def test_without_the_unseen_all_views_keep_their_bits(antialiased):
    splats = with_a_shell(tiny_data.truth())
    found = seen(splats, CAMERAS, DrawnAs(antialiased))
    assert (~found[-20:]).sum() >= 19 and found.sum() > 100
    assert np.array_equal(pictures(splats, antialiased), pictures(splats.select(found), antialiased))


def test_what_is_seen_changes_a_view_where_it_is_missing():
    splats = tiny_data.dog_model()
    splats.means[::20] += (0, 0, 40)
    found, whole = seen(splats, CAMERAS, DrawnAs()), pictures(splats)
    assert found.any() and not found.all()
    for k in [*np.flatnonzero(found)[::8], *np.flatnonzero(~found)[:3]]:
        others = np.delete(np.arange(splats.n_splats), k)
        assert np.array_equal(pictures(splats.select(others)), whole) != found[k]


def test_what_hangs_in_the_air_before_a_surface_floats():
    """A ball within a cloud of dust: what most cameras see the ball through floats."""
    splats = rounded(make_splats(np.concatenate([sphere(600) * 0.8, sphere(40) * 1.3]), 0.07, 0.3))
    splats.logit_opacities[:600] = 4
    splats.log_scales[600:] = np.log(0.02)
    cameras = tiny_data.cameras(72)
    told = evidence(splats, cameras, DrawnAs())
    before_the_ball = np.zeros(40, int)  # views, from the geometry alone: a ray to the dust goes on to hit the ball
    for camera in cameras:
        offsets = splats.means[600:] - camera.position
        distances = np.linalg.norm(offsets, axis=1)
        along = -(offsets / distances[:, None]) @ camera.position
        miss = np.sqrt(camera.position @ camera.position - along**2)
        hit = along - np.sqrt(np.maximum(0.8**2 - miss**2, 0))
        before_the_ball += (miss < 0.7) & (distances < 0.8 * hit)
    assert not told.floats[:600].any()
    clearly = before_the_ball >= FREE_VIEWS
    assert (told.free[600:] >= before_the_ball).all() and clearly.sum() >= 4
    alone = told.on[600:] == 0  # some are as deep as the edge of the ball, where they are seen beside it
    assert told.floats[600:][clearly & alone].all() and (clearly & alone).sum() >= 4


def test_a_lone_surface_has_nothing_that_floats_and_a_hidden_place_tells_nothing():
    splats = rounded(make_splats(np.concatenate([sphere(600) * 0.6, [[0, 0, 0]]]), 0.06, 0.98))
    told = evidence(splats, CAMERAS, DrawnAs())
    assert not told.floats.any() and told.on[:600].sum() > 1000
    assert told.free[600] == told.on[600] == 0


def test_a_primitive_is_looked_up_where_each_view_sees_it():
    """A speck that is stored in front of a ball stands, for all who look at it, in the middle: it hides there."""
    camera = CAMERAS[1]
    place, size = 0.45 * camera.position, 0.02
    splats = rounded(make_splats(np.concatenate([sphere(600) * 0.6, [place]]), 0.06, 0.98))
    splats.log_scales[600], splats.logit_opacities[600] = np.log(size), -1  # no surface itself
    along_the_view = np.eye(3)[None] * np.linalg.norm(place) / size
    hidden = replace(splats, shift_index=[600], view_shifts=along_the_view, mean_views=np.zeros((1, 3)))
    assert evidence(splats, [camera], DrawnAs()).free[600] == 1
    told = evidence(hidden, [camera], DrawnAs())
    assert told.free[600] == told.on[600] == 0
