"""Reading and writing a model of any format: the axes, what travels with it, what a file is, and bad files."""

import errno
import gzip
import io
import json
import struct
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, Splats, read_model, write_model, write_ply
from mi_dogsplat.formats.packing import unit_quats
from mi_dogsplat.formats.read import read_source, size_of
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.scene.drawing import comments_of, drawing_of
from mi_dogsplat.scene.orientation import AXES
from mi_dogsplat.support.errors import DataError
from PIL import Image
from ply_files import random_splats, to_bytes, vertex_columns
from scipy.spatial.transform import Rotation

EVERYTHING = Drawing(antialiased=True, near_clip=0.0625, linear=True, up="-x", scale=2.5)
LOSSLESS = (".ply", ".glb", ".gltf")


def written(path: Path, model: Model | Splats, **how) -> Path:
    write_model(path, model, **how)
    return path


def nearest(back: Splats, model: Splats) -> Splats:
    """The primitives of ``model`` in the order of ``back``."""
    distance = np.abs(back.means[:, None] - model.means[None]).max(axis=-1)  # [N, N]
    assert distance.min(axis=1).max() < 0.01 and len(set(distance.argmin(axis=1))) == model.n_splats
    return model.select(distance.argmin(axis=1))


def covariances(model: Splats) -> np.ndarray:
    """[N, 3, 3]: several quaternions are one ellipsoid."""
    axes = Rotation.from_quat(unit_quats(model)).as_matrix() * np.exp(model.log_scales)[:, None]
    return axes @ axes.transpose(0, 2, 1)


# --- what is read is what was written ---


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_gives_the_model_back_in_its_own_axes(tmp_path, suffix, degree):
    full = foreign_model.model()
    model = replace(full, sh_coeffs=np.pad(full.sh_coeffs, ((0, 0), (0, 7), (0, 0)))[:, : (degree + 1) ** 2])
    back = read_model(written(tmp_path / f"a{suffix}", model)).splats
    assert back.sh_degree == (0 if suffix == ".splat" else degree)
    model = nearest(back, model)
    exact = 1e-5 if suffix in LOSSLESS else 0.05
    largest = np.exp(2 * model.log_scales.max(axis=1))[:, None, None]
    assert covariances(back) / largest == pytest.approx(covariances(model) / largest, abs=1.5 * exact, rel=exact)
    assert back.opacities == pytest.approx(model.opacities, abs=0.003)
    kept = slice(1) if suffix in (".splat", ".sog") else slice(None)  # a palette has fewer entries than primitives
    assert back.sh_coeffs[:, kept] == pytest.approx(model.sh_coeffs[:, kept], abs=exact)


def test_ply_and_gltf_keep_every_bit_of_what_they_hold_raw(tmp_path):
    model = foreign_model.model()
    for suffix in LOSSLESS:
        back = read_model(written(tmp_path / f"a{suffix}", model)).splats
        assert np.array_equal(back.means, model.means) and np.array_equal(back.sh_coeffs, model.sh_coeffs)


@pytest.mark.parametrize("suffix", FORMATS)
def test_what_a_format_can_say_of_the_drawing_travels_and_the_rest_is_named_in_one_line(tmp_path, suffix):
    lost = write_model(tmp_path / f"a{suffix}", Model(foreign_model.model(), EVERYTHING))
    carries = FORMATS[suffix].carries
    kept = {name: value for name, value in EVERYTHING.said().items() if name in carries}
    assert read_model(tmp_path / f"a{suffix}").drawing == Drawing(**kept)
    missing = [name for name in EVERYTHING.said() if name not in carries]
    assert all(any(f"{name} " in line for line in lost) for name in missing) and all("\n" not in line for line in lost)
    assert bool(lost) == bool(missing or suffix == ".splat")
    assert len(carries) >= 1 or suffix == ".splat"


def test_a_format_that_cannot_say_what_is_usual_loses_nothing(tmp_path):
    usual = Drawing(antialiased=False, near_clip=0.2, linear=False, scale=1.0)
    assert write_model(tmp_path / "a.spz", Model(foreign_model.model(), usual)) == []


