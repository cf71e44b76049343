"""Colours that vary over their primitive: a PLY keeps them, a compressed one in bytes; others say that they do not."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.formats import compressed_ply
from mi_dogsplat.formats.packing import morton_order
from mi_dogsplat.formats.sizes import KINDS, FileKind, by_part, prices
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.formats.trailer import SLOPES, encode
from mi_dogsplat.formats.upright import upright
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from sloped_models import points_in, slope_colors, with_slopes
from splat_scenes import random_splats, rounded

GAPS = [0, 1, 254, 255, 256, 257, 511, 512, 768, 1999]  # primitives with slopes: steps around those of a byte
NO_ROOM = [suffix for suffix, chosen in FORMATS.items() if not chosen.slopes]


def model(index=tuple(GAPS), n: int = 2000, dog_share: float = 0) -> Splats:
    plain = rounded(random_splats(n, seed=4, degree=1, dog_share=dog_share))
    slopes = np.random.default_rng(1).standard_cauchy((len(index), 3, 3)) * 0.1  # a few of them strong
    return replace(plain, slope_index=np.array(index, np.uint32), color_slopes=np.clip(slopes, -5, 5))


def test_ply_and_compressed_ply_alone_hold_them():
    assert sorted(NO_ROOM) == [".glb", ".gltf", ".sog", ".splat", ".spz"]


@pytest.mark.parametrize("index", [GAPS, [0], [1999], [1020], list(range(2000)), []])
@pytest.mark.parametrize("dog_share", [0, 0.3])
def test_a_compressed_ply_has_them_within_half_a_step(index, dog_share, tmp_path):
    truth, path = model(index, dog_share=dog_share), tmp_path / "model.compressed.ply"
    path.write_bytes(compressed_ply.encode(truth))
    back, flat = compressed_ply.decode(path), tmp_path / "flat.compressed.ply"
    assert np.array_equal(back.slope_index, truth.slope_index)
    logs = [np.sign(s.color_slopes) * np.log(1 + 64 * np.abs(s.color_slopes.astype(float))) for s in (back, truth)]
    if len(index):
        steps = np.ptp(logs[1], axis=0) / 255
        assert (np.abs(logs[0] - logs[1]).max(axis=0) <= 0.501 * steps + 1e-5).all()
        assert np.abs(back.color_slopes - truth.color_slopes).mean() < 0.01
    flat.write_bytes(compressed_ply.encode(truth.without_slopes()))
    others = compressed_ply.decode(flat)
    for name in ("means", "quats", "sh_coeffs", "dog_index", "dog_logit_opacities", "dog_log_scales"):
        np.testing.assert_array_equal(getattr(back, name), getattr(others, name))


def test_rows_by_hand():
    slopes = np.zeros((2, 3, 3))
    slopes[0, 0, 1], slopes[1, 2, 2] = -1 / 64, 3 / 64  # -log 2 and log 4, each the end of its column
    index = {"slope_index": np.array([2, 258]), "color_slopes": slopes}
    comments, trailer = encode(replace(model([], n=600), **index))
    assert comments == ["dogsplat slopes 1 3"]
    low, high = np.array(struct.unpack_from("<18f", trailer)).reshape(2, 9)
    assert low == pytest.approx([0, -np.log(2), 0, 0, 0, 0, 0, 0, 0], abs=1e-6)
    assert high == pytest.approx([0, 0, 0, 0, 0, 0, 0, 0, np.log(4)], abs=1e-6)
    rows = np.frombuffer(trailer, np.uint8, offset=72).reshape(3, 10)
    assert rows[0].tolist() == [2, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    assert rows[1, 0] == 255 and rows[2].tolist() == [0, 0, 255, 0, 0, 0, 0, 0, 0, 255]


def test_a_row_takes_ten_bytes_and_a_model_without_slopes_none():
    every_second = model(range(0, 2000, 2))
    flat = compressed_ply.encode(every_second.without_slopes())
    added = len(compressed_ply.encode(every_second)) - len(flat)
    assert added == 72 + 10 * 1000 + len("comment dogsplat slopes 1 1000\n")
    assert b"dogsplat" not in flat


def test_they_go_through_a_compressed_ply_by_name_in_its_order_and_in_units_of_white(tmp_path):
    truth = model(dog_share=0.3)
    write_model(tmp_path / "a.compressed.ply", truth)
    back, expected = read_model(tmp_path / "a.compressed.ply").splats, truth.select(morton_order(truth.means))
    assert np.array_equal(back.slope_index, expected.slope_index)
    np.testing.assert_allclose(back.color_slopes, expected.color_slopes, atol=0.2, rtol=0.03)
    linear = Model(brightened(truth, 40.0), Drawing(linear=True, white=40.0))
    assert write_model(tmp_path / "b.compressed.ply", linear) == []
    np.testing.assert_allclose(read_model(tmp_path / "b.compressed.ply").splats.color_slopes, 40 * back.color_slopes,
                               rtol=1e-3, atol=1e-4)  # fmt: skip


@pytest.mark.parametrize("suffix", NO_ROOM)
def test_other_formats_have_mean_colours_and_a_line_that_says_so(suffix, tmp_path):
    truth = model()
    lost = write_model(tmp_path / f"with{suffix}", truth)
    name = FORMATS[suffix].name
    said = f"{name} has no colour that varies over a primitive: the slopes of 10 are left out"
    assert lost.count(said) == 1
    assert write_model(tmp_path / f"without{suffix}", truth.without_slopes()) == [x for x in lost if x != said]
    assert (tmp_path / f"with{suffix}").read_bytes() == (tmp_path / f"without{suffix}").read_bytes()
    assert read_model(tmp_path / f"with{suffix}").splats.n_slopes == 0 and truth.n_slopes == 10


@pytest.mark.parametrize("sh_rows", [False, True])
def test_a_ply_says_nothing_as_it_keeps_them(sh_rows, tmp_path):
    truth = model(dog_share=0.3)
    assert write_model(tmp_path / "a.ply", truth, sh_rows=sh_rows) == []
    np.testing.assert_array_equal(read_model(tmp_path / "a.ply").splats.color_slopes, truth.color_slopes)


def test_an_upright_model_has_the_same_colours_where_its_points_are():
    truth = with_slopes(random_splats(30))
    turned, matrix = upright(Model(truth, Drawing(up="x", scale=0.3)))
    points = points_in(truth)
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(slope_colors(turned.splats, moved), slope_colors(truth, points), atol=2e-4)


@pytest.mark.parametrize("bounds", [(np.nan,) * 18, (1, *(0,) * 17), (0,) * 17 + (np.inf,), (0,) * 9 + (1e5,) * 9])
def test_bounds_that_make_no_sense_are_refused(bounds, tmp_path):
    path, (_, trailer) = tmp_path / "a.compressed.ply", encode(model())
    content = compressed_ply.encode(model())
    path.write_bytes(content[: -len(trailer)] + struct.pack("<18f", *bounds) + trailer[SLOPES.bounds_bytes :])
    with pytest.raises(DataError, match="bounds of its slope rows"):
        read_model(path)


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda b: b.replace(b"slopes 1 ", b"slopes 2 "), "its slope rows are of version 2, known is 1"),
        (lambda b: b.replace(b"slopes 1 ", b"slides 1 "), "0 slope rows are 0"),
        (lambda b: b.replace(b"dog 1 ", b"fog 1 "), "0 DoG rows are 0"),
        (lambda b: b[:-1], "bytes follow the last element"),
        (lambda b: b + b"x", "bytes follow the last element"),
        (lambda b: b[:-10] + b"\xfe" + b[-9:], "a slope row is for primitive"),
    ],
)
def test_damage_is_told_in_one_line(damage, complaint, tmp_path):
    path = tmp_path / "a.compressed.ply"
    before = compressed_ply.encode(model(dog_share=0.3))
    after = damage(before)
    assert after != before
    path.write_bytes(after)
    with pytest.raises(DataError) as error:
        read_model(path)
    assert complaint in str(error.value) and len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("dog_share", [0, 0.3])
def test_the_price_of_a_row_is_that_of_the_file(dog_share):
    splats = model(range(0, 500, 3), n=500, dog_share=dog_share).with_sh_degrees(np.arange(500) % 2)
    kind = FileKind("ply")
    known, flat = prices(kind, splats), splats.without_slopes()
    header = [kind.encoded(s).index(b"end_header\n") for s in (splats, flat)]
    assert known.slopes == 40 and known.scaled(3).slopes == 120
    assert known.of(splats) - known.of(flat) == kind.size(splats) - kind.size(flat) - (header[0] - header[1])


@pytest.mark.parametrize("name", KINDS)
def test_parts_add_up_to_the_file(name):
    splats = model(range(0, 400, 3), n=400, dog_share=0.3)
    parts, flat = by_part(FileKind(name), splats), by_part(FileKind(name), splats.without_slopes())
    assert sum(parts.values()) == FileKind(name).size(splats)
    assert list(parts)[-1] == "slopes" if name == "ply" else "slopes" not in parts
    assert {part: size for part, size in parts.items() if part != "slopes"} == flat


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_what_a_training_will_end_as_has_none_where_the_format_has_none(name):
    splats = model(range(0, 400, 3), n=400, dog_share=0.3)
    assert FileKind(name).foreseen(splats).n_slopes == 0 and prices(FileKind(name), splats).slopes == 0
    assert FileKind("ply").foreseen(splats) is splats
