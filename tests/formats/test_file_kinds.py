"""What a file is: by its content before its name, in the dialects and with the comments that other programs write."""

import gzip
import zipfile

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import Drawing, read_model, write_ply
from mi_dogsplat.formats.read import size_of
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.scene.drawing import comments_of, drawing_of
from mi_dogsplat.scene.orientation import AXES
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.support.errors import DataError
from ply_files import random_splats, to_bytes, vertex_columns
from written_models import written

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


def test_a_compressed_ply_without_its_chunks_is_refused(tmp_path):
    path = written(tmp_path / "a.compressed.ply", foreign_model.model())
    path.write_bytes(path.read_bytes().replace(b"element chunk", b"element other", 1))
    with pytest.raises(DataError, match="no chunks of packed primitives; give a compressed PLY"):
        read_model(path)


def test_coefficients_of_a_compressed_ply_go_by_the_names_of_their_columns(tmp_path):
    path = written(tmp_path / "a.compressed.ply", foreign_model.model())
    expected = read_model(path).splats.sh_coeffs
    header, data = path.read_bytes().split(b"end_header\n", 1)
    lines = header.splitlines()
    count = sum(line.startswith(b"property uchar f_rest_") for line in lines)  # they come last
    sh = np.frombuffer(data[-foreign_model.N * count :], np.uint8).reshape(foreign_model.N, count)
    order = np.random.default_rng(0).permutation(count)
    named = [lines[len(lines) - count + k] for k in order]
    rows = np.concatenate([sh[:, :1], sh[:, order]], axis=1)
    mixed = b"\n".join([*lines[: len(lines) - count], b"property uchar of_others", *named, b"end_header\n"])
    path.write_bytes(mixed + data[: -foreign_model.N * count] + rows.tobytes())
    assert np.array_equal(read_model(path).splats.sh_coeffs, expected)


@pytest.mark.parametrize("content", [
    '{"frames": [{"file_path": "1.png"}]}', '{"lodLevels": 2, "filenames": ["0_0/meta.json"], "tree": {}}', "{}",
])  # fmt: skip
def test_a_json_of_something_else_is_not_taken_for_a_gltf_without_gaussians(tmp_path, content):
    (tmp_path / "other.json").write_text(content)
    with pytest.raises(DataError, match=r"other\.json: is neither a glTF nor the meta\.json of a SOG; give the file"):
        read_model(tmp_path / "other.json")


def test_a_ply_that_was_packed_with_gzip_is_to_be_unpacked(tmp_path):
    path = written(tmp_path / "a.ply", foreign_model.model())
    (tmp_path / "a.ply.gz").write_bytes(gzip.compress(path.read_bytes()))
    with pytest.raises(DataError, match=r"a\.ply\.gz: is a PLY that was packed with gzip; unpack it"):
        read_model(tmp_path / "a.ply.gz")


@pytest.mark.parametrize("start", [b"{", b" {", b"\x1f\x8b"])
def test_a_splat_that_begins_as_other_files_do_is_one_by_its_name(tmp_path, start):
    """It has no first bytes of its own, but a number."""
    path = written(tmp_path / "a.splat", foreign_model.model())
    path.write_bytes(start + path.read_bytes()[len(start) :])
    assert read_model(path).splats.n_splats == foreign_model.N


def test_a_splat_has_the_bytes_that_other_programs_know(tmp_path):
    """Rotations (w, x, y, z) as 128 q + 128, colours and opacity as 255ths."""
    model = random_splats(1, 0, ())
    model.quats[:], model.logit_opacities[:] = [0.5, -0.5, 0.5, -0.5], 0
    model.sh_coeffs[:] = (np.array([1, 0.2, 0.6]) - 0.5) / C0
    path = written(tmp_path / "a.splat", model)
    data = path.read_bytes()
    assert len(data) == 32 and list(data[24:]) == [255, 51, 153, 128, 64, 192, 64, 192]
    assert np.frombuffer(data[:24], "<f4") == pytest.approx([*model.means[0], *np.exp(model.log_scales[0])])
    path.write_bytes(data[:28] + bytes([255, 128, 128, 0]))
    assert read_model(path).splats.quats.tolist() == [[0, 0, -1, 127 / 128]]


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
    with pytest.raises(DataError, match="not the name of a file beside it"):
        read_model(tmp_path / "meta.json")
    (tmp_path / "meta.json").write_text(meta)
    (tmp_path / "quats.webp").unlink()
    with pytest.raises(DataError, match=r"meta.json.*quats.webp"):
        read_model(tmp_path / "meta.json")