@pytest.mark.parametrize(("suffix", "low", "high", "said"), [
    (".spz", -10, 5.9375, "SPZ has no scales below 4.54e-05 or above 379, to which it clamps 2 primitives"),
    (".compressed.ply", -20, 20, "compressed PLY has no scales below 2.06e-09 or above 4.85e+08, to which it clamps 2"),
    (".sog", -10, 20, ""),
])  # fmt: skip
def test_scales_that_a_format_cannot_say_are_told(tmp_path, suffix, low, high, said):
    model = foreign_model.model()
    log_scales = model.log_scales.copy()
    log_scales[0], log_scales[1], log_scales[2] = low - 2, (0, high + 1, 0), (0, 0, low - 2)  # the last is just flat
    lost = write_model(tmp_path / f"a{suffix}", replace(model, log_scales=log_scales))
    assert len(lost) == bool(said) and all(line.startswith(said) for line in lost)


@pytest.mark.parametrize("suffix", [".ply", ".sog", ".glb"])
def test_a_drawing_may_be_told_in_numbers_of_numpy(tmp_path, suffix):
    told: dict[str, Any] = {"antialiased": np.True_, "near_clip": np.float32(0.25), "scale": np.float64(0.5)}
    write_model(tmp_path / f"a{suffix}", Model(foreign_model.model(), Drawing(**told)))
    read = read_model(tmp_path / f"a{suffix}").drawing
    assert (read.antialiased, read.near_clip, read.scale) == (True, 0.25, 0.5)


