"""Coarse grids of SPZ and SOG: what is on them is read back from a file as it is, and the file is small."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.formats.coded import CODED, snapped
from mi_dogsplat.formats.grids import Extents, Grid, Steps
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.packing import by_color, in_space
from mi_dogsplat.formats.palette import centred, lloyd, nearest_entries, palette
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.symmetries import nearest_to_identity
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.scene.quaternions import unit_quaternions
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.srgb import linear_to_srgb_log
from splat_scenes import random_splats, rounded

NAMES = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")
ULP = 2.0**-24  # of a number from 0.5 to 1, as the largest component of a quaternion is


def model_of(degree: int = 2, n: int = 600) -> Splats:
    return rounded(random_splats(n, seed=degree, degree=degree, dog_share=0))


def rows(model: Splats) -> np.ndarray:
    """[N, numbers] sorted: files have orders of their own."""
    table = np.concatenate([getattr(model, name).reshape(model.n_splats, -1) for name in NAMES], axis=1)
    return table[np.lexsort(table[:, :3].T)]


def covariances(model: Splats) -> np.ndarray:
    """[N, 3, 3] float64."""
    x, y, z, w = unit_quaternions(model.quats).T
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])  # fmt: skip
    axes = np.moveaxis(turn, -1, 0) * np.exp(model.log_scales.astype(np.float64))[:, None]
    return axes @ np.swapaxes(axes, 1, 2)


@pytest.mark.parametrize("steps", [Steps(), Steps(1 / 32, 1, 1, 1, 1, 1, 1 / 2), Steps(1 / 2, 4, 9, 15, 4, 8, 1 / 16)])
@pytest.mark.parametrize("degree", [0, 1, 3])
@pytest.mark.parametrize("name", CODED)
def test_a_file_says_exactly_what_is_on_its_grids(name, degree, steps, tmp_path):
    model = snapped(name, model_of(degree), steps)
    write_model(tmp_path / f"model.{name}", model)
    assert rows(read_model(tmp_path / f"model.{name}").splats) == pytest.approx(rows(model), rel=0, abs=ULP)
    back = read_model(tmp_path / f"model.{name}").splats
    for values in set(NAMES) - {"quats"}:
        assert set(getattr(back, values).ravel()) <= set(getattr(model, values).ravel()), values


@pytest.mark.parametrize("name", CODED)
def test_what_is_on_the_grids_is_as_near_as_their_steps_say(name):
    model, steps = nearest_to_identity(model_of(0)), Steps()
    found = snapped(name, model, steps)
    small = np.percentile(np.sort(model.log_scales, axis=1)[:, 1], 10)
    room = 1 + np.abs(model.means).max() if name == "sog" else 1.0
    assert np.abs(found.means - model.means).max() <= steps.position * np.exp(small) * room
    assert np.abs(found.log_scales - model.log_scales).max() <= steps.log_scale / 32 + 1e-6
    assert np.abs(found.opacities - model.opacities).max() <= steps.opacity / 255 / 2 + 1e-6
    assert np.abs(found.sh_coeffs - model.sh_coeffs).max() <= steps.color / 38.25 / 2 + 1e-6
    assert np.abs(found.quats[:, :3] - model.quats[:, :3]).max() <= steps.rotation / 127.5 / np.sqrt(2) / 2 + 1e-6


@pytest.mark.parametrize("name", CODED)
def test_grids_of_radiance_have_room_for_lamps_and_shadows_and_files_say_what_is_on_them(name, tmp_path):
    model = model_of(0)
    wanted = np.geomspace(1e-3, 100, model.n_splats * 3)
    model.sh_coeffs[:] = ((np.random.default_rng(0).permutation(wanted) - 0.5) / C0).reshape(-1, 1, 3)
    found = snapped(name, model, linear=True)
    seen, expected = (linear_to_srgb_log(0.5 + C0 * m.sh_coeffs.astype(np.float64)) for m in (found, model))
    np.testing.assert_allclose(seen, expected, atol=0.026)  # half a step of SPZ above white
    assert np.abs(snapped(name, model).sh_coeffs - model.sh_coeffs).max() * C0 > 0.1
    write_model(tmp_path / f"model.{name}", Model(found, Drawing(linear=True)))
    back = read_model(tmp_path / f"model.{name}").splats
    assert set(back.sh_coeffs.ravel()) <= set(found.sh_coeffs.ravel())


@pytest.mark.parametrize("name", CODED)
def test_coarser_steps_and_smaller_palettes_make_smaller_files(name, tmp_path):
    model, fine = model_of(3), Steps(1 / 64, 1, 1, 1, 1, 1, 1)

    def size(steps: Steps | None) -> int:
        write_model(tmp_path / f"m.{name}", snapped(name, model, steps) if steps else model)
        return (tmp_path / f"m.{name}").stat().st_size

    coarser = {"position": 1 / 2, "log_scale": 4, "rotation": 5, "opacity": 5, "color": 4, "sh": 16, "entries": 1 / 8}
    sizes = {what: size(replace(fine, **{what: value})) for what, value in coarser.items()}
    assert {what for what, found in sizes.items() if found >= size(fine)} == set()
    assert size(Steps()) < 0.55 * size(None)


def test_a_grid_takes_the_nearest_of_its_values_and_the_ends_beyond():
    grid = Grid.of(np.array([-1.0, 0, 0.5, 4]))
    assert grid.snap(np.array([-9, -0.6, -0.4, 0.2, 0.3, 2.2, 2.3, 99])).tolist() == [-1, -1, 0, 0, 0.5, 0.5, 4, 4]


@pytest.mark.parametrize("name", CODED)
def test_codebooks_and_tables_have_room_for_any_model(name):
    wide = model_of(1)
    wide.log_scales[0], wide.log_scales[1], wide.sh_coeffs[0] = -60, 30, 40
    wide.means[0] = 1e5
    grids = CODED[name](Extents.of(wide), Steps())
    assert max(len(grid.values) for grid in grids.means) < 2**22
    assert all(len(grid.values) <= 256 for grid in (grids.log_scales, grids.three, grids.sh_dc, grids.sh_rest))
    assert np.isfinite(grids.snap(wide, grids.palette(wide, 1 / 8)).means).all()


def test_extents_are_those_of_the_least_and_largest_values_and_of_a_tenth_of_the_primitives():
    """Eleven primitives, so that the second smallest is where a tenth of them ends."""
    model = model_of(0, 11)
    model.log_scales[:] = np.arange(11)[:, None] * 0.1 + [2.0, -1.0, 0.5]  # the middle one of each is the last
    model.means[:] = [3.0, -8.0, 1.0]
    model.means[0] = [0.5, 0.25, -1.0]
    found = Extents.of(model)
    assert found.low.tolist() == [0.5, -8.0, -1.0] and found.high.tolist() == [3.0, 0.25, 1.0]
    assert found.log_scales == pytest.approx((-1.0, 3.0)) and found.small == pytest.approx(np.exp(0.6))
    assert found.small_at_1 == pytest.approx(np.exp(0.7) / 9)  # the first is large for where it is: 0.5 - log 2


@pytest.mark.parametrize("linear", [False, True])
def test_the_numbers_of_extents_bring_them_back(linear):
    extents = Extents.of(model_of(1), linear)
    again = Extents.from_numbers(extents.numbers)
    assert again.numbers.tolist() == extents.numbers.tolist() and again.linear == linear


def test_the_nearest_to_the_identity_of_24_forms_is_the_same_ellipsoid():
    model = model_of(0)
    found = nearest_to_identity(model)
    truth = covariances(model)
    assert np.abs(covariances(found) - truth).max() < 1e-6 * np.abs(truth).max()
    assert found.quats[:, 3].min() > 0.85 and np.abs(found.quats[:, :3]).max() < 0.383  # sin(π/8)
    assert nearest_to_identity(found).quats == pytest.approx(found.quats, abs=1e-6)


def test_rounds_of_lloyd_lower_the_weighted_error_and_keep_entries_that_nobody_uses():
    rng = np.random.default_rng(0)
    vectors, weights = rng.normal(size=(900, 6)).astype(np.float32), rng.uniform(0.1, 5, 900)
    labels, entries = palette(vectors, 30, weights)

    def error(labels, entries):
        return (weights * np.square(vectors - entries[labels]).sum(axis=1)).sum()

    errors = [error(labels, entries)] + [error(*lloyd(vectors, entries, weights, k)) for k in (1, 2, 4)]
    assert np.all(np.diff(errors) < 0)
    lonely = np.concatenate([entries, np.full((1, 6), 99, np.float32)])
    assert lloyd(vectors, lonely, weights, 2)[1][-1].tolist() == [99] * 6


@pytest.mark.parametrize(("n", "count", "width"), [(1, 1, 3), (700, 300, 9), (513, 40, 45)])
def test_the_nearest_entry_is_that_of_the_least_distance(n, count, width):
    rng = np.random.default_rng(n)
    vectors, entries = (rng.normal(size=(rows, width)).astype(np.float32) for rows in (n, count))
    distances = np.linalg.norm(vectors[:, None].astype(np.float64) - entries, axis=2)  # [n, count]
    found = distances[np.arange(n), nearest_entries(vectors, entries)]
    assert found == pytest.approx(distances.min(axis=1), rel=1e-5)


def test_an_entry_is_the_weighted_mean_of_the_vectors_with_its_label():
    rng = np.random.default_rng(1)
    vectors, weights, labels = rng.normal(size=(50, 4)), rng.uniform(0.1, 5, 50), rng.integers(0, 6, 50)
    entries = rng.normal(size=(7, 4)).astype(np.float32)  # the last has none
    found = centred(vectors, labels, entries, weights)
    for k in range(6):
        assert found[k] == pytest.approx(np.average(vectors[labels == k], axis=0, weights=weights[labels == k]))
    assert np.array_equal(found[6], entries[6])


def test_a_palette_follows_the_primitives_that_have_moved():
    """All by the same: so do the entries, however far, and nobody changes to another one."""
    model = model_of(2).with_sh_degrees(np.arange(600) % 3)
    grids, weights = CODED["sog"](Extents.of(model), Steps(sh=1)), np.ones(600)
    before = grids.palette(model, 1 / 8, weights)
    moved = model.uniform_sh()
    moved.sh_coeffs[:, 1:] += 0.25
    after = grids.palette(moved.with_sh_degrees(model.sh_degrees), 1 / 8, weights, before)
    assert np.array_equal(after.degrees, before.degrees)
    assert (after.labels == before.labels).mean() > 0.95  # the others are near to two
    used = np.arange(8)[None] < (before.degrees[:, None] + 1) ** 2 - 1  # [P, K - 1]
    assert np.abs(after.entries - before.entries - 0.25)[used].max() < 0.1 and not after.entries[~used].any()


def test_heavy_vectors_get_the_entries():
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(400, 4))
    weights = np.where(np.arange(400) < 40, 1e4, 1.0)
    labels, entries = palette(vectors, 40, weights)
    error = np.square(vectors - entries[labels]).sum(axis=1)
    assert error[:40].mean() < 0.2 * error[40:].mean()


def test_rows_of_one_palette_entry_follow_each_other_and_others_are_sorted_in_space():
    model = model_of(1)
    assert by_color(model).tolist() == in_space(model).tolist()
    few = snapped("spz", model)
    sh = few.select(by_color(few)).sh_coeffs[:, 1:].reshape(few.n_splats, -1)
    changes = np.any(sh[1:] != sh[:-1], axis=1).sum()
    assert sorted(by_color(few)) == list(range(few.n_splats)) and changes == len(np.unique(sh, axis=0)) - 1
