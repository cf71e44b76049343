"""Slopes, curvatures, cuts and shifts: in memory, in a PLY file, under maps and in another unit of light."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cut_models import kept_shares, with_cuts, with_second_cuts
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.curvatures import mean_brightness
from mi_dogsplat.scene.kinds import kinds, kinds_of
from mi_dogsplat.scene.ply import read_ply, write_ply
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, PLANES, SECOND_CUTS, SHIFTS, SLOPES, RowGroup
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.errors import DataError
from places import points_in
from ply_files import (
    curvature_columns,
    cut_columns,
    dog_columns,
    random_splats,
    shift_columns,
    slope_columns,
    to_bytes,
    vertex_columns,
    write,
)
from shifted_models import with_shifts
from sloped_models import curvature_brightness, slope_colors, with_curvatures, with_slopes
from splat_scenes import C0, axis_rotation
from splat_scenes import random_splats as splats_in_view

INDEX = [1, 3, 4, 6]
FIELDS = tuple(Splats.__dataclass_fields__)
TURN = axis_rotation([1, -2, 0.7], 2.1)[0]
MIRROR = np.eye(3) - 2 * np.outer([0.6, 0, 0.8], [0.6, 0, 0.8])
SHEAR = np.array([[1.2, 0.5, 0], [0, 0.7, -0.3], [0.1, 0, 2.0]])
MAPS = {"turn": TURN, "mirror": MIRROR, "scale": 1.7 * np.eye(3), "point mirror": -0.4 * TURN, "shear": SHEAR,
        "mirrored shear": SHEAR @ MIRROR, "stretch": np.diag([1.0, 1, 3])}  # fmt: skip
SECOND_COLUMNS = partial(cut_columns, plane=SECOND_CUTS)
ROWS = {"slopes": (SLOPES, slope_columns), "curvatures": (CURVATURES, curvature_columns),
        "cuts": (CUTS, cut_columns), "second_cuts": (SECOND_CUTS, SECOND_COLUMNS),
        "shifts": (SHIFTS, shift_columns)}  # fmt: skip
"""By the element that holds them."""
NAMES = {element: group.names[0] for element, (group, _) in ROWS.items()}
TOLD = {"slopes": ("slope", "slope"), "curvatures": ("curvature", "curvature"), "cuts": ("cut", "cut"),
        "second_cuts": ("second cut", "cut"), "shifts": ("shift", "shift")}  # a row, a column  # fmt: skip
each_kind = pytest.mark.parametrize("element", ROWS)


def with_rows(splats: Splats, group: RowGroup, index=INDEX) -> Splats:
    """The model with random rows of a group for the primitives ``index``."""
    rng = np.random.default_rng(8)
    values = {name: rng.normal(size=(len(index), *shape)) for name, shape in group.arrays.items()}
    return replace(splats, **{group.index: np.array(index, np.uint32)}, **values)


def model(element: str, index=INDEX, **others) -> Splats:
    return with_rows(random_splats(**others), ROWS[element][0], index)


def model_of_all() -> Splats:
    splats = with_rows(model("slopes"), CURVATURES, [0, 1])
    splats = with_rows(with_rows(splats, CUTS, [0, 3, 6]), SECOND_CUTS, [0, 2, 3])
    return with_rows(splats, SHIFTS, [3, 5])


def with_all(splats: Splats, every: int = 2) -> Splats:
    splats = with_second_cuts(with_cuts(with_curvatures(with_slopes(splats, every), every), every), every)
    return with_shifts(splats, every)


def without(splats: Splats, element: str) -> Splats:
    return getattr(splats, f"without_{element}")()


def elements(splats: Splats, element: str, **changed) -> dict:
    columns = {name: values for name, values in (ROWS[element][1](splats) | changed).items() if values is not None}
    return {"vertex": vertex_columns(splats), element: columns}


def same(a: Splats, b: Splats):
    for name in FIELDS:
        left, right = getattr(a, name), getattr(b, name)
        assert left.shape == right.shape and left.tobytes() == right.tobytes(), name


@pytest.mark.parametrize("index", [INDEX, [0], list(range(7)), []])
@pytest.mark.parametrize("dog_index", [(0, 3, 4), ()])
@pytest.mark.parametrize("sh_degree", [0, 3])
@each_kind
def test_a_written_model_comes_back_bit_for_bit(tmp_path, element, index, dog_index, sh_degree):
    splats = model(element, index, dog_index=dog_index, sh_degree=sh_degree)
    write_ply(tmp_path / "a.ply", splats)
    assert (f"element {element} ".encode() in (tmp_path / "a.ply").read_bytes()) == bool(index)
    same(read_ply(tmp_path / "a.ply"), splats)


def test_a_model_of_all_comes_back_and_a_primitive_may_have_all(tmp_path):
    write_ply(tmp_path / "a.ply", model_of_all())
    same(read_ply(tmp_path / "a.ply"), model_of_all())


@pytest.mark.parametrize("layout", ["3dgs", "rows"])
@each_kind
def test_they_stand_beside_degrees_of_single_primitives(tmp_path, layout, element):
    mixed = model(element).with_sh_degrees([3, 0, 1, 2, 0, 3, 1])
    assert [getattr(mixed, f"n_{each}") for each in ROWS] == [4 * (each == element) for each in ROWS]
    write_ply(tmp_path / "a.ply", mixed, layout)
    same(read_ply(tmp_path / "a.ply"), mixed if layout == "rows" else mixed.uniform_sh())


@pytest.mark.parametrize(
    ("element", "columns"), [("slopes", 9), ("curvatures", 6), ("cuts", 3), ("second_cuts", 3), ("shifts", 12)]
)
def test_the_file_has_the_fixed_layout_byte_for_byte(tmp_path, element, columns):
    splats = model(element, dog_index=(0, 3))
    write_ply(tmp_path / "with.ply", splats)
    write_ply(tmp_path / "without.ply", random_splats(dog_index=(0, 3)))
    parts = elements(splats, element) | {"dog": {"index": splats.dog_index, **dog_columns(splats)}}
    rows = to_bytes({name: parts[name] for name in ("vertex", "dog", element)}, types={"index": "uint"})
    header, body = (tmp_path / "with.ply").read_bytes().split(b"end_header\n", 1)
    expected_header, expected_body = rows.split(b"end_header\n", 1)
    assert header.endswith(expected_header[expected_header.index(f"element {element}".encode()) :])
    size = 4 * (1 + columns) * len(INDEX)
    assert body[-size:] == expected_body[-size:]
    shorter_header, shorter = (tmp_path / "without.ply").read_bytes().split(b"end_header\n", 1)
    assert body[:-size] == shorter and header.startswith(shorter_header)


def test_cuts_follow_slopes_and_curvatures_and_precede_degrees(tmp_path):
    write_ply(tmp_path / "a.ply", model_of_all().with_sh_degrees([3, 0, 1, 2, 0, 3, 1]), "rows")
    header = (tmp_path / "a.ply").read_bytes().split(b"end_header\n", 1)[0].decode()
    found = [line.split()[1] for line in header.splitlines() if line.startswith("element")]
    assert found == ["vertex", "dog", "slopes", "curvatures", "cuts", "second_cuts", "shifts", "sh1", "sh2", "sh3"]


def test_a_file_that_ends_too_early_says_how_many_elements_it_promises(tmp_path):
    write_ply(tmp_path / "a.ply", model_of_all())
    path = write(tmp_path, (tmp_path / "a.ply").read_bytes()[:-1])
    with pytest.raises(DataError, match=r'promises 7 x "vertex", .* and 3 elements more = \d+ bytes or more, but'):
        read_ply(path)


@pytest.mark.parametrize("file_format", ["binary_little_endian", "binary_big_endian", "ascii"])
@each_kind
def test_rows_in_any_order_are_sorted_with_their_values(tmp_path, file_format, element):
    splats = model(element, dog_index=())
    order = [2, 0, 3, 1]
    shuffled = {name: values[order] for name, values in ROWS[element][1](splats).items()}
    data = to_bytes(elements(splats, element, **shuffled), file_format, {"index": "uint"})
    same(read_ply(write(tmp_path, data)), splats)


@pytest.mark.parametrize(
    ("changed", "types", "message"),
    [
        ({"index": np.array([1, 3, 4, 7])}, {}, 'row 3 of the element "ROWS" has index 7, but the model has 7 primi'),
        ({"index": np.array([-1, 3, 4, 5])}, {"index": "int"}, 'row 0 of the element "ROWS" has index -1, but the'),
        ({"index": np.array([1, 3.5, 4, 5])}, {"index": "float"}, 'row 1 of the element "ROWS" has index 3.5, but'),
        ({"index": np.array([1, 4, 3, 4])}, {}, 'the element "ROWS" names primitive 4 more than once; write the ROW '),
        ({"index": None}, {}, 'element "ROWS" has no property "index"; the file is damaged'),
        ({"COLUMN_1": None}, {}, 'element "ROWS" has no property "COLUMN_1"; the file is damaged'),
        ({"COLUMN_2": np.array([0, 1, np.nan, 0])}, {}, '"COLUMN_2" in row 2 of the element "ROWS"'),
        ({"COLUMN_0": np.array([0, -np.inf, 1, 0])}, {}, '"COLUMN_0" in row 1 of the element "ROWS"'),
    ],
)
@each_kind
def test_what_is_wrong_with_the_rows_is_one_line(tmp_path, changed, types, message, element):
    splats, (row, column) = model(element, dog_index=()), TOLD[element]
    changed = {name.replace("COLUMN", column): values for name, values in changed.items()}
    path = write(tmp_path, to_bytes(elements(splats, element, **changed), types={"index": "uint"} | types))
    with pytest.raises(DataError) as error:
        read_ply(path)
    told = str(error.value)
    for place, word in (("ROWS", element), ("ROW", row), ("COLUMN", column)):
        message = message.replace(place, word)
    assert message in told and "\n" not in told


@pytest.mark.parametrize(
    ("element", "column"),
    [("slopes", "slope_3"), ("curvatures", "curvature_1"), ("cuts", "cut_1"), ("second_cuts", "cut_1")],
)
def test_what_is_not_finite_is_not_written(tmp_path, element, column):
    splats = model(element)
    getattr(splats, NAMES[element])[2, 1] = np.inf
    with pytest.raises(DataError, match=f'"{column}" in row 2 of the element "{element}"; nothing was written'):
        write_ply(tmp_path / "a.ply", splats)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("which", "index", "rows"),
    [
        (np.array([0, 1, 1, 0, 1, 0, 1], bool), [0, 2, 3], [0, 2, 3]),
        ([6, 0, 1], [0, 2], [3, 0]),
        ([3, 3, 2, 4], [0, 1, 3], [1, 1, 2]),
        ([0, 2], [], []),
        ([], [], []),
    ],
)
@each_kind
def test_selected_primitives_keep_their_own_rows(which, index, rows, element):
    chosen, (group, _), name = model(element).select(which), ROWS[element], NAMES[element]
    assert getattr(chosen, group.index).tolist() == index and getattr(chosen, f"n_{element}") == len(index)
    np.testing.assert_array_equal(getattr(chosen, name), getattr(model(element), name)[rows])


@each_kind
def test_without_them_all_else_stays(element):
    splats, left = model_of_all(), without(model_of_all(), element)
    also = {"cuts": PLANES, "slopes": (SLOPES, CURVATURES)}  # without a cut no second one, with one colour no curvature
    groups = also.get(element, [ROWS[element][0]])
    assert [getattr(splats, f"n_{each}") for each in ROWS] == [4, 2, 3, 3, 2] and left.n_dog == 3
    if CURVATURES in groups:  # as bright as on average
        average = mean_brightness(splats.brightness_curvatures, splats.log_scales[splats.curvature_index])[:, None]
        np.testing.assert_allclose(left.sh_coeffs[:2, 0], splats.sh_coeffs[:2, 0] + average / C0, rtol=1e-5)
        assert np.abs(average).min() > 0.01
        left.sh_coeffs[:2, 0] = splats.sh_coeffs[:2, 0]
    for name in FIELDS:
        if any(name in (group.index, *group.names) for group in groups):
            assert len(getattr(left, name)) == 0
        else:
            np.testing.assert_array_equal(getattr(left, name), getattr(splats, name))
            assert not np.shares_memory(getattr(left, name), getattr(splats, name))
    plain = splats.plain()
    assert [getattr(plain, f"n_{each}") for each in ROWS] == [4, 2, 3, 3, 2] and plain.n_dog == 0


def test_a_primitive_is_cut_if_either_plane_cuts_it_off():
    assert np.flatnonzero(model_of_all().is_cut).tolist() == [0, 2, 3, 6]
    assert np.flatnonzero(model("second_cuts").is_cut).tolist() == INDEX and not random_splats().is_cut.any()


def test_kinds_are_counted_in_words_and_nothing_is_said_of_what_is_not_there():
    all_kinds = "3 of them DoG, 4 with slopes, 2 with curvatures, 3 with a cut, 3 with a second cut, 2 with shifts"
    assert kinds_of(model_of_all()) == all_kinds
    assert kinds_of(model("second_cuts", dog_index=())) == "0 of them DoG, 4 with a second cut"
    assert kinds({"n_cuts": 0, "n_second_cuts": 1234}) == "\u2013 of them DoG, 0 with a cut, 1,234 with a second cut"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"color_slopes": np.zeros((3, 3, 3))}, '"color_slopes" has 3 rows, "slope_index" has 4'),
        ({"color_slopes": np.zeros((4, 9))}, '"color_slopes" has shape [4, 9], expected [4, 3, 3]'),
        ({"slope_index": [1, 3, 4, 7]}, '"slope_index" spans 1 to 7, "means" has 7 rows'),
        ({"slope_index": [1, 4, 3, 6]}, '"slope_index" is not strictly increasing'),
        ({"brightness_curvatures": np.zeros((3, 6))}, '"brightness_curvatures" has 3 rows, "curvature_index" has 2'),
        ({"brightness_curvatures": np.zeros((2, 5))}, '"brightness_curvatures" has shape [2, 5], expected [2, 6]'),
        ({"curvature_index": [1, 7]}, '"curvature_index" spans 1 to 7, "means" has 7 rows'),
        ({"curvature_index": [1, 1]}, '"curvature_index" is not strictly increasing'),
        ({"cut_normals": np.zeros((3, 3))}, '"cut_normals" has 3 rows, "cut_index" has 4'),
        ({"cut_normals": np.zeros(4)}, '"cut_normals" has shape [4], expected [4, 3]'),
        ({"cut_index": [1, 3, 4, 7]}, '"cut_index" spans 1 to 7, "means" has 7 rows'),
        ({"cut_index": [1, 4, 4, 6]}, '"cut_index" is not strictly increasing'),
        ({"second_cut_normals": np.zeros((3, 3))}, '"second_cut_normals" has 3 rows, "second_cut_index" has 4'),
        ({"second_cut_normals": np.zeros(4)}, '"second_cut_normals" has shape [4], expected [4, 3]'),
        ({"second_cut_index": [1, 3, 4, 7]}, '"second_cut_index" spans 1 to 7, "means" has 7 rows'),
        ({"second_cut_index": [1, 4, 4, 6]}, '"second_cut_index" is not strictly increasing'),
    ],
)
def test_a_mismatch_names_both_sides(changes, message):
    with pytest.raises(ValueError) as error:
        replace(with_rows(with_rows(with_rows(model("slopes"), CURVATURES, [1, 3]), CUTS), SECOND_CUTS), **changes)
    assert message in str(error.value)


def moved_by(name: str, splats: Splats) -> tuple[Splats, np.ndarray, np.ndarray]:
    """A model after a map of ``MAPS`` and a translation; places in the primitives with rows, before and after."""
    matrix = affine(MAPS[name], (0.4, -0.3, 0.2))
    points = points_in(splats, np.arange(0, splats.n_splats, 2))
    return transformed(splats, matrix), points, points @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize(("with_rows", "shown_at", "atol"), [
    # Rounding of float32 in a mean is some 1e-7 of a world unit, in units of the thinnest scale 1e-4 of it.
    (with_slopes, slope_colors, 2e-4),
    (with_curvatures, curvature_brightness, 2e-4),
    (with_cuts, kept_shares, 1e-3),  # normals are some ten times longer
    (with_second_cuts, partial(kept_shares, plane=SECOND_CUTS), 1e-3),
], ids=["slopes", "curvatures", "cuts", "second_cuts"])  # fmt: skip
def test_a_place_shows_what_it_did_before_it_was_moved(name, with_rows, shown_at, atol):
    splats = with_rows(splats_in_view(60))
    splats.log_scales[::3, 1] = -6  # flat ones
    moved, points, moved_points = moved_by(name, splats)
    before, after = shown_at(splats, points), shown_at(moved, moved_points)
    assert before.std() > 0.2 and len(after) == 30
    np.testing.assert_allclose(after, before, atol=atol)


def test_the_identity_keeps_every_bit_and_two_mirrors_do():
    splats = with_all(splats_in_view(20))
    same(transformed(splats, np.eye(4)), splats)
    mirror = np.diag([-1.0, 1, 1, 1])
    twice = transformed(transformed(splats, mirror), mirror)
    for name in (name for group, _ in ROWS.values() for name in (group.index, *group.names)):
        np.testing.assert_array_equal(getattr(twice, name), getattr(splats, name))


@pytest.mark.parametrize("name", NAMES.values())
def test_a_map_of_what_is_not_finite_warns_of_nothing_and_leaves_the_others_alone(name):
    splats = with_all(splats_in_view(20), every=1)
    broken = replace(splats, log_scales=np.where(np.arange(20)[:, None] == 3, np.float32(800), splats.log_scales))
    matrix = np.diag([1.0, 1, 3, 1])
    got, expected = transformed(broken, matrix), transformed(splats, matrix)
    others = np.arange(20) != 3
    np.testing.assert_array_equal(getattr(got, name)[others], getattr(expected, name)[others])


@pytest.mark.parametrize("factor", [7.0, 0.25])
def test_a_brighter_model_has_brighter_slopes_and_curvatures_and_the_same_cuts(factor):
    splats = with_all(splats_in_view(20, degree=1))
    points = points_in(splats)
    bright = brightened(splats, factor)
    np.testing.assert_allclose(slope_colors(bright, points), factor * slope_colors(splats, points), rtol=1e-5)
    brighter, before = (curvature_brightness(s, points) for s in (bright, splats))
    np.testing.assert_allclose(brighter, factor * before, rtol=1e-5)
    indices = [group.index for group, _ in ROWS.values()]
    for name in (*indices, "cut_normals", "second_cut_normals"):
        np.testing.assert_array_equal(getattr(bright, name), getattr(splats, name))