@pytest.mark.parametrize("told", [{"near_clip": -1.0}, {"white": 0.0}, {"up": "upwards"}, {"scale": float("nan")}])
@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_a_drawing_that_no_reader_would_take_is_not_written(tmp_path, suffix, told: dict[str, Any]):
    (name,) = told
    with pytest.raises(DataError, match=f'"{name}" of the drawing is'):
        write_model(tmp_path / f"a{suffix}", Model(foreign_model.model(), Drawing(**told)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("farthest", "moved"), [(1000.0, 0), (1e6, foreign_model.N), (1e8, foreign_model.N)])
def test_a_primitive_far_away_that_leaves_spz_no_room_for_the_others_is_told(tmp_path, farthest, moved):
    model = foreign_model.model()
    means = model.means.copy()
    means[0, 0] = farthest
    tiny = replace(model, means=means, log_scales=np.full_like(model.log_scales, -9))
    lost = write_model(tmp_path / "a.spz", tiny)
    back = read_model(tmp_path / "a.spz").splats.means
    away = np.abs(back[:, None] - means[None]).max(axis=-1).min(axis=0)  # [N] from each to any in the file
    assert (away > np.exp(-9)).sum() == moved
    said = f"SPZ has 24 bits for a coordinate: with one of {farthest:.3g} it moves {moved} primitives by more than "
    assert lost == ([said + "their size"] if moved else [])


@pytest.mark.parametrize("suffix", [".sog", ".spz", ".compressed.ply"])
def test_places_farther_apart_than_float32_can_say_are_written(tmp_path, suffix):
    model = foreign_model.model()
    means = model.means.copy()
    means[:2, 0] = 3e38, -3e38
    back = read_model(written(tmp_path / f"a{suffix}", replace(model, means=means))).splats.means[:, 0]
    farthest = 2.0**23 if suffix == ".spz" else 3e38
    assert np.sort(back)[[0, -1]] == pytest.approx([-farthest, farthest], rel=1e-2)


def test_not_antialiased_is_told_from_nothing_said(tmp_path):
    model = foreign_model.model()
    for suffix in (".ply", ".sog", ".glb", ".compressed.ply"):
        assert read_model(written(tmp_path / f"a{suffix}", model)).drawing.antialiased is None
        assert read_model(written(tmp_path / f"a{suffix}", Model(model, Drawing(False)))).drawing.antialiased is False


@pytest.mark.parametrize("suffix", [suffix for suffix in FORMATS if not FORMATS[suffix].dog])
def test_dog_is_never_lost_in_silence(tmp_path, suffix):
    with pytest.raises(DataError, match="DoG.*bake"):
        write_model(tmp_path / f"a{suffix}", random_splats(5, 1, (1,)))
    assert not list(tmp_path.iterdir())


def test_dog_and_drawing_are_in_one_ply(tmp_path):
    model = random_splats(5, 1, (1, 3))
    back = read_model(written(tmp_path / "a.ply", Model(model, EVERYTHING)))
    assert back.splats.n_dog == 2 and back.drawing == EVERYTHING
    assert np.array_equal(back.splats.dog_log_scales, model.dog_log_scales)


@pytest.mark.parametrize("suffix", FORMATS)
def test_sh_degrees_of_single_primitives_are_filled_up_unless_rows_are_asked_for(tmp_path, suffix):
    full = foreign_model.model()
    model = full.with_sh_degrees(np.arange(12) % 3)
    back = read_model(written(tmp_path / f"a{suffix}", model)).splats
    assert not back.mixed_sh and back.sh_degree == (0 if suffix == ".splat" else 2)
    if suffix in LOSSLESS:
        assert np.array_equal(back.sh_coeffs, model.uniform_sh().sh_coeffs)
    back = read_model(written(tmp_path / f"b{suffix}", model, sh_rows=True)).splats
    assert back.mixed_sh == (suffix == ".ply")
    if suffix == ".ply":
        assert np.array_equal(back.sh_degrees, model.sh_degrees)


# --- comments of PLY ---


@pytest.mark.parametrize("up", [*AXES, None])
@pytest.mark.parametrize("antialiased", [True, False, None])
def test_comments_say_what_they_were_made_of(up, antialiased):
    drawing = Drawing(antialiased=antialiased, near_clip=1 / 3, up=up)
    assert drawing_of(comments_of(drawing)) == drawing


def test_a_direction_with_spaces_is_one_word_of_a_comment():
    comments = comments_of(Drawing(up="0.1, -0.9,\n0.4"))
    assert comments == ["dogsplat up 0.1,-0.9,0.4"]
    assert drawing_of(comments) == Drawing(up="0.1,-0.9,0.4")


@pytest.mark.parametrize(("comments", "expected"), [
    (["Exported from Brush", "Vertical axis: y", "SH degree: 2", "SplatRenderMode: mip"], Drawing(True, up="-y")),
    (["Vertical axis: Z", "SplatRenderMode: default"], Drawing(False, up="-z")),
    (["antialiased 1"], Drawing(True)),
    (["dogsplat antialiased false", "SplatRenderMode: mip"], Drawing(False)),
    (["SplatRenderMode: mip", "dogsplat antialiased maybe"], Drawing(True)),
    (["dogsplat near_clip nan", "dogsplat near_clip -1", "dogsplat scale 0", "dogsplat up w"], Drawing()),
    (["dogsplat near_clip 0", "dogsplat up", "dogsplat", "antialiased 2", "by dogsplat"], Drawing(None, 0.0)),
])  # fmt: skip
def test_comments_of_other_programs_are_understood_and_nonsense_is_passed_over(tmp_path, comments, expected):
    assert drawing_of(comments) == expected
    write_ply(tmp_path / "a.ply", foreign_model.model(), comments=comments)
    assert read_model(tmp_path / "a.ply").drawing == expected


@pytest.mark.parametrize("file_format", ["binary_little_endian", "binary_big_endian", "ascii"])
def test_dialects_of_ply_are_read(tmp_path, file_format):
    model = random_splats(6, 2, ())
    columns = vertex_columns(model)  # in any order, with columns of others, without normals
    shuffled = {name: columns[name] for name in sorted(columns, reverse=True)} | {"confidence": np.ones(6)}
    header, data = to_bytes({"vertex": shuffled}, file_format).split(b"end_header\n", 1)
    (tmp_path / "a.ply").write_bytes(header + b"comment SplatRenderMode: mip\nend_header\n" + data)
    read = read_model(tmp_path / "a.ply")
    assert read.splats.sh_coeffs == pytest.approx(model.sh_coeffs) and read.drawing == Drawing(antialiased=True)


# --- what a file is ---


@pytest.mark.parametrize("suffix", [suffix for suffix in FORMATS if suffix != ".splat"])
def test_content_tells_a_format_before_the_name_does(tmp_path, suffix):
    path = written(tmp_path / f"a{suffix}", foreign_model.model())
    expected = read_model(path).splats
    for name in ("model", "model.bin", "model.splat", "model.ply"):
        assert np.array_equal(read_model(path.rename(tmp_path / name)).splats.means, expected.means)
        path = tmp_path / name


def test_a_compressed_ply_is_one_after_long_comments(tmp_path):
    path = written(tmp_path / "a.compressed.ply", foreign_model.model())
    expected = read_model(path).splats
    path.write_bytes(path.read_bytes().replace(b"element chunk", b"comment licence\n" * 1000 + b"element chunk", 1))
    assert np.array_equal(read_model(path).splats.means, expected.means)


@pytest.mark.parametrize("start", [b"{", b" {", b"\x1f\x8b"])
def test_a_splat_that_begins_as_other_files_do_is_one_by_its_name(tmp_path, start):
    """It has no first bytes of its own, but a number."""
    path = written(tmp_path / "a.splat", foreign_model.model())
    path.write_bytes(start + path.read_bytes()[len(start) :])
    assert read_model(path).splats.n_splats == foreign_model.N


def test_an_unbundled_sog_is_read_from_its_meta(tmp_path):
    with zipfile.ZipFile(foreign_model.FOLDER / "model.sog") as bundle:
        bundle.extractall(tmp_path)
    bundled = read_model(foreign_model.FOLDER / "model.sog").splats
    assert np.array_equal(read_model(tmp_path / "meta.json").splats.means, bundled.means)
    meta = (tmp_path / "meta.json").read_text()
    (tmp_path / "meta.json").write_text("\ufeff" + meta)  # as editors of Windows do
    assert np.array_equal(read_model(tmp_path / "meta.json").splats.means, bundled.means)
    assert size_of(tmp_path / "meta.json") > 3 + len(meta)
    (tmp_path / "meta.json").write_text(meta.replace("sh0.webp", "../sh0.webp"))
    with pytest.raises(DataError, match="no name of a file beside it"):
        read_model(tmp_path / "meta.json")
    (tmp_path / "meta.json").write_text(meta)
    (tmp_path / "quats.webp").unlink()
    with pytest.raises(DataError, match=r"meta.json.*quats.webp"):
        read_model(tmp_path / "meta.json")


# --- bad files ---


def test_what_is_no_model_is_refused_in_one_line_that_says_what_to_do(tmp_path):
    files = {"empty.ply": b"", "notes.txt": b"hello there", "short.splat": b"x" * 33, "a.spz": b"something else",
             "a.sog": b"PK\x03\x04 but no more", "a.glb": b"glTF\x02\0\0\0", "a.gltf": b"{}", "meta.json": b"[]",
             "b.sog": b"{}", "deep.gltf": b'{"asset":' * 3000}  # fmt: skip
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    for path in (*(tmp_path / name for name in files), tmp_path, tmp_path / "missing.spz"):
        with pytest.raises(DataError, match=path.name) as caught:
            read_model(path)
        assert "; " in str(caught.value) and len(str(caught.value).splitlines()) == 1
    for name in ("a.obj", "a"):
        with pytest.raises(DataError, match=r"\.spz.*\.splat"):
            write_model(tmp_path / name, foreign_model.model())
    with pytest.raises(DataError, match="cannot be written"):
        write_model(tmp_path / "no folder" / "a.spz", foreign_model.model())


def test_where_nothing_can_be_written_is_said_before_anything_is_made_of_a_model(tmp_path, monkeypatch):
    def read_only(**_):
        raise OSError(errno.EROFS, "Read-only file system")

    model = written(tmp_path / "model.ply", foreign_model.model())
    read_source(model, tmp_path / "small.ply", "simplify")
    with pytest.raises(DataError, match=r"small.ply: cannot be written \(there is no such folder\)"):
        read_source(model, tmp_path / "no folder" / "small.ply", "simplify")
    monkeypatch.setattr("mi_dogsplat.formats.read.TemporaryFile", read_only)
    with pytest.raises(DataError, match=r"small.ply: cannot be written \(Read-only file system\)"):
        read_source(model, tmp_path / "small.ply", "simplify")
    assert list(tmp_path.iterdir()) == [model]


@pytest.mark.parametrize("part", ["scales", "sh0", "shN"])
def test_a_first_value_of_a_sog_that_is_null_is_a_step_below_the_second(tmp_path, part):
    """As PlayCanvas takes it; JSON has no -∞."""
    model = _replace_in_sog(tmp_path, "", b"")
    with zipfile.ZipFile(model) as bundle:
        files = {name: bundle.read(name) for name in bundle.namelist()}
    meta = json.loads(files["meta.json"])
    table = meta[part]["codebook"] = np.linspace(-3, 0.5, 256).tolist()
    for first in (table[1] - (table[255] - table[1]) / 255, None):
        table[0] = first
        with zipfile.ZipFile(tmp_path / f"{first is None}.sog", "w") as bundle:
            for name, content in files.items():
                bundle.writestr(name, json.dumps(meta) if name == "meta.json" else content)
    found, wanted = (read_model(tmp_path / f"{null}.sog").splats for null in (True, False))
    for name in ("log_scales", "sh_coeffs"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name)), name


