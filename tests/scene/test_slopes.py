"""Colours that vary over their primitive: in memory, in a PLY file, under maps and in another unit of light."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.scene.ply import read_ply, write_ply
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.errors import DataError
from ply_files import dog_columns, random_splats, slope_columns, to_bytes, vertex_columns, write
from sloped_models import points_in, slope_colors, with_slopes
from splat_scenes import axis_rotation
from splat_scenes import random_splats as splats_in_view

INDEX = [1, 3, 4, 6]
FIELDS = tuple(Splats.__dataclass_fields__)
TURN = axis_rotation([1, -2, 0.7], 2.1)[0]
MIRROR = np.eye(3) - 2 * np.outer([0.6, 0, 0.8], [0.6, 0, 0.8])
SHEAR = np.array([[1.2, 0.5, 0], [0, 0.7, -0.3], [0.1, 0, 2.0]])
MAPS = {"turn": TURN, "mirror": MIRROR, "scale": 1.7 * np.eye(3), "point mirror": -0.4 * TURN, "shear": SHEAR,
        "mirrored shear": SHEAR @ MIRROR, "stretch": np.diag([1.0, 1, 3])}  # fmt: skip


def model(index=INDEX, **others) -> Splats:
    slopes = np.random.default_rng(8).normal(size=(len(index), 3, 3))
    return replace(random_splats(**others), slope_index=np.array(index, np.uint32), color_slopes=slopes)


def elements(splats: Splats, **slopes) -> dict:
    columns = {name: values for name, values in (slope_columns(splats) | slopes).items() if values is not None}
    return {"vertex": vertex_columns(splats), "slopes": columns}


def same(a: Splats, b: Splats):
    for name in FIELDS:
        left, right = getattr(a, name), getattr(b, name)
        assert left.shape == right.shape and left.tobytes() == right.tobytes(), name


@pytest.mark.parametrize("index", [INDEX, [0], list(range(7)), []])
@pytest.mark.parametrize("dog_index", [(0, 3, 4), ()])
@pytest.mark.parametrize("sh_degree", [0, 3])
def test_a_written_model_comes_back_bit_for_bit(tmp_path, index, dog_index, sh_degree):
    splats = model(index, dog_index=dog_index, sh_degree=sh_degree)
    write_ply(tmp_path / "a.ply", splats)
    assert (b"element slopes" in (tmp_path / "a.ply").read_bytes()) == bool(index)
    same(read_ply(tmp_path / "a.ply"), splats)


@pytest.mark.parametrize("layout", ["3dgs", "rows"])
def test_slopes_stand_beside_degrees_of_single_primitives(tmp_path, layout):
    mixed = model().with_sh_degrees([3, 0, 1, 2, 0, 3, 1])
    assert mixed.n_slopes == 4
    write_ply(tmp_path / "a.ply", mixed, layout)
    same(read_ply(tmp_path / "a.ply"), mixed if layout == "rows" else mixed.uniform_sh())


def test_the_file_has_the_fixed_layout_byte_for_byte(tmp_path):
    splats = model(dog_index=(0, 3))
    write_ply(tmp_path / "with.ply", splats)
    write_ply(tmp_path / "without.ply", splats.without_slopes())
    dog = {"index": splats.dog_index, **dog_columns(splats)}
    rows = to_bytes({"vertex": vertex_columns(splats), "dog": dog, **elements(splats)}, types={"index": "uint"})
    header, body = (tmp_path / "with.ply").read_bytes().split(b"end_header\n", 1)
    expected_header, expected_body = rows.split(b"end_header\n", 1)
    assert header.endswith(expected_header[expected_header.index(b"element slopes"):])
    size = 4 * (1 + 9) * splats.n_slopes
    assert body[-size:] == expected_body[-size:]
    shorter_header, shorter = (tmp_path / "without.ply").read_bytes().split(b"end_header\n", 1)
    assert body[:-size] == shorter and header.startswith(shorter_header)


@pytest.mark.parametrize("file_format", ["binary_little_endian", "binary_big_endian", "ascii"])
def test_rows_in_any_order_are_sorted_with_their_values(tmp_path, file_format):
    splats = model(dog_index=())
    order = [2, 0, 3, 1]
    shuffled = {name: values[order] for name, values in slope_columns(splats).items()}
    data = to_bytes(elements(splats, **shuffled), file_format, {"index": "uint"})
    same(read_ply(write(tmp_path, data)), splats)


@pytest.mark.parametrize(
    ("slopes", "types", "message"),
    [
        ({"index": np.array([1, 3, 4, 7])}, {}, 'row 3 of the element "slopes" has index 7, but the model has 7 primi'),
        ({"index": np.array([-1, 3, 4, 5])}, {"index": "int"}, 'row 0 of the element "slopes" has index -1, but the'),
        ({"index": np.array([1, 3.5, 4, 5])}, {"index": "float"}, 'row 1 of the element "slopes" has index 3.5, but'),
        ({"index": np.array([1, 4, 3, 4])}, {}, 'the element "slopes" names primitive 4 more than once; write the sl'),
        ({"index": None}, {}, '"index"'),
        ({"slope_5": None}, {}, '"slope_5"'),
        ({"slope_2": np.array([0, 1, np.nan, 0])}, {}, '"slope_2" in row 2'),
        ({"slope_8": np.array([0, -np.inf, 1, 0])}, {}, '"slope_8" in row 1'),
    ],
)
def test_what_is_wrong_with_the_rows_is_one_line(tmp_path, slopes, types, message):
    splats = model(dog_index=())
    path = write(tmp_path, to_bytes(elements(splats, **slopes), types={"index": "uint"} | types))
    with pytest.raises(DataError) as error:
        read_ply(path)
    assert message in str(error.value) and "\n" not in str(error.value) and "slope" in str(error.value)


def test_slopes_that_are_not_finite_are_not_written(tmp_path):
    splats = model()
    splats.color_slopes[2, 1, 0] = np.inf
    with pytest.raises(DataError, match='"slope_3" in row 2; nothing was written'):
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
def test_selected_primitives_keep_their_own_slopes(which, index, rows):
    chosen = model().select(which)
    assert chosen.slope_index.tolist() == index and chosen.n_slopes == len(index)
    np.testing.assert_array_equal(chosen.color_slopes, model().color_slopes[rows])


def test_without_slopes_all_else_stays():
    splats = model()
    flat = splats.without_slopes()
    assert (splats.n_slopes, flat.n_slopes, flat.n_dog) == (4, 0, 3) and flat.color_slopes.shape == (0, 3, 3)
    for name in FIELDS:
        if "slope" not in name:
            np.testing.assert_array_equal(getattr(flat, name), getattr(splats, name))
            assert not np.shares_memory(getattr(flat, name), getattr(splats, name))
    assert splats.plain().n_slopes == 4 and splats.plain().n_dog == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"color_slopes": np.zeros((3, 3, 3))}, '"color_slopes" has 3 rows, "slope_index" has 4'),
        ({"color_slopes": np.zeros((4, 9))}, '"color_slopes" has shape [4, 9], expected [4, 3, 3]'),
        ({"slope_index": [1, 3, 4, 7]}, '"slope_index" spans 1 to 7, "means" has 7 rows'),
        ({"slope_index": [1, 4, 3, 6]}, '"slope_index" is not strictly increasing'),
    ],
)
def test_a_mismatch_names_both_sides(changes, message):
    with pytest.raises(ValueError) as error:
        replace(model(), **changes)
    assert message in str(error.value)


@pytest.mark.parametrize("name", MAPS)
def test_the_colour_of_a_place_is_that_of_the_place_where_it_is_moved_to(name):
    splats = with_slopes(splats_in_view(60))
    splats.log_scales[::3, 1] = -6  # flat ones
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = MAPS[name], (0.4, -0.3, 0.2)
    points = points_in(splats)
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    before, after = slope_colors(splats, points), slope_colors(transformed(splats, matrix), moved)
    assert np.abs(before).mean() > 0.2
    # Rounding of float32 in a mean is some 1e-7 of a world unit, in units of the thinnest scale 1e-4 of it.
    np.testing.assert_allclose(after, before, atol=2e-4)


def test_the_identity_keeps_every_bit_and_two_mirrors_do():
    splats = with_slopes(splats_in_view(20))
    same(transformed(splats, np.eye(4)), splats)
    mirror = np.diag([-1.0, 1, 1, 1])
    twice = transformed(transformed(splats, mirror), mirror)
    np.testing.assert_array_equal(twice.color_slopes, splats.color_slopes)
    np.testing.assert_array_equal(twice.slope_index, splats.slope_index)


def test_a_map_of_what_is_not_finite_warns_of_nothing_and_leaves_the_others_alone():
    splats = with_slopes(splats_in_view(20), every=1)
    broken = replace(splats, log_scales=np.where(np.arange(20)[:, None] == 3, np.float32(800), splats.log_scales))
    matrix = np.diag([1.0, 1, 3, 1])
    got, expected = transformed(broken, matrix), transformed(splats, matrix)
    others = np.arange(20) != 3
    np.testing.assert_array_equal(got.color_slopes[others], expected.color_slopes[others])


@pytest.mark.parametrize("factor", [7.0, 0.25])
def test_a_brighter_model_has_brighter_slopes(factor):
    splats = with_slopes(splats_in_view(20, degree=1))
    points = points_in(splats)
    bright = brightened(splats, factor)
    np.testing.assert_allclose(slope_colors(bright, points), factor * slope_colors(splats, points), rtol=1e-5)
    np.testing.assert_array_equal(bright.slope_index, splats.slope_index)
