"""A model of linear radiance says so in every format that can, and keeps its radiance."""

import gzip

import numpy as np
import pytest
from hdr_data import bright_truth
from mi_dogsplat.formats import spz
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.scene.drawing import Drawing, drawn_as
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import displayed, linear_to_srgb_log
from tiny_data import truth

WHITE = 500.0
DRAWING = Drawing(linear=True, white=WHITE)
SUFFIXES = (".ply", ".compressed.ply", ".spz", ".sog", ".glb", ".gltf")


def colours(splats: Splats) -> np.ndarray:
    """Of the constant part, sorted: formats have orders of their own."""
    return np.sort((0.5 + 0.28209479 * splats.sh_coeffs[:, 0]).ravel())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_says_that_it_is_linear_and_which_radiance_is_white(tmp_path, suffix):
    model = Model(brightened(truth(), WHITE), DRAWING)  # nothing is much brighter than white
    assert write_model(tmp_path / f"a{suffix}", model) == []
    read = read_model(tmp_path / f"a{suffix}")
    drawn = drawn_as(read.drawing)
    assert drawn.linear and drawn.white == WHITE
    np.testing.assert_allclose(colours(read.splats), colours(model.splats), atol=0.01 * WHITE)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_radiance_far_above_white_survives(tmp_path, suffix):
    model = Model(bright_truth(WHITE).uniform_sh(0), DRAWING)  # whose bands are beyond what two of the formats can say
    assert colours(model.splats).max() > 10 * WHITE
    assert write_model(tmp_path / f"a{suffix}", model) == []
    found, expected = colours(read_model(tmp_path / f"a{suffix}").splats), colours(model.splats)
    assert found.max() == pytest.approx(expected.max(), rel=0.06 if suffix == ".spz" else 0.02)


@pytest.mark.parametrize(("suffix", "step"), [(".sog", 0.01), (".spz", 0.03)])
def test_lamps_take_nothing_from_the_shadows_of_a_small_file(tmp_path, suffix, step):
    """Radiance over six orders of magnitude, more values than the table has: each as far off as the eye sees."""
    rng = np.random.default_rng(0)
    n = 2000
    wanted = np.geomspace(1e-4, 100, 3 * n).reshape(n, 3)
    splats = Splats(
        means=rng.normal(size=(n, 3)),
        log_scales=np.full((n, 3), -3.0),
        quats=np.tile([0.0, 0, 0, 1], (n, 1)),
        logit_opacities=np.zeros(n),
        sh_coeffs=((wanted - 0.5) / 0.28209479)[:, None],
    )
    assert write_model(tmp_path / f"a{suffix}", Model(brightened(splats, WHITE), DRAWING)) == []
    found = colours(read_model(tmp_path / f"a{suffix}").splats) / WHITE
    np.testing.assert_allclose(linear_to_srgb_log(found), linear_to_srgb_log(wanted.ravel()), atol=step)


def test_spz_clamps_what_is_far_above_white_and_tells(tmp_path):
    model = Model(bright_truth(400 * WHITE).uniform_sh(0), DRAWING)
    n = int((0.5 + 0.28209479 * model.splats.sh_coeffs[:, 0] > 1024 * WHITE).any(axis=1).sum())
    assert 0 < n < model.splats.n_splats
    lost = write_model(tmp_path / "a.spz", model)
    assert lost == [f"SPZ has no radiance above 5.12e+05, to which it clamps {n} primitives"]
    assert colours(read_model(tmp_path / "a.spz").splats).max() == pytest.approx(1024 * WHITE, rel=1e-3)


def test_spz_clamps_what_is_darker_than_black_and_tells(tmp_path):
    """What depends on the view may lighten it."""
    splats = truth().uniform_sh(1)
    splats.sh_coeffs[:] = 0
    splats.sh_coeffs[0, 0] = (0.9 * WHITE * spz.RADIANCE[0] - 0.5) / 0.28209479
    splats.sh_coeffs[1, 0] = (1.1 * WHITE * spz.RADIANCE[0] - 0.5) / 0.28209479
    (line,) = write_model(tmp_path / "a.spz", Model(splats, DRAWING))
    assert line == f"SPZ has no radiance below {WHITE * spz.RADIANCE[0]:.4g}, to which it clamps 1 primitive"
    assert colours(read_model(tmp_path / "a.spz").splats).min() == pytest.approx(WHITE * spz.RADIANCE[0], rel=1e-3)