def test_a_small_file_cannot_claim_much_memory(tmp_path):
    header = struct.pack("<IIIBBBB", 0x5053474E, 3, 40_000_000, 3, 12, 0, 0)
    (tmp_path / "bomb.spz").write_bytes(gzip.compress(header + bytes(1000)))
    streams = struct.pack("<IIIBBBBI12x", 0x5053474E, 4, 2**32 - 1, 3, 12, 0, 6, 32) + struct.pack("<QQ", 9, 9) * 6
    (tmp_path / "bomb4.spz").write_bytes(streams + bytes(60))
    with zipfile.ZipFile(tmp_path / "bomb.sog", "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr("meta.json", b" " * 20_000_000 + b"{}")
    for name in ("bomb.spz", "bomb4.spz", "bomb.sog"):
        with pytest.raises(DataError, match=f"{name}.*which no model compresses to"):
            read_model(tmp_path / name)


@pytest.mark.parametrize("side", [9_600, 20_000])  # beyond what Pillow warns of, and what it refuses by itself
def test_a_picture_of_a_sog_cannot_claim_much_memory(tmp_path, side):
    header = struct.pack(">IIBBBBB", side, side, 8, 6, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
    packed = [struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
              for kind, data in chunks]  # fmt: skip
    _replace_in_sog(tmp_path, "means_l.webp", b"\x89PNG\r\n\x1a\n" + b"".join(packed))
    with pytest.raises(DataError, match="a.sog"):
        read_model(tmp_path / "a.sog")


def test_a_member_of_a_sog_is_no_larger_than_the_file(tmp_path):
    """By its directory, where the size of a member stands 20 bytes behind the signature."""
    model = _replace_in_sog(tmp_path, "", b"")
    data = bytearray(model.read_bytes())
    at = data.index(b"PK\x01\x02") + 20
    data[at : at + 8] = struct.pack("<II", 2**31, 2**31)
    model.write_bytes(data)
    with pytest.raises(DataError, match="claims 2147483648 bytes of a file of"):
        read_model(model)


def test_many_primitives_of_few_colours_cannot_either(tmp_path):
    """Pictures of one colour are bytes, whatever their size."""
    side = 1000
    one = io.BytesIO()
    Image.new("RGBA", (side, side), (128, 128, 128, 255)).save(one, "WEBP", lossless=True)
    model = _replace_in_sog(tmp_path, "", b"")
    with zipfile.ZipFile(model) as bundle:
        meta = json.loads(bundle.read("meta.json")) | {"count": side * side}
        names = [name for name in bundle.namelist() if name.endswith(".webp")]
    with zipfile.ZipFile(model, "w") as bundle:
        bundle.writestr("meta.json", json.dumps(meta))
        for name in names:
            bundle.writestr(name, one.getvalue())
    with pytest.raises(DataError, match="which no model compresses to"):
        read_model(model)


@pytest.mark.parametrize("suffix", [".sog", ".spz"])
def test_a_model_that_compresses_to_almost_nothing_is_read_again(tmp_path, suffix):
    """As that of a regular grid of points is."""
    model = foreign_model.model().uniform_sh(3).select(np.zeros(70_000, int))
    assert read_model(written(tmp_path / f"a{suffix}", model)).splats.n_splats == 70_000


def _replace_in_sog(folder: Path, name: str, content: bytes) -> Path:
    """A SOG with another content under one of its names."""
    path = written(folder / "a.sog", foreign_model.model())
    with zipfile.ZipFile(path) as bundle:
        files = {member: bundle.read(member) for member in bundle.namelist()}
    with zipfile.ZipFile(path, "w") as bundle:
        for member, data in files.items():
            bundle.writestr(member, content if member == name else data)
    return path


def test_values_that_are_not_finite_are_refused_with_their_place(tmp_path):
    path = written(tmp_path / "a.splat", foreign_model.model())
    data = bytearray(path.read_bytes())
    data[32 * 3 : 32 * 3 + 4] = struct.pack("<f", np.nan)
    path.write_bytes(data)
    with pytest.raises(DataError, match="means that are not finite: 1, the first in primitive 3"):
        read_model(path)


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_model_with_a_position_that_is_none_is_not_written(tmp_path, suffix):
    path = written(tmp_path / f"a{suffix}", foreign_model.model())
    before, broken = path.read_bytes(), foreign_model.model()
    broken.means[7] = np.nan
    with pytest.raises(DataError, match="values.* are not finite: 3, the first .* 7.*; nothing was written; "):
        write_model(path, broken)
    assert path.read_bytes() == before


def test_of_rows_that_are_not_finite_the_primitive_is_named(tmp_path):
    slopes = {"slope_index": [2, 5], "color_slopes": [np.zeros((3, 3)), np.full((3, 3), np.inf)]}
    with pytest.raises(DataError, match="has values of color_slopes that are not finite: 9, the first in primitive 5"):
        write_model(tmp_path / "a.compressed.ply", replace(foreign_model.model(), **slopes))


@pytest.mark.parametrize("suffix", FORMATS)
def test_scales_beyond_float32_are_the_largest_that_a_file_can_say(tmp_path, suffix):
    model = foreign_model.model()
    model.log_scales[3] = 200
    back = read_model(written(tmp_path / f"a{suffix}", model)).splats
    assert np.isfinite(back.log_scales).all() and back.log_scales.max() >= 5.9


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("degree", [0, 3])
def test_no_primitives_are_written_and_read_or_refused_by_name(tmp_path, suffix, degree):
    if suffix in (".glb", ".gltf"):
        with pytest.raises(DataError, match="glTF has no room for a model without primitives; "):
            write_model(tmp_path / f"a{suffix}", Splats.empty(degree))
        return
    assert read_model(written(tmp_path / f"a{suffix}", Splats.empty(degree))).splats.n_splats == 0


def test_a_gltf_names_what_it_lacks(tmp_path):
    path = written(tmp_path / "a.gltf", foreign_model.model())
    content = json.loads(path.read_text())
    without = json.loads(path.read_text())
    del without["meshes"][0]["primitives"][0]["extensions"]
    path.write_text(json.dumps(without))
    with pytest.raises(DataError, match="holds no primitive with KHR_gaussian_splatting"):
        read_model(path)
    for uri, words in (("https://example.org/a.bin", "no file beside it"), ("../a.bin", "no file beside it"),
                       ("a.bin", "cannot be read")):  # fmt: skip
        content["buffers"][0]["uri"] = uri
        path.write_text(json.dumps(content))
        with pytest.raises(DataError, match=words):
            read_model(path)


def test_for_a_folder_the_model_in_it_is_named(tmp_path):
    with pytest.raises(DataError, match="this is a folder; give the path of a model"):
        read_model(tmp_path)
    model = written(tmp_path / "point_cloud.ply", random_splats())
    with pytest.raises(DataError, match=f"this is a folder; give the model in it: {model}"):
        read_model(tmp_path)
