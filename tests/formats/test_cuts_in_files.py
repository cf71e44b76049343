"""Primitives that a plane cuts off: a PLY keeps them, a compressed one in bytes; others make them whole."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from cut_models import kept_shares, with_cuts
from mi_dogsplat import read_model, write_model
from mi_dogsplat.formats import compressed_ply
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.packing import morton_order
from mi_dogsplat.formats.sizes import KINDS, FileKind, by_part, prices
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.formats.trailer import CUTS, encode
from mi_dogsplat.formats.upright import upright
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.whole import whole
from mi_dogsplat.support.errors import DataError
from sloped_models import points_in, with_slopes
from splat_scenes import random_splats, rounded

NO_ROOM = [suffix for suffix, chosen in FORMATS.items() if not chosen.cuts]


def model(n: int = 2000, every: int = 3, dog_share: float = 0, slopes: bool = False) -> Splats:
    plain = rounded(random_splats(n, seed=4, degree=1, dog_share=dog_share))
    return with_cuts(with_slopes(plain, every=5) if slopes else plain, every)


def test_ply_and_compressed_ply_alone_hold_them():
    assert sorted(NO_ROOM) == [".glb", ".gltf", ".sog", ".splat", ".spz"]


@pytest.mark.parametrize("every", [1, 3, 700])
@pytest.mark.parametrize("dog_share", [0, 0.3])
@pytest.mark.parametrize("slopes", [False, True])
def test_a_compressed_ply_has_them_within_half_a_step_behind_what_else_there_is(every, dog_share, slopes, tmp_path):
    truth, path = model(2000, every, dog_share, slopes), tmp_path / "model.compressed.ply"
    path.write_bytes(compressed_ply.encode(truth))
    back, other = compressed_ply.decode(path), tmp_path / "whole.compressed.ply"
    assert np.array_equal(back.cut_index, truth.cut_index)
    logs = [np.sign(s.cut_normals) * np.log(1 + np.abs(s.cut_normals.astype(float))) for s in (back, truth)]
    assert (np.abs(logs[0] - logs[1]).max(axis=0) <= 0.501 * np.ptp(logs[1], axis=0) / 255 + 1e-6).all()
    points = points_in(truth, truth.cut_index)
    same_planes = replace(truth, cut_normals=back.cut_normals)
    assert np.abs(kept_shares(same_planes, points) - kept_shares(truth, points)).mean() < 0.01
    other.write_bytes(compressed_ply.encode(truth.without_cuts()))
    for name, values in vars(compressed_ply.decode(other)).items():
        if "cut" not in name:
            np.testing.assert_array_equal(getattr(back, name), values)


def test_rows_by_hand():
    normals = np.array([[0, -1, 0], [0, 0, 3.0]])  # -log 2 and log 4, each the end of its column
    cut = replace(rounded(random_splats(600, dog_share=0)), cut_index=[2, 258], cut_normals=normals)
    comments, trailer = encode(cut)
    assert comments == ["dogsplat cuts 1 3"]
    low, high = np.array(struct.unpack_from("<6f", trailer)).reshape(2, 3)
    assert low == pytest.approx([0, -np.log(2), 0], abs=1e-6) and high == pytest.approx([0, 0, np.log(4)], abs=1e-6)
    rows = np.frombuffer(trailer, np.uint8, offset=24).reshape(3, 4)
    assert rows[0].tolist() == [2, 0, 0, 0] and rows[1, 0] == 255 and rows[2].tolist() == [0, 0, 255, 255]


def test_a_row_takes_four_bytes_and_the_three_kinds_stand_in_their_order():
    full = model(every=2, dog_share=0.5, slopes=True)
    added = len(compressed_ply.encode(full)) - len(compressed_ply.encode(full.without_cuts()))
    assert added == CUTS.size(1000) + len("comment dogsplat cuts 1 1000\n") and CUTS.size(1000) == 24 + 4 * 1000
    assert [line.split()[1] for line in encode(full)[0]] == ["dog", "slopes", "cuts"]


def test_they_go_through_a_file_by_name_in_its_order(tmp_path):
    truth = model(dog_share=0.3)
    for name in ("a.compressed.ply", "a.ply"):
        assert write_model(tmp_path / name, truth) == []
    back, expected = read_model(tmp_path / "a.compressed.ply").splats, truth.select(morton_order(truth.means))
    assert np.array_equal(back.cut_index, expected.cut_index)
    np.testing.assert_allclose(back.cut_normals, expected.cut_normals, atol=0.03, rtol=0.03)
    np.testing.assert_array_equal(read_model(tmp_path / "a.ply").splats.cut_normals, truth.cut_normals)


@pytest.mark.parametrize("suffix", NO_ROOM)
def test_other_formats_have_the_nearest_whole_ones_and_a_line_that_says_so(suffix, tmp_path):
    truth = model(300, slopes=True)
    lost = write_model(tmp_path / f"with{suffix}", truth)
    said = f"{FORMATS[suffix].name} has no primitive that is cut off: 100 become the whole ones nearest to them"
    assert lost.count(said) == 1
    assert write_model(tmp_path / f"without{suffix}", whole(truth)) == [x for x in lost if x != said]
    assert (tmp_path / f"with{suffix}").read_bytes() == (tmp_path / f"without{suffix}").read_bytes()
    assert read_model(tmp_path / f"with{suffix}").splats.n_cuts == 0 and truth.n_cuts == 100


def test_an_upright_model_is_cut_off_at_the_same_places():
    truth = with_cuts(random_splats(30))
    turned, matrix = upright(Model(truth, Drawing(up="x", scale=0.3)))
    points = points_in(truth, truth.cut_index)
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(kept_shares(turned.splats, moved), kept_shares(truth, points), atol=1e-3)


@pytest.mark.parametrize("normal", [0.0, 1e38, -3e38])
def test_normals_of_any_size_can_be_read_again(normal, tmp_path):
    path = tmp_path / "a.compressed.ply"
    cut = model(20)
    cut.cut_normals[:], cut.cut_normals[1, 2] = normal, 1
    path.write_bytes(compressed_ply.encode(cut))
    found = compressed_ply.decode(path).cut_normals[0, 0]
    assert np.isfinite(found) and (found == 0 if normal == 0 else 1e36 < found / np.sign(normal) < 1e38)


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda b: b.replace(b"cuts 1 ", b"cuts 2 "), "its cut rows are of version 2, known is 1"),
        (lambda b: b.replace(b"cuts 1 ", b"cats 1 "), "0 cut rows are 0"),
        (lambda b: b.replace(b"slopes 1 ", b"slides 1 "), "0 slope rows are 0"),
        (lambda b: b[:-1], "bytes follow the last element"),
        (lambda b: b[:-4] + b"\xfe" + b[-3:], "a cut row is for primitive"),
    ],
)
def test_damage_is_told_in_one_line(damage, complaint, tmp_path):
    path = tmp_path / "a.compressed.ply"
    before = compressed_ply.encode(model(dog_share=0.3, slopes=True))
    after = damage(before)
    assert after != before
    path.write_bytes(after)
    with pytest.raises(DataError) as error:
        read_model(path)
    assert complaint in str(error.value) and len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("bounds", [(np.nan,) * 6, (1, *(0,) * 5), (0,) * 3 + (90.0,) * 3])
def test_bounds_that_make_no_sense_are_refused(bounds, tmp_path):
    path, (_, trailer) = tmp_path / "a.compressed.ply", encode(model())
    content = compressed_ply.encode(model())
    path.write_bytes(content[: -len(trailer)] + struct.pack("<6f", *bounds) + trailer[CUTS.bounds_bytes :])
    with pytest.raises(DataError, match="bounds of its cut rows"):
        read_model(path)


@pytest.mark.parametrize("dog_share", [0, 0.3])
def test_the_price_of_a_row_is_that_of_the_file(dog_share):
    splats = model(500, dog_share=dog_share, slopes=True).with_sh_degrees(np.arange(500) % 2)
    kind = FileKind("ply")
    known, others = prices(kind, splats), splats.without_cuts()
    header = [kind.encoded(s).index(b"end_header\n") for s in (splats, others)]
    assert known.cuts == 16 and known.scaled(3).cuts == 48
    assert known.of(splats) - known.of(others) == kind.size(splats) - kind.size(others) - (header[0] - header[1])


@pytest.mark.parametrize("name", KINDS)
def test_parts_add_up_to_the_file(name):
    splats = model(400, dog_share=0.3, slopes=True)
    parts, others = by_part(FileKind(name), splats), by_part(FileKind(name), splats.without_cuts())
    assert sum(parts.values()) == FileKind(name).size(splats)
    assert list(parts)[-1] == "cuts" if name == "ply" else "cuts" not in parts
    assert {part: size for part, size in parts.items() if part != "cuts"} == others


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_what_a_training_will_end_as_has_none_where_the_format_has_none(name):
    splats = model(400, dog_share=0.3)
    assert FileKind(name).foreseen(splats).n_cuts == 0 and prices(FileKind(name), splats).cuts == 0
    assert FileKind("ply").foreseen(splats) is splats
