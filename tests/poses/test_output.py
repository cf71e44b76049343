"""The folder of the model: whole after a stop, and what becomes of images and cameras without their lens."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dataset_folders import HEIGHT, N_VIEWS, WIDTH, colmap_folder
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.exr import exr_saturation
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.poses.output import PART, undistort, write_model
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.pictures import write_radiance
from PIL import Image

pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")


def test_a_model_is_whole_though_an_earlier_one_was_stopped_while_it_was_written(tmp_path):
    (tmp_path / PART / "0").mkdir(parents=True)
    (tmp_path / PART / "0" / "left").touch()
    model = pycolmap.synthesize_dataset(pycolmap.SyntheticDatasetOptions(num_points3D=20))
    write_model(model, tmp_path / "sparse" / "0")
    assert [path.name for path in tmp_path.iterdir()] == ["sparse"]
    (tmp_path / "alone").mkdir()
    model.write_binary(str(tmp_path / "alone"))
    written, alone = ({p.name: p.read_bytes() for p in (tmp_path / at).iterdir()} for at in ("sparse/0", "alone"))
    assert written == alone


def without_lens(folder: Path, *params: float) -> tuple[Path, list, Any]:
    """(folder, what was told of the progress, model)"""
    colmap_folder(folder / "bent", camera="OPENCV", params=params)
    told = []
    model = undistort(pycolmap, folder / "bent", folder / "out", lambda *row: told.append(row))
    return folder / "out", told, model


def test_images_that_are_there_are_not_written_again(tmp_path):
    first = tmp_path / "out" / "images" / "img_00.png"
    first.parent.mkdir(parents=True)
    first.write_bytes(b"of an earlier start")
    out, told, _ = without_lens(tmp_path, 20, 22, 10.5, 7, 0.01, 0, 0, 0)
    assert first.read_bytes() == b"of an earlier start" and len(list((out / "images").iterdir())) == N_VIEWS
    assert told == [(k, N_VIEWS) for k in range(1, N_VIEWS + 1)]


def test_of_a_lens_that_hardly_bends_the_pinhole_is_what_is_left(tmp_path):
    model = without_lens(tmp_path, 20, 22, 10.5, 7, 1e-6, 0, 0, 0)[2]
    (camera,) = model.cameras.values()
    assert camera.model_name == "PINHOLE" and 0 <= WIDTH - camera.width <= 1 and 0 <= HEIGHT - camera.height <= 1
    np.testing.assert_allclose(camera.params, [20, 22, 10.5, 7], atol=1)
    assert {tuple(map(int, point.color)) for point in model.points3D.values()} == {(200, 100, 50)}


def test_openexr_loses_its_lens_as_where_it_is_read_and_masks_come_along(tmp_path):
    """Of a lamp before a wall, around which splines ring. Masks are called as what a screen shows of an image."""
    bent, out = tmp_path / "bent", tmp_path / "out"
    colmap_folder(bent, camera="SIMPLE_RADIAL", params=(20, 10.5, 7.5, 0.01))
    (bent / "masks").mkdir()
    for file in list((bent / "images").iterdir()):
        light = np.full((HEIGHT, WIDTH, 3), 0.1, np.float32)
        light[7, 10] = 1000
        write_radiance(file.with_suffix(".exr"), light, 900.0)
        file.unlink()
        left = np.tile(np.where(np.arange(WIDTH) < WIDTH // 2, 255, 0).astype(np.uint8), (HEIGHT, 1))
        Image.fromarray(left).save(bent / "masks" / f"{file.stem}.jpg.png")
    listed = bent / "sparse" / "0" / "images.txt"
    listed.write_text(listed.read_text().replace(".png", ".exr"))
    write_model(undistort(pycolmap, bent, out, lambda *row: None), out / "sparse" / "0")
    for view, read in zip(load_dataset(out).views, load_dataset(bent).views, strict=True):
        np.testing.assert_allclose(view.image, read.image, rtol=1e-3)  # half floats
        made, known = (Masks(folder / "masks", [of]).of(of) for folder, of in ((out, view), (bent, read)))
        assert made is not None and known is not None and 0 < made.sum() < made.size
        np.testing.assert_array_equal(made, known)
        assert exr_saturation(out / "images" / f"{view.name}.exr") == 900


def test_a_lens_that_cannot_be_undone_is_one_line(tmp_path):
    with pytest.raises(DataError, match="img_00.png: the lens .* that no lens has; use another --lens"):
        without_lens(tmp_path, 20, 22, 10.5, 7, 1e7, 0, 0, 0)
