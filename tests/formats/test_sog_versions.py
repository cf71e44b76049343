"""SOG of version 1, which PlayCanvas wrote first, and bundles whose files lie in a folder."""

import io
import json
import zipfile

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import read_model
from mi_dogsplat.formats.read import size_of
from mi_dogsplat.support.errors import DataError
from PIL import Image
from written_models import written

SIDE = 4
N = 15  # a pixel is left over
PALETTE = 128  # entries, in two rows


def _webp(pixels):
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, "WEBP", lossless=True, exact=True)
    return buffer.getvalue()


def _first_version(degree):
    """(files by name, numbers by name) of a model of version 1: codes at random, decoded one by one."""
    rng = np.random.default_rng(degree)
    pixels = {name: rng.integers(0, 256, (SIDE, SIDE, channels), np.uint8) for name, channels in
              (("means_l", 3), ("means_u", 3), ("scales", 3), ("quats", 4), ("sh0", 4))}  # fmt: skip
    pixels["quats"][..., :3] = rng.integers(90, 166, (SIDE, SIDE, 3))  # the one left out is the largest
    pixels["quats"][..., 3] = rng.integers(252, 256, (SIDE, SIDE))
    low = {"means": [-2.0, -1.5, -1.0], "scales": [-8.0, -7.0, -6.0], "sh0": [-1.5, -1.0, -0.5, -4.0], "shN": -0.75}
    high = {"means": [2.0, 1.0, 3.0], "scales": [-1.0, -2.0, 0.0], "sh0": [1.5, 2.0, 2.5, 6.0], "shN": 1.25}
    shapes = {"means": [N, 3], "scales": [N, 3], "quats": [N, 4], "sh0": [N, 1, 4]}
    meta = {part: {"shape": shape, "dtype": "float32"} for part, shape in shapes.items()}
    for part in ("means", "scales", "sh0"):
        meta[part] |= {"mins": low[part], "maxs": high[part]}
    meta["quats"] |= {"dtype": "uint8", "encoding": "quaternion_packed"}
    named = {"means": ["means_l", "means_u"], "scales": ["scales"], "quats": ["quats"], "sh0": ["sh0"]}
    if degree:
        size = (degree + 1) ** 2 - 1
        labels = rng.integers(0, PALETTE, SIDE * SIDE)
        pixels["shN_labels"] = np.stack([labels & 255, labels >> 8, 0 * labels], axis=1).astype(np.uint8)
        pixels["shN_labels"] = pixels["shN_labels"].reshape(SIDE, SIDE, 3)
        pixels["shN_centroids"] = rng.integers(0, 256, (PALETTE // 64, 64 * size, 3), np.uint8)
        meta["shN"] = {"shape": [N, 3 * size], "dtype": "float32", "quantization": 8}
        meta["shN"] |= {"mins": low["shN"], "maxs": high["shN"]}
        named["shN"] = ["shN_centroids", "shN_labels"]
    for part, names in named.items():
        meta[part]["files"] = [f"{name}.webp" for name in names]
    files = {f"{name}.webp": _webp(content) for name, content in pixels.items()}

    codes = {name: content.astype(int) for name, content in pixels.items()}

    def share(part, channel, code):
        return low[part][channel] + (high[part][channel] - low[part][channel]) * code / 255

    wanted = {name: [] for name in ("means", "log_scales", "wxyz", "logits", "sh")}
    for i in range(N):
        at = divmod(i, SIDE)
        both = codes["means_l"][at] + 256 * codes["means_u"][at]
        logs = [share("means", c, both[c] / 257) for c in range(3)]
        wanted["means"].append([np.sign(x) * (np.exp(abs(x)) - 1) for x in logs])
        wanted["log_scales"].append([share("scales", c, codes["scales"][at][c]) for c in range(3)])
        three = [(code / 255 - 0.5) * np.sqrt(2) for code in codes["quats"][at][:3]]
        three.insert(codes["quats"][at][3] - 252, np.sqrt(1 - sum(x * x for x in three)))
        wanted["wxyz"].append(three)
        wanted["logits"].append(share("sh0", 3, codes["sh0"][at][3]))
        sh = [[share("sh0", c, codes["sh0"][at][c]) for c in range(3)]]
        if degree:
            row, column = divmod(labels[i], 64)
            for k in range(size):
                entry = codes["shN_centroids"][row, column * size + k]
                sh.append(low["shN"] + (high["shN"] - low["shN"]) * entry / 255)
        wanted["sh"].append(sh)
    return {"meta.json": json.dumps(meta).encode()} | files, {name: np.array(rows) for name, rows in wanted.items()}


def _bundled(path, files):
    with zipfile.ZipFile(path, "w") as bundle:
        for name, content in files.items():
            bundle.writestr(name, content)
    return path


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_first_version_is_read_from_a_bundle_and_from_its_meta(tmp_path, degree):
    files, wanted = _first_version(degree)
    bundled = read_model(_bundled(tmp_path / "a.sog", files)).splats
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    assert size_of(tmp_path / "meta.json") == sum(len(content) for content in files.values())
    for splats in (bundled, read_model(tmp_path / "meta.json").splats):
        assert splats.n_splats == N and splats.sh_degree == degree
        assert splats.means == pytest.approx(wanted["means"], rel=1e-5, abs=1e-6)
        assert splats.log_scales == pytest.approx(wanted["log_scales"], abs=1e-5)
        assert splats.quats[:, [3, 0, 1, 2]] == pytest.approx(wanted["wxyz"], abs=1e-6)
        assert splats.logit_opacities == pytest.approx(wanted["logits"], abs=1e-5)
        assert splats.sh_coeffs == pytest.approx(wanted["sh"], abs=1e-6)


@pytest.mark.parametrize(("part", "change", "problem"), [
    ("version", 3, "is SOG of version 3; convert it to version 2"),
    ("scales", {"mins": [0, 0]}, "is not a SOG model"),
    ("means", {"shape": []}, "is not a SOG model"),
    ("means", {"shape": [SIDE * SIDE + 1, 3]}, "17 primitives, but a picture of"),
    ("means", {"shape": [-1, 3]}, "its number of primitives is -1"),
    ("means", {"shape": [True, 3]}, "its number of primitives is True"),
    ("means", {"shape": [3.0, 3]}, "its number of primitives is 3.0"),
])  # fmt: skip
def test_what_is_wrong_with_a_first_version_is_said(tmp_path, part, change, problem):
    files, _ = _first_version(1)
    meta = json.loads(files["meta.json"])
    meta[part] = meta[part] | change if isinstance(change, dict) else change
    files["meta.json"] = json.dumps(meta).encode()
    with pytest.raises(DataError, match=problem):
        read_model(_bundled(tmp_path / "a.sog", files))


def test_a_picture_as_wide_as_no_palette_is_refused(tmp_path):
    files, _ = _first_version(1)
    files["shN_centroids.webp"] = _webp(np.zeros((1, 64 * 4, 3), np.uint8))
    with pytest.raises(DataError, match='a picture of "shN" is 256 pixels wide'):
        read_model(_bundled(tmp_path / "a.sog", files))


def test_a_bundle_whose_files_lie_in_a_folder_is_read(tmp_path):
    """A folder that was packed as it is, with what macOS adds."""
    path = written(tmp_path / "a.sog", foreign_model.model())
    with zipfile.ZipFile(path) as bundle:
        files = {name: bundle.read(name) for name in bundle.namelist()}
    inside = {f"model/{name}": content for name, content in files.items()}
    packed = _bundled(tmp_path / "b.sog", inside | {"__MACOSX/model/._meta.json": b"\0\5\x16\7"})
    assert np.array_equal(read_model(packed).splats.means, read_model(path).splats.means)
    both = _bundled(tmp_path / "c.sog", inside | {f"other/{name}": content for name, content in files.items()})
    with pytest.raises(DataError, match="several models: model/, other/; unpack it"):
        read_model(both)
