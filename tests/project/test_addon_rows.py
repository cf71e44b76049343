"""What only some primitives have, slopes and so on, in the add-on: its files and its transforms do as the package."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from addon_models import ADDON_KINDS, EACH_ADDON_KIND, MAPS, as_model
from cut_models import kept_shares
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.scene.transform import transformed
from own_axes_models import CURVED, EACH_KIND, SLOPED
from places import points_in
from shifted_models import places_seen, with_shifts
from sloped_models import curvature_brightness, slope_colors
from splat_scenes import random_splats, rounded

LAST_COLUMNS = "slope_8", "curvature_5", "cut_2", "cut_2", "view_2"


def with_kernels_of(splats, model):
    """Primitives with kernels, slopes, curvatures, cuts and shifts as the add-on has them."""
    changed = {"means": model.means, "log_scales": model.log_scales, "quats": model.quats[:, [1, 2, 3, 0]]}
    for kind in ADDON_KINDS:
        changed |= kind.of_package(model)
    return replace(splats, **changed)


@EACH_KIND
@pytest.mark.parametrize("name", MAPS)
def test_a_moved_primitive_shows_the_same_at_the_same_places(addon, name, kind):
    """By what places show, as axes may be named in another order."""
    matrix, splats = affine(MAPS[name], (0.4, -0.3, 0.2)), kind.having(random_splats(40, seed=7), every=3)
    added = {SLOPED.word: slope_colors, CURVED.word: curvature_brightness}
    shown = added.get(kind.word) or partial(kept_shares, plane=kind.group)
    moved = addon("files.transform").transformed(as_model(addon, splats), matrix)
    points = points_in(splats, kind.index(splats))
    expected = shown(splats, points)
    assert expected.std() > 0.2
    got = shown(with_kernels_of(splats, moved), points @ matrix[:3, :3].T + matrix[:3, 3])
    np.testing.assert_allclose(got, expected, atol=2e-4)
    assert getattr(moved, f"has_{kind.word}").sum() == 14
    plain = addon("files.transform").transformed(as_model(addon, splats.without_slopes().without_cuts()), matrix)
    assert getattr(plain, kind.name).shape[:2] == (40, 0)


@pytest.mark.parametrize("name", MAPS)
def test_a_moved_primitive_stands_where_that_of_the_package_does_in_each_view(addon, name):
    matrix, splats = affine(MAPS[name], (0.4, -0.3, 0.2)), with_shifts(random_splats(40, seed=7), every=3)
    moved = addon("files.transform").transformed(as_model(addon, splats), matrix)
    views = np.random.default_rng(4).normal(size=(9, 3))
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    expected = places_seen(transformed(splats, matrix), views)
    assert (expected.std(axis=1).max(axis=1) > 1e-3).all() and moved.has_shifts.sum() == 14
    np.testing.assert_allclose(places_seen(with_kernels_of(splats, moved), views), expected, atol=2e-6)
    plain = addon("files.transform").transformed(as_model(addon, splats.without_shifts()), matrix)
    assert plain.shifts.shape == (40, 0, 3)


@pytest.mark.parametrize("every", [1, 3, 100])
@EACH_ADDON_KIND
def test_a_file_comes_back_byte_for_byte(addon, tmp_path, every, kind):
    splats, ply = kind.having(random_splats(40, seed=7), every, first=2), addon("files.ply")
    for name in kind.group.names:
        getattr(splats, name)[0] = 0  # a row is a row
    write_ply(tmp_path / "a.ply", splats)
    model = ply.read_ply(tmp_path / "a.ply")
    wanted = as_model(addon, splats)
    for field in (name for each in ADDON_KINDS for name in (each.has, each.name)):
        np.testing.assert_array_equal(getattr(model, field), getattr(wanted, field), err_msg=field)
    require_same_file(ply, tmp_path, model, splats)
    chosen = np.arange(39, 0, -2)
    require_same_file(ply, tmp_path, model.select(chosen), splats.select(chosen))


def test_a_file_with_all_kinds_comes_back_byte_for_byte(addon, tmp_path):
    splats, ply = random_splats(40, seed=7), addon("files.ply")
    for kind, every in zip(ADDON_KINDS, (3, 4, 2, 5, 7), strict=True):
        splats = kind.having(splats, every)
    write_ply(tmp_path / "a.ply", splats)
    model = ply.read_ply(tmp_path / "a.ply")
    assert (model.has_slopes & model.has_cuts).sum() == 7 and (model.has_cuts & model.has_second_cuts).sum() == 4
    assert (model.has_slopes & model.has_curvatures).sum() == 4 and (model.has_slopes & model.has_shifts).sum() == 2
    require_same_file(ply, tmp_path, model, splats)


def require_same_file(ply, folder, model, splats):
    """The add-on writes what the package does."""
    ply.write_ply(folder / "addon.ply", model)
    write_ply(folder / "package.ply", splats)
    assert (folder / "addon.ply").read_bytes() == (folder / "package.ply").read_bytes()


@EACH_ADDON_KIND
def test_a_model_without_rows_joins_one_that_has_some(addon, kind):
    some, none = kind.having(random_splats(9, seed=1), every=2), rounded(random_splats(5, seed=2))
    join, index = addon("files.model").concatenate, kind.index(some)
    for models, at in (((none, some), index + 5), ((some, none), index)):
        joined = join([as_model(addon, splats) for splats in models])
        has, values = getattr(joined, kind.has), getattr(joined, kind.name)
        np.testing.assert_array_equal(np.flatnonzero(has), at)
        np.testing.assert_array_equal(values[at], kind.values(some))
        assert not values[~has].any()
    assert getattr(join([as_model(addon, none)] * 2), kind.name).shape[:2] == (10, 0)


@pytest.mark.parametrize(("kind", "column"), [*zip(ADDON_KINDS, LAST_COLUMNS, strict=True)])
def test_rows_that_are_wrong_in_a_file_are_one_line(addon, tmp_path, kind, column):
    splats = kind.having(random_splats(9, seed=1), every=2)
    write_ply(tmp_path / "a.ply", splats)
    whole = (tmp_path / "a.ply").read_bytes()
    row = 4 + 4 * int(np.prod(kind.shape))  # bytes
    twice = whole[:-row] + whole[-2 * row : 4 - 2 * row] + whole[4 - row :]
    unknown = whole.replace(column.encode(), b"x" * len(column))
    infinite = whole[:-4] + np.float32(np.inf).tobytes()
    for content, words in ((twice, f'element "{kind.word}" does not name different'),
                           (unknown, f'element "{kind.word}" has no property "{column}"; copy or export'),
                           (infinite, f'"{column}" in row 4 of the element "{kind.word}" is not')):  # fmt: skip
        (tmp_path / "b.ply").write_bytes(content)
        with pytest.raises(ValueError) as error:
            addon("files.ply").read_ply(tmp_path / "b.ply")
        assert words in str(error.value) and "\n" not in str(error.value)
    model = as_model(addon, splats)
    getattr(model, kind.name)[2, 1] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        addon("files.ply").write_ply(tmp_path / "c.ply", model)
