"""Other programs' formats: what is written is what the specifications say, and what another program reads."""

import gzip
import json
import shutil
import struct
import subprocess
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.formats import compressed_ply, gltf, gltf_read, sog, sog_read, spz
from mi_dogsplat.formats.coded import snapped
from mi_dogsplat.formats.packing import LUF, RUB, morton_order, turned
from mi_dogsplat.formats.palette import codebook, nearest, palette
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.scene.quaternions import unit_quaternions
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import srgb_to_linear
from PIL import Image
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from splat_scenes import image_of, random_splats, rasterized, rounded, tilted_camera

FORMATS = {"spz": spz, "sog": sog, "glb": gltf, "compressed.ply": compressed_ply}
READ = {"spz": spz.read, "sog": sog_read.read, "glb": gltf_read.read, "compressed.ply": compressed_ply.read}
QUANTISED = ["spz", "sog", "compressed.ply"]


def splats_of_degree(degree: int, n: int = 700) -> Splats:
    """Within the ranges of all formats; quaternions of any length, one of them zero."""
    model = rounded(random_splats(n, seed=degree, degree=degree, dog_share=0))
    model.quats *= np.random.default_rng(1).uniform(0.1, 9, (n, 1)).astype(np.float32)
    model.quats[3] = 0
    return model.select(morton_order(model.means))


