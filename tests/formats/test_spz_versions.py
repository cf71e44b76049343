"""SPZ of versions 1 to 4, byte by byte."""

import gzip
import struct
import sys

import foreign_model
import numpy as np
import pytest
import zstandard
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.formats import spz
from mi_dogsplat.formats.packing import RUB, turned
from mi_dogsplat.scene.quaternions import unit_quaternions
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError

HEADER = struct.Struct("<IIIBBBB")
N = foreign_model.N


def version_3(path) -> tuple[tuple, bytes]:
    """Header and attributes of the model as we write it."""
    write_model(path, foreign_model.model())
    data = gzip.decompress(path.read_bytes())
    return HEADER.unpack_from(data), data[HEADER.size :]


def test_version_2_has_three_bytes_for_a_rotation(tmp_path):
    _, body = version_3(tmp_path / "a.spz")
    expected = spz.read(tmp_path / "a.spz").splats
    quats = unit_quaternions(expected.quats)
    xyz = quats[:, :3] * np.where(quats[:, 3:] < 0, -1, 1)
    rotations = np.round(xyz * 127.5 + 127.5).astype(np.uint8).tobytes()
    at = N * 16
    data = HEADER.pack(0x5053474E, 2, N, 2, 12, 1, 0) + body[:at] + rotations + body[at + N * 4 :]
    (tmp_path / "b.spz").write_bytes(gzip.compress(data))
    model = read_model(tmp_path / "b.spz")
    assert model.drawing == Drawing(antialiased=True)
    found = turned(model.splats, RUB)
    for name in ("means", "log_scales", "sh_coeffs", "logit_opacities"):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name
    assert np.abs(found.quats[:, :3] - xyz).max() <= 0.5 / 127.5 + 1e-6 and found.quats[:, 3].min() >= 0
    assert np.linalg.norm(found.quats, axis=1) == pytest.approx(np.ones(N), abs=0.01)


def test_version_1_is_version_2_with_16_bit_floats_for_positions(tmp_path):
    _, body = version_3(tmp_path / "a.spz")
    expected = spz.read(tmp_path / "a.spz").splats
    at = N * 16
    rest = body[N * 9 : at] + bytes([127, 128, 0]) * N + body[at + N * 4 :]
    header = HEADER.pack(0x5053474E, 1, N, 2, 0, 0, 0)
    (tmp_path / "b.spz").write_bytes(gzip.compress(header + expected.means.astype("<f2").tobytes() + rest))
    found = turned(read_model(tmp_path / "b.spz").splats, RUB)
    assert found.means == pytest.approx(expected.means, rel=2.0**-11)
    for name in ("log_scales", "sh_coeffs", "logit_opacities"):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name
    assert found.quats[:, 2] == pytest.approx(-np.ones(N)) and np.abs(found.quats[:, [0, 1, 3]]).max() < 0.01


@pytest.mark.parametrize("degree", [0, 2])
def test_version_4_holds_a_model_without_primitives(tmp_path, degree):
    write_model(tmp_path / "a.spz", Splats.empty(degree), spz_version=4)
    read = read_model(tmp_path / "a.spz").splats
    assert (read.n_splats, read.sh_degree) == (0, degree)


def test_version_4_holds_the_bytes_of_version_3_in_streams(tmp_path):
    header, body = version_3(tmp_path / "a.spz")
    write_model(tmp_path / "b.spz", Model(foreign_model.model(), Drawing(antialiased=True)), spz_version=4)
    data = (tmp_path / "b.spz").read_bytes()
    assert HEADER.unpack_from(data) == (0x5053474E, 4, N, 2, header[4], 1, 6)
    assert struct.unpack_from("<I12s", data, 16) == (32, bytes(12))
    at, content = 32 + 6 * 16, b""
    for i in range(6):
        packed, unpacked = struct.unpack_from("<QQ", data, 32 + i * 16)
        stream = zstandard.ZstdDecompressor().decompress(data[at : at + packed])
        assert len(stream) == unpacked
        content, at = content + stream, at + packed
    assert content == body and at == len(data)
    a, b = read_model(tmp_path / "a.spz"), read_model(tmp_path / "b.spz")
    assert np.array_equal(a.splats.quats, b.splats.quats) and b.drawing.antialiased and not a.drawing.antialiased