def test_the_comment_of_spz_is_one_of_gzip_and_display_referred_files_have_none(tmp_path):
    write_model(tmp_path / "a.spz", Model(truth(), Drawing(near_clip=0.1, linear=False)))
    write_model(tmp_path / "b.spz", Model(truth(), Drawing(linear=True)))
    plain, linear = ((tmp_path / name).read_bytes() for name in ("a.spz", "b.spz"))
    assert plain[3] == 0 and linear[3] == 16
    assert len(gzip.decompress(plain)) == len(gzip.decompress(linear))
    assert b"dogsplat linear true\ndogsplat curve srgb_log\0" in linear
    assert read_model(tmp_path / "b.spz").drawing.linear


def test_a_linear_spz_file_of_before_holds_radiance_and_others_see_what_a_screen_shows(tmp_path):
    model = Model(brightened(truth(), WHITE), DRAWING)
    write_model(tmp_path / "a.spz", model)
    data = (tmp_path / "a.spz").read_bytes()
    (tmp_path / "before.spz").write_bytes(data.replace(b"\ndogsplat curve srgb_log", b""))
    (tmp_path / "other.spz").write_bytes(gzip.compress(gzip.decompress(data)))
    shown = linear_to_srgb_log(colours(model.splats) / WHITE)
    np.testing.assert_allclose(colours(read_model(tmp_path / "before.spz").splats) / WHITE, shown, atol=0.01)
    np.testing.assert_allclose(colours(read_model(tmp_path / "other.spz").splats), shown, atol=0.01)


def test_what_is_to_be_given_by_hand_shows_a_splat_file_as_bright_as_the_model(tmp_path):
    """Its colours are in units of white: a white of the model beside them would count twice."""
    model = Model(brightened(truth(), 4.0), Drawing(linear=True, white=4.0))
    (told, *_) = write_model(tmp_path / "a.splat", model)
    assert told == ".splat cannot say how it is drawn: linear True; give it by hand"
    by_hand = drawn_as(Drawing(linear=True))
    shown = displayed(colours(read_model(tmp_path / "a.splat").splats), by_hand.white)
    np.testing.assert_allclose(shown, displayed(colours(model.splats), 4.0), atol=0.03)


def test_spz_4_tells_that_it_cannot_say_so(tmp_path):
    lost = write_model(tmp_path / "a.spz", Model(truth(), Drawing(linear=True)), spz_version=4)
    assert lost == ["SPZ 4 cannot say that its colours are linear; give it by hand, or write version 3"]
    lost = write_model(tmp_path / "b.spz", Model(truth(), Drawing(linear=True, white=4.0)), spz_version=4)
    assert "SPZ 4 cannot say that its colours are linear and in units of white; write version 3" in lost


@pytest.mark.parametrize("suffix", [".compressed.ply", ".spz", ".sog", ".splat"])
def test_colours_that_are_beyond_all_numbers_in_units_of_white_are_not_written(tmp_path, suffix):
    bright = brightened(truth(), 1e30)
    with pytest.raises(DataError, match=f"model{suffix}: has values of sh_coeffs that are not finite"):
        write_model(tmp_path / f"model{suffix}", Model(bright, Drawing(linear=True, white=1e-20)))
    assert not [*tmp_path.iterdir()]


def test_a_white_by_which_colours_end_beyond_all_numbers_is_refused(tmp_path):
    write_model(tmp_path / "a.compressed.ply", Model(truth(), DRAWING))
    data = (tmp_path / "a.compressed.ply").read_bytes()
    assert data.count(f"white {WHITE}\n".encode()) == 1
    (tmp_path / "a.compressed.ply").write_bytes(data.replace(f"white {WHITE}\n".encode(), b"white 1e300\n"))
    with pytest.raises(DataError, match="are not finite"):
        read_model(tmp_path / "a.compressed.ply")


def test_brightened_models_have_all_colours_times_the_factor_in_every_direction():
    mixed = truth().with_sh_degrees(np.arange(truth().n_splats) % 2)
    direction = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])

    def seen(splats: Splats) -> np.ndarray:
        sh = splats.uniform_sh(1).sh_coeffs
        basis = np.array([0.28209479, *(0.48860251 * np.array([-1, 1, -1]) * direction[[1, 2, 0]])])
        return 0.5 + np.einsum("k,nkc->nc", basis, sh)

    for model in (truth(), mixed):
        np.testing.assert_allclose(seen(brightened(model, 7.0)), 7 * seen(model), rtol=1e-4, atol=1e-5)
