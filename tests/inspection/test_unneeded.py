"""What no picture shows is found, and taken out every picture keeps its bits; what one picture shows is left alone."""

from dataclasses import replace

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.inspection.unneeded import FADED, Unneeded, used_sh_degrees
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.row_groups import DOG
from mi_dogsplat.scene.splats import Splats
from own_axes_models import AND_SHIFTS, CURVED, PLANE_KINDS, SLOPED, Kind
from splat_scenes import logit, make_camera, make_splats, random_splats, rounded

CUTOFF = 1 / 255


def pictures(splats: Splats, antialiased=False) -> list[np.ndarray]:
    options = RasterOptions(sh_degree=splats.sh_degree)
    params = upload(splats)
    return [render_picture(params, camera, options, 0.3, DrawnAs(antialiased)).color for camera in tiny_data.cameras()]


def wasteful(seed=0) -> Splats:
    """A fifth of the primitives is too faint, a third of the DoG rows has faded, and the second SH band is zero."""
    splats = rounded(random_splats(80, seed=seed, degree=2, dog_share=0.6))
    splats.means[:] = np.random.default_rng(seed).uniform(-0.8, 0.8, (80, 3))
    splats.logit_opacities[::5] = logit(np.geomspace(1e-12, 0.999 * CUTOFF, 16))
    splats.dog_logit_opacities[::3] = -25
    splats.sh_coeffs[:, 4:] = 0
    return splats


def varied(kind: Kind) -> Splats:
    """The same, and every third primitive has rows of a kind, of which each fourth is zero."""
    splats = kind.having(wasteful(), every=3)
    kind.values(splats)[::4] = 0
    kind.values(splats)[::8] = -0.0
    kind.values(splats)[1, :2] = 0  # not all of the row
    return splats


@pytest.mark.parametrize("antialiased", [False, True])
def test_without_it_every_picture_has_the_same_bits(antialiased):
    splats = wasteful()
    found = Unneeded.of(splats)
    lean = found.taken_out(splats)
    assert found.invisible.sum() == 16 and found.rows[DOG].sum() >= 10
    assert lean.n_splats == 64 and lean.sh_degree == 1
    assert lean.n_dog == splats.select(~found.invisible).n_dog - found.rows[DOG].sum()
    for before, after in zip(pictures(splats, antialiased), pictures(lean, antialiased), strict=True):
        assert np.array_equal(before, after)


def test_pictures_keep_their_bits_where_all_dog_have_faded():
    """The kernels of a model without DoG are others."""
    splats = wasteful()
    splats.dog_logit_opacities[:] = -25
    lean = Unneeded.of(splats).taken_out(splats)
    assert splats.n_dog and not lean.n_dog
    for before, after in zip(pictures(splats), pictures(lean), strict=True):
        assert np.array_equal(before, after)


@AND_SHIFTS
def test_rows_of_zeros_leave_and_the_others_keep_the_bits_of_every_picture(kind):
    """But for cuts: a normal of zero makes a factor of 1 to rounding."""
    splats = varied(kind)
    found = Unneeded.of(splats)
    lean, zeros = found.taken_out(splats), found.rows[kind.group]
    seen = kind.index(splats) % 5 != 0  # not faint
    if kind in PLANE_KINDS:  # which makes one that is nearly seen a little more opaque
        seen = ~found.invisible[kind.index(splats)]
    assert zeros.tolist() == (seen & (np.arange(27) % 4 == 0)).tolist() and zeros.sum() == 5
    assert kind.n(lean) == seen.sum() - 5
    flat = Unneeded.of(kind.without(splats)).taken_out(kind.without(splats))
    rounding, change = (1e-6, 1e-3) if kind in PLANE_KINDS else (0, 0)
    for before, after, other in zip(pictures(splats), pictures(lean), pictures(flat), strict=True):
        assert abs(before - after).max() <= rounding and abs(before - other).max() > change


@AND_SHIFTS
def test_pictures_keep_their_bits_where_all_rows_are_zero(kind):
    """The kernels of a model without any are others."""
    splats = varied(kind)
    kind.values(splats)[:] = 0
    kind.values(splats)[::2] = -0.0
    lean = Unneeded.of(splats).taken_out(splats)
    assert kind.n(splats) and not kind.n(lean)
    for before, after in zip(pictures(splats), pictures(lean), strict=True):
        assert abs(before - after).max() <= (1e-6 if kind in PLANE_KINDS else 0)


@pytest.mark.parametrize(
    ("opacity", "shown"), [(0.999, [False, True, True, True]), (0.97, [False, False, False, True])]
)
def test_a_faint_primitive_stays_where_its_cuts_make_it_visible(opacity, shown):
    """Oracle: a picture with a pixel where the most is kept of it."""
    splats = rounded(make_splats([[0, 0, 2]], 1.0, opacity * CUTOFF))
    first, second = ({kind.group.index: [0], kind.name: [[400, 0, 0]]} for kind in PLANE_KINDS)
    models = [replace(splats, **rows) for rows in ({}, first, second, first | second)]
    camera = make_camera(99, 9)
    assert [render_picture(upload(s), camera, RasterOptions(sh_degree=0)).color.any() for s in models] == shown
    assert [not Unneeded.of(s).invisible[0] for s in models] == shown