def one(**values) -> Splats:
    """A single Gaussian of degree 0."""
    usual = {"means": [[1, -0.5, 0.25]], "log_scales": [[-1, -2, -3]], "quats": [[0, 0, 0, 1]]}
    usual |= {"logit_opacities": [0.0], "sh_coeffs": [[[0, 1, -1]]]}
    return Splats(**{name: np.array(value, float) for name, value in (usual | values).items()})


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Largest angle between rotations, in radians; float64 unit quaternions."""
    return float(2 * np.arccos(np.clip(np.abs((a * b).sum(axis=1)), 0, 1)).max())


def spread(model: Splats) -> np.ndarray:
    """Covariances [N, 3, 3] over their largest eigenvalue: several quaternions are one ellipsoid."""
    turns = Rotation.from_quat(unit_quaternions(model.quats)).as_matrix()
    axes = turns * np.exp(model.log_scales)[:, None]  # [N, 3, 3]
    return axes @ axes.transpose(0, 2, 1) / np.exp(2 * model.log_scales.max(axis=1))[:, None, None]


def decoded(name: str, model: Splats, folder: Path) -> Splats:
    path = folder / f"model.{name}"
    path.write_bytes(FORMATS[name].encode(model))
    return READ[name](path).splats


@pytest.mark.parametrize("name", FORMATS)
def test_a_quaternion_of_zeros_is_no_turn(name, tmp_path):
    model = one(quats=[[0, 0, 0, 0]])
    assert unit_quaternions(model.quats).tolist() == [[0, 0, 0, 1]]
    assert np.abs(spread(decoded(name, model, tmp_path)) - spread(one())).max() < 0.05


# --- round trips: every error is at most half a step of the format ---


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("name", FORMATS)
def test_what_is_read_differs_by_no_more_than_the_steps_of_the_format(name, degree, tmp_path):
    model = splats_of_degree(degree)
    back = decoded(name, model, tmp_path)
    assert back.sh_coeffs.shape == model.sh_coeffs.shape and back.n_dog == 0
    chunk = np.arange(model.n_splats) // 256
    spread = [np.array([np.ptp(v[chunk == c], axis=0).max() for c in range(3)]).max() for v in
              (model.means, model.log_scales, 0.5 + C0 * model.sh_coeffs[:, 0])]  # fmt: skip
    logs = np.log1p(np.abs(model.means)).max()
    position = {"spz": 2.0**-13, "glb": 0, "compressed.ply": spread[0] / 1023 / 2,
                "sog": 2 * logs / 65535 * (1 + np.abs(model.means).max())}  # fmt: skip
    scale = {"spz": 1 / 32, "glb": 1e-6, "compressed.ply": spread[1] / 1023 / 2, "sog": np.ptp(model.log_scales) / 256}
    rotation = {"spz": 4 / 511, "glb": 1e-3, "compressed.ply": 4 / 1023, "sog": 4 / 255}
    color = {"spz": 0.5 / 255 / 0.15, "glb": 0, "compressed.ply": spread[2] / 255 / 2 / C0,
             "sog": np.ptp(model.sh_coeffs[:, 0]) / 256}  # fmt: skip
    rest = {"spz": 0.5 / 128, "glb": 0, "compressed.ply": 8 / 256, "sog": 0.9}
    assert np.abs(back.means - model.means).max() <= position[name] + 1e-6
    assert np.abs(back.log_scales - model.log_scales).max() <= scale[name] + 1e-6
    assert angle(unit_quaternions(back.quats), unit_quaternions(model.quats)) <= rotation[name]
    assert np.abs(back.opacities - model.opacities).max() <= (0 if name == "glb" else 0.5 / 255) + 1e-6
    assert np.abs(back.sh_coeffs[:, 0] - model.sh_coeffs[:, 0]).max() <= color[name] + 1e-6
    if degree:
        assert np.abs(back.sh_coeffs[:, 1:] - model.sh_coeffs[:, 1:]).max() <= rest[name] + 1e-6


def test_a_palette_as_large_as_the_model_keeps_its_view_dependence(tmp_path):
    model = splats_of_degree(3, n=1500)
    assert sog.palette_size(1500) == 1024 and sog.palette_size(900) == 1024 and sog.palette_size(10**6) == 65536
    few = model.select(np.arange(900))
    error = decoded("sog", few, tmp_path).sh_coeffs[:, 1:] - few.sh_coeffs[:, 1:]
    assert np.sqrt(np.mean(error**2)) < 0.01 * few.sh_coeffs[:, 1:].std()


@pytest.mark.parametrize("name", QUANTISED)
def test_values_out_of_range_are_clamped_not_wrapped(name, tmp_path):
    extreme = one(log_scales=[[-40, 40, 0]], logit_opacities=[90.0], sh_coeffs=[[[50, -50, 0]]])
    back = decoded(name, extreme, tmp_path)
    assert back.log_scales[0, 0] < -9 and back.log_scales[0, 1] > 5 and back.opacities[0] > 0.999
    assert back.sh_coeffs[0, 0, 0] > 3 and back.sh_coeffs[0, 0, 1] < -3


def test_far_positions_cost_spz_bits_of_the_fraction(tmp_path):
    assert spz.fraction_bits(one(means=[[0.0, 2047, 1]])) == 12 and spz.fraction_bits(one(means=[[2048.0, 0, 0]])) == 11
    back = decoded("spz", one(means=[[5000, -5000, 1.5]]), tmp_path)
    assert back.means[0] == pytest.approx([5000, -5000, 1.5])


@pytest.mark.parametrize("unit", [1.0, 0.1, 2.5e-3])
def test_positions_of_spz_are_exact_enough_in_any_unit(unit, tmp_path):
    """What is trained for the file is what the file holds, and what is not is off by a part of its size."""
    model = splats_of_degree(0)
    model = replace(model, means=model.means * unit, log_scales=model.log_scales * 0 + np.log(0.02 * unit))
    for splats, error in ((model, 0.1), (snapped("spz", model), 1e-5)):
        back = decoded("spz", splats, tmp_path)
        distance, _ = KDTree(back.means).query(splats.means)
        assert distance.max() < error * 0.02 * unit


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_model_gives_the_same_bytes(name):
    model = splats_of_degree(1, n=300)
    assert FORMATS[name].encode(model) == FORMATS[name].encode(model)


# --- bytes, by hand from the specifications ---


def test_spz_by_hand():
    quat = [[-0.5, 0.1, 0.2, 0.4]]  # largest is x, and negative: all signs turn
    data = gzip.decompress(spz.encode(one(quats=quat)))
    assert struct.unpack_from("<IIIBBBB", data) == (0x5053474E, 3, 1, 0, 12, 0, 0)
    fields = data[16:]
    assert [int.from_bytes(fields[i : i + 3], "little", signed=True) for i in (0, 3, 6)] == [4096, -2048, 1024]
    assert fields[9] == 128  # opacity
    assert list(fields[10:13]) == [128, 166, 89]  # 127.5 + 38.25 f_dc
    assert list(fields[13:16]) == [144, 128, 112]  # 16 (log scale + 10)
    word = int.from_bytes(fields[16:20], "little")
    length = np.linalg.norm(quat)
    parts = [round(v / length * np.sqrt(2) * 511) for v in (0.1, 0.2, 0.4)]
    assert word == 0 << 30 | (512 | parts[0]) << 20 | (512 | parts[1]) << 10 | (512 | parts[2])
    assert len(fields) == 20


def test_spz_has_coefficients_outside_and_channels_inside():
    model = one(sh_coeffs=np.arange(12).reshape(1, 4, 3) / 16 - 0.3)
    rest = gzip.decompress(spz.encode(model))[-9:]
    assert list(rest) == [round(v * 128) + 128 for v in model.sh_coeffs[0, 1:].ravel()]


def test_compressed_ply_by_hand():
    model = one()
    model = Splats(**{name: np.concatenate([getattr(model, name)] * 2) for name in
                      ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")})  # fmt: skip
    model.means[1] = 3, 0.5, 1.25
    model.quats[1] = 0.5, -0.5, 0.5, -0.6  # w is largest and negative
    header, data = compressed_ply.encode(model).split(b"end_header\n")
    assert b"element chunk 1\n" in header and b"element vertex 2\n" in header and b"element sh" not in header
    bounds = np.frombuffer(data[:72], "<f4")
    assert bounds[:6] == pytest.approx([1, -0.5, 0.25, 3, 0.5, 1.25])
    assert bounds[6:12] == pytest.approx([-1, -2, -3] * 2)
    first, second = np.frombuffer(data[72:], "<u4").reshape(2, 4).tolist()
    assert first[0] == 0 and second[0] == 2**32 - 1  # 11, 10, 11 bits at the low and at the high bounds
    unit = np.array([-0.5, 0.5, -0.5]) / np.linalg.norm(model.quats[1])
    parts = [int((v / np.sqrt(2) + 0.5) * 1023 + 0.5) for v in unit]
    assert second[1] == 0 << 30 | parts[0] << 20 | parts[1] << 10 | parts[2]
    assert first[1] == 512 << 20 | 512 << 10 | 512  # the identity
    assert first[3] & 255 == 128  # opacity


def test_compressed_ply_of_before_colours_had_bounds(tmp_path):
    """PlayCanvas takes the codes of colours as 0 to 1 where a chunk has 12 numbers."""
    model = splats_of_degree(1, n=300)
    model.sh_coeffs[:, 0] = np.clip(model.sh_coeffs[:, 0], -0.5 / C0, 0.5 / C0)
    model.sh_coeffs[[0, 256], 0], model.sh_coeffs[[1, 257], 0] = -0.5 / C0, 0.5 / C0  # bounds of both chunks: 0 and 1
    (tmp_path / "a.ply").write_bytes(whole := compressed_ply.encode(model))
    header, data = whole.split(b"end_header\n")
    for name in compressed_ply.OF_COLORS:
        header = header.replace(f"property float {name}\n".encode(), b"")
    chunks = np.frombuffer(data[: 2 * 72], "<f4").reshape(2, 18)[:, :12]
    (tmp_path / "b.ply").write_bytes(header + b"end_header\n" + chunks.tobytes() + data[2 * 72 :])
    now, before = (read_model(tmp_path / name).splats for name in ("a.ply", "b.ply"))
    for name in ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs"):
        assert getattr(before, name) == pytest.approx(getattr(now, name), abs=1e-6), name


def test_glb_by_hand():
    data = gltf.encode(one(quats=[[0, 0, 2, 0]], sh_coeffs=np.arange(12).reshape(1, 4, 3)))
    magic, version, length, text = struct.unpack_from("<4sIII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data)) and len(data) % 4 == 0
    content = json.loads(data[20 : 20 + text])
    primitive = content["meshes"][0]["primitives"][0]
    assert content["extensionsUsed"] == ["KHR_gaussian_splatting"] and primitive["mode"] == 0
    how = primitive["extensions"]["KHR_gaussian_splatting"]
    assert how["kernel"] == "ellipse" and how["colorSpace"] == "srgb_rec709_display"

    def values(name):
        accessor = content["accessors"][primitive["attributes"][name]]
        view = content["bufferViews"][accessor["bufferView"]]
        start = 28 + text + view["byteOffset"]
        kind = {5126: "<f4", 5121: "u1"}[accessor["componentType"]]
        return np.frombuffer(data[start : start + view["byteLength"]], kind)

    assert values("POSITION") == pytest.approx([1, -0.5, 0.25])
    assert values("KHR_gaussian_splatting:ROTATION") == pytest.approx([0, 0, 1, 0])
    assert values("KHR_gaussian_splatting:SCALE") == pytest.approx(np.exp([-1, -2, -3]))
    assert values("KHR_gaussian_splatting:OPACITY") == pytest.approx([0.5])
    assert values("KHR_gaussian_splatting:SH_DEGREE_0_COEF_0") == pytest.approx([0, 1, 2])
    assert values("KHR_gaussian_splatting:SH_DEGREE_1_COEF_2") == pytest.approx([9, 10, 11])
    linear = srgb_to_linear([0.5, 0.5 + C0, 1])  # as glTF has colours of vertices; the opacity is what it is
    assert values("COLOR_0").tolist() == [*np.round(255 * linear).astype(int), 128]


def test_colours_of_points_in_glb_are_linear_whatever_those_of_the_model_are():
    coded = srgb_to_linear([0.5, 0.5 + C0, 1])
    for sh, drawing in (([0, 1, 2], Drawing()), ((coded - 0.5) / C0, Drawing(linear=True))):
        found = gltf.attributes(one(sh_coeffs=np.reshape(sh, (1, 1, 3))), bool(drawing.linear))
        assert found["COLOR_0"].tolist() == [[*np.round(255 * coded).astype(int), 128]]


def test_sog_by_hand(tmp_path):
    model = splats_of_degree(1, n=6)
    model.logit_opacities[0] = -90.0  # alpha 0: its colour must survive
    with zipfile.ZipFile(BytesIO(sog.encode(model))) as bundle:
        meta = json.loads(bundle.read("meta.json"))
        pictures = {name: np.asarray(Image.open(BytesIO(bundle.read(name)))) for name in bundle.namelist()[1:]}
    assert meta["version"] == 2 and meta["count"] == 6 and meta["shN"]["bands"] == 1
    assert {len(meta[part]["codebook"]) for part in ("scales", "sh0", "shN")} == {256}
    assert pictures["shN_centroids.webp"].shape[1] == 64 * 3
    for i in range(6):
        at = np.unravel_index(i, pictures["sh0.webp"].shape[:2])
        low, high = (pictures[f"means_{which}.webp"][at].astype(float) for which in "lu")
        mins, maxs = (np.array(meta["means"][end]) for end in ("mins", "maxs"))
        logs = mins + (maxs - mins) * (low + 256 * high)[:3] / 65535
        assert np.sign(logs) * (np.exp(np.abs(logs)) - 1) == pytest.approx(model.means[i], abs=1e-3)
        red, green, blue, alpha = pictures["sh0.webp"][at]
        assert np.array(meta["sh0"]["codebook"])[[red, green, blue]] == pytest.approx(model.sh_coeffs[i, 0], abs=0.02)
        assert alpha / 255 == pytest.approx(model.opacities[i], abs=0.003)
        assert 252 <= pictures["quats.webp"][at][3] <= 255


# --- another program ---


@pytest.mark.parametrize("name", foreign_model.FILES)
def test_files_that_another_program_wrote_are_read(name):
    model, read = foreign_model.model(), read_model(foreign_model.FOLDER / name)
    back = read.splats
    assert bool(read.drawing.antialiased) == ("mip" in name)
    assert back.n_splats == model.n_splats and back.sh_degree == 2
    distance = np.abs(back.means[:, None] - model.means[None]).max(axis=-1)  # [N, N]: it may sort
    assert distance.min(axis=1).max() < 0.01
    model = model.select(distance.argmin(axis=1))
    assert spread(back) == pytest.approx(spread(model), rel=0.03, abs=0.03)
    assert np.abs(back.log_scales - model.log_scales).max() < 0.04
    assert np.abs(back.opacities - model.opacities).max() <= 1 / 255
    kept = slice(1) if name.endswith("sog") else slice(None)  # its palette has fewer entries than these few primitives
    assert np.abs(back.sh_coeffs[:, kept] - model.sh_coeffs[:, kept]).max() < 0.07  # 4 bits in its SPZ


@pytest.mark.parametrize("name", QUANTISED)  # it does not read .glb
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_another_program_reads_the_same_numbers(name, degree, tmp_path):
    program = shutil.which("splat-transform")
    if program is None:
        pytest.skip("needs splat-transform in the PATH: npm install -g @playcanvas/splat-transform")
    ours = decoded(name, splats_of_degree(degree), tmp_path)  # in the axes of the file: it turns no SPZ
    command = [program, "-w", str(tmp_path / f"model.{name}"), str(tmp_path / "theirs.ply")]
    subprocess.run(command, check=True, capture_output=True)
    theirs = read_ply(tmp_path / "theirs.ply")
    for values in ("means", "log_scales", "sh_coeffs", "opacities"):
        assert getattr(theirs, values) == pytest.approx(getattr(ours, values), abs=1e-5)
    assert angle(unit_quaternions(theirs.quats), unit_quaternions(ours.quats)) < 1e-3


# --- what they share ---


@pytest.mark.parametrize("axes", [RUB, LUF])
def test_a_turned_model_looks_the_same_from_a_camera_turned_along(axes):
    model, camera = rounded(random_splats(30, seed=2, degree=3, dog_share=0)), tilted_camera()
    turn = np.diag([*axes[0], 1.0])
    half = turned(model, axes)
    turned_camera = type(camera)(camera.w2c @ turn, camera.fx, camera.fy, camera.cx, camera.cy, 64, 48)
    before, after = image_of(rasterized(model, camera), camera), image_of(rasterized(half, turned_camera), camera)
    assert before.max() > 0.3 and np.abs(before - after).max() < 1e-4
    twice = turned(half, axes)
    assert np.array_equal(twice.means, model.means) and np.array_equal(twice.sh_coeffs, model.sh_coeffs)


def test_morton_order_brings_neighbours_together():
    means = np.random.default_rng(0).uniform(-1, 1, (4000, 3))
    order = morton_order(means)
    assert sorted(order) == list(range(4000))
    steps = np.linalg.norm(np.diff(means[order], axis=0), axis=1).mean()
    assert steps < 0.25 * np.linalg.norm(np.diff(means, axis=0), axis=1).mean()
    assert len(morton_order(means[:0])) == 0 and morton_order(means[:1]).tolist() == [0]


def test_morton_order_is_that_of_the_interleaved_bits_of_cells():
    means = np.random.default_rng(0).normal(size=(300, 3))
    cells = ((means - means.min(0)) / np.ptp(means, axis=0) * 1023).astype(int)
    of_axes = [[f"{cell:010b}" for cell in row] for row in cells]
    codes = ["".join(z + y + x for x, y, z in zip(*row, strict=True)) for row in of_axes]
    assert morton_order(means).tolist() == sorted(range(300), key=codes.__getitem__)


def test_a_codebook_is_as_good_as_theory_allows_and_exact_where_it_can_be():
    values = np.random.default_rng(0).normal(size=200_000)
    table = codebook(values)
    error = np.mean((table[nearest(table, values)] - values) ** 2)
    bound = np.sqrt(3) * np.pi / 2 / 256**2  # of a normal distribution (Panter and Dite 1951)
    assert np.all(np.diff(table) >= 0) and error < 1.1 * bound
    few = np.array([3.0, -1, 7, 3])
    table = codebook(few)
    assert table[nearest(table, few)] == pytest.approx(few)


def test_a_palette_finds_clusters_and_stops_at_equal_vectors():
    rng = np.random.default_rng(0)
    centres = rng.normal(size=(8, 5)) * 10
    truth = rng.integers(0, 8, 500)
    labels, centroids = palette(centres[truth] + rng.normal(size=(500, 5)) * 0.01, 8)
    assert len(centroids) == 8 and np.abs(centroids[labels] - centres[truth]).max() < 0.1
    labels, centroids = palette(np.ones((50, 3)), 16)
    assert labels.max() == 0 and centroids == pytest.approx(np.ones((1, 3)))


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_no_such_file_is_refused_in_one_line(name, tmp_path):
    path = tmp_path / f"broken.{name}"
    path.write_bytes(b"this is something else")
    with pytest.raises(DataError, match="broken"):
        READ[name](path)
    write_ply(path, one())
    with pytest.raises(DataError, match="broken"):
        READ[name](path)