def test_what_was_there_stays_where_version_4_cannot_be_written(tmp_path, monkeypatch):
    write_model(tmp_path / "a.spz", foreign_model.model())
    before = (tmp_path / "a.spz").read_bytes()
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(DataError, match="SPZ 4 needs the package zstandard"):
        write_model(tmp_path / "a.spz", foreign_model.model().select([0]), spz_version=4)
    assert (tmp_path / "a.spz").read_bytes() == before


def test_degree_4_and_extensions_are_left_out_and_said(tmp_path):
    header, body = version_3(tmp_path / "a.spz")
    at = N * 20
    rest = np.frombuffer(body[at:], np.uint8).reshape(N, 8, 3)
    more = np.concatenate([rest, np.full((N, 16, 3), 200, np.uint8)], axis=1)
    data = HEADER.pack(*header[:3], 4, header[4], 2, 0) + body[:at] + more.tobytes()
    (tmp_path / "b.spz").write_bytes(gzip.compress(data + b"records"))
    model = read_model(tmp_path / "b.spz")
    assert model.splats.sh_degree == 3 and model.splats.sh_coeffs[:, 9:] == pytest.approx(0.5625 * np.sign(
        model.splats.sh_coeffs[:, 9:]))  # fmt: skip
    assert model.splats.sh_coeffs[:, :9] == pytest.approx(read_model(tmp_path / "a.spz").splats.sh_coeffs)
    assert model.left_out == ("spherical harmonics of degree 4", "records of extensions")


def test_what_does_not_fit_is_refused(tmp_path):
    header, body = version_3(tmp_path / "a.spz")
    path = tmp_path / "b.spz"
    for version, degree, data, words in (
        (5, 2, body, "version 5"), (3, 5, body, "degree 5"), (3, 3, body, "primitives need"), (3, 2, body[:-1], "need"),
    ):  # fmt: skip
        path.write_bytes(gzip.compress(HEADER.pack(header[0], version, N, degree, 12, 0, 0) + data))
        with pytest.raises(DataError, match=words):
            read_model(path)
    write_model(tmp_path / "a.spz", foreign_model.model(), spz_version=4)
    data = (tmp_path / "a.spz").read_bytes()
    for broken, words in (
        (data[:20], "header"), (data[:-1], "does not fit"), (data[:15] + b"\5" + data[16:], "5 streams"),
        (data[:40] + b"\1" + data[41:], "positions"), (data[:130] + b"\xff" * 20 + data[150:], "positions"),
    ):  # fmt: skip
        path.write_bytes(broken)
        with pytest.raises(DataError, match=words):
            read_model(path)
    (at,) = struct.unpack_from("<I", data, HEADER.size)
    packed, unpacked = struct.unpack_from("<QQ", data, at)
    short = zstandard.compress(b"\0" * (unpacked - 1))
    first = at + 6 * 16  # behind the table of six streams
    table = data[:at] + struct.pack("<QQ", len(short), unpacked) + data[at + 16 : first]
    path.write_bytes(table + short + data[first + packed :])
    with pytest.raises(DataError, match=f"need {unpacked} bytes of positions, the stream has {unpacked - 1}"):
        read_model(path)
    for wrapped, words in (
        (HEADER.pack(*header) + body, "version 3; pack it with gzip"), (gzip.compress(data), "version 4; unpack it"),
    ):  # fmt: skip
        path.write_bytes(wrapped)
        with pytest.raises(DataError, match=words):
            read_model(path)
    whole = gzip.compress(HEADER.pack(*header) + body)
    for broken, words in (
        (whole[:-1], "ends before its check sum"), (whole[:-8], "ends before its check sum"),
        (whole[:-8] + bytes([whole[-8] ^ 1]) + whole[-7:], "incorrect data check"),
    ):  # fmt: skip
        path.write_bytes(broken)
        with pytest.raises(DataError, match=words):
            read_model(path)
    with pytest.raises(DataError, match="use version 3 or 4"):
        write_model(path, foreign_model.model(), spz_version=2)