@pytest.mark.parametrize("value", [np.nan, np.inf])
@AND_SHIFTS
def test_rows_that_are_not_finite_are_drawn_by_no_kernel(value, kind):
    for name in kind.group.names:
        splats = varied(kind)
        getattr(splats, name)[2, 1, ...] = value
        row = int(kind.index(splats)[2])
        assert row % 5 and Unneeded.of(splats).invisible[row]
        lean = Unneeded.of(splats).taken_out(splats)
        for before, after in zip(pictures(splats), pictures(lean), strict=True):
            assert np.array_equal(before, after)


def test_degrees_of_single_primitives_keep_pictures_to_rounding():
    splats = wasteful()
    splats.sh_coeffs[::2, 1:] = 0
    lean = Unneeded.of(splats).taken_out(splats, mixed_sh=True)
    assert lean.mixed_sh and set(lean.sh_degrees) == {0, 1}
    for before, after in zip(pictures(splats), pictures(lean), strict=True):
        assert abs(before - after).max() < 2e-6
    again = Unneeded.of(lean)
    assert not again.invisible.any() and np.array_equal(again.sh_degrees, lean.sh_degrees)


@pytest.mark.parametrize("opacity, stays", [(1.001 * CUTOFF, True), (0.999 * CUTOFF, False)])
def test_a_primitive_stays_just_where_a_pixel_shows_it(opacity, stays):
    """Oracle: a picture with a pixel at its centre."""
    splats = rounded(make_splats([[0, 0, 2]], 0.2, opacity))
    camera = make_camera(9, 9)
    picture = render_picture(upload(splats), camera, RasterOptions(sh_degree=0)).color
    assert bool(picture.any()) == stays
    assert Unneeded.of(splats).invisible[0] != stays


def test_a_dog_stays_where_it_could_change_a_bit():
    """Oracle: float32 itself, at the faintest primary that is blended."""
    faintest = np.nextafter(np.float32(CUTOFF), np.float32(1))
    assert faintest - np.float32(FADED) == faintest and faintest - np.float32(4 * FADED) != faintest
    splats = rounded(make_splats([[0, 0, 2]] * 2, 0.2, 0.5, dog=[0, 1], f_a=[1.9 * FADED, 2.1 * FADED]))
    assert Unneeded.of(splats).rows[DOG].tolist() == [True, False]


@pytest.mark.parametrize("name", ["means", "log_scales", "quats", "logit_opacities", "sh_coeffs", "dog_log_scales"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_drawn_by_no_kernel(name, value):
    splats = wasteful()
    dog_row = int(np.flatnonzero(splats.dog_index % 5)[0])  # of one that is not faint
    row = int(splats.dog_index[dog_row])
    getattr(splats, name).reshape(len(getattr(splats, name)), -1)[dog_row if name[:3] == "dog" else row, 0] = value
    opaque = name == "logit_opacities" and value == np.inf
    assert Unneeded.of(splats).invisible[row] != opaque
    lean = Unneeded.of(splats).taken_out(splats)
    for before, after in zip(pictures(splats), pictures(lean), strict=True):
        assert np.array_equal(before, after)


def test_the_degree_that_is_used_is_that_of_the_highest_band_with_a_number():
    splats = rounded(random_splats(4, degree=3, dog_share=0))
    splats.sh_coeffs[0, 1:] = 0
    splats.sh_coeffs[1, 4:] = 0
    splats.sh_coeffs[2, 1:9] = 0
    assert used_sh_degrees(splats).tolist() == [0, 1, 3, 3]
    assert used_sh_degrees(splats.with_sh_degrees([0, 2, 3, 3])).tolist() == [0, 1, 3, 3]


def test_each_kind_is_named_with_its_number_and_bytes():
    splats = wasteful()
    found = Unneeded.of(splats)
    assert found.described(splats) == [
        f"invisible primitives: 16, {16 * (14 + 24) * 4 / 1000:.3g} kB",
        f"DoG without effect: {found.rows[DOG].sum()}, {found.rows[DOG].sum() * 20} bytes",
        f"zero bands of SH degree 2: 64, {64 * 15 * 4 / 1000:.3g} kB",
    ]
    for kind, size in ((SLOPED, 200), (CURVED, 140), *((plane, 80) for plane in PLANE_KINDS)):
        said, word = Unneeded.of(varied(kind)).described(varied(kind)), kind.word.replace("_", " ")
        assert [line for line in said if word in line] == [f"{word} that are zero: 5, {size} bytes"]
    lean = found.taken_out(splats)
    assert Unneeded.of(lean).described(lean) == []
    lean.sh_coeffs[::2, 1:] = 0
    assert Unneeded.of(lean).described(lean, mixed_sh=False) == []
    assert Unneeded.of(lean).described(lean) == ["zero bands of SH degree 1: 32, 1.15 kB"]


def test_a_model_may_be_empty_and_stay_so():
    empty = Splats.empty(2)
    assert Unneeded.of(empty).taken_out(empty).n_splats == 0
    faint = replace(wasteful(), logit_opacities=np.full(80, -20.0))
    assert Unneeded.of(faint).taken_out(faint).n_splats == 0
