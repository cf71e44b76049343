"""Which cameras the images share, and what pycolmap is asked for where features are sought; it is not called."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from mi_dogsplat.poses import features
from mi_dogsplat.poses.colmap_database import opened
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.features import extract
from mi_dogsplat.poses.photographs import Photograph
from mi_dogsplat.support.errors import DataError

pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")

PHOTOGRAPHS = [
    Photograph("a.jpg", 300, 400, "phone", None),
    Photograph("b.jpg", 640, 480, "camera", 700.0),
    Photograph("c.jpg", 300, 400, "phone", None),
    Photograph("d.jpg", 300, 400, "phone", None),
]


@pytest.fixture
def calls(monkeypatch) -> list[tuple]:
    """(names, camera, mask, options, device) of each call that seeks features, and bytes that room was asked for."""
    found, noted = set(), []

    def seek(database: str, folder: str, names: list[str], *, reader_options, extraction_options, device) -> None:
        mask = str(reader_options.mask_path)
        noted.append((names, reader_options, mask if mask != "." else "", extraction_options, device))
        found.update(name for name in names if "dark" not in name)

    monkeypatch.setattr(pycolmap, "extract_features", seek)
    monkeypatch.setattr(features, "_names_with_features", lambda *_: set(found))
    monkeypatch.setattr(features, "require_room", lambda file, n_bytes: noted.append(n_bytes // features.IMAGE_BYTES))
    monkeypatch.setattr(features, "usable_cores", lambda: 1)
    monkeypatch.setattr(features, "BATCH", 2)
    return noted


def sought(
    folder: Path,
    config: PosesConfig,
    photographs=PHOTOGRAPHS,
    masks: Mapping[str, Path] = MappingProxyType({}),
    progress=lambda done, n: None,
) -> dict:
    """The cameras by their ids."""
    database = folder / "database.db"
    extract(pycolmap, database, folder, masks, photographs, config, progress)
    with opened(pycolmap, database) as content:
        return {camera.camera_id: camera for camera in content.read_all_cameras()}


def test_a_focal_length_that_no_file_says_is_that_of_colmap_or_of_an_action_camera(tmp_path, calls):
    phone, camera = sought(tmp_path, PosesConfig()).values()
    assert phone.focal_length == pytest.approx(400 * pycolmap.ImageReaderOptions().default_focal_length_factor)
    assert (phone.width, phone.height, phone.has_prior_focal_length) == (300, 400, False)
    assert (camera.width, camera.height, camera.focal_length, camera.has_prior_focal_length) == (640, 480, 700, True)
    (tmp_path / "wide").mkdir()
    phone, camera = sought(tmp_path / "wide", PosesConfig(lens="OPENCV_FISHEYE")).values()
    angle = 400 / phone.params[0]  # equidistant, along the longer side
    assert np.degrees(angle) == pytest.approx(115, abs=1) and phone.has_prior_focal_length
    assert camera.params[0] == 700 and camera.has_prior_focal_length and camera.model.name == "OPENCV_FISHEYE"


@pytest.mark.parametrize("gpu", [False, True])
def test_each_image_is_sought_with_its_camera_and_mask_where_and_as_large_as_is_asked(tmp_path, calls, gpu):
    told, config = [], PosesConfig(lens="OPENCV", gpu=gpu, feature_size=123)
    cameras = sought(tmp_path, config, masks={"c.jpg": tmp_path / "masks"}, progress=lambda *row: told.append(row))
    assert told == [(0, 4), (2, 4), (3, 4), (4, 4)]
    asked = [call for call in calls if isinstance(call, tuple)]
    assert [(names, mask) for names, _, mask, _, _ in asked] == [
        (["a.jpg", "d.jpg"], ""), (["b.jpg"], ""), (["c.jpg"], str(tmp_path / "masks")),
    ]  # fmt: skip
    assert [cameras[reader.existing_camera_id].width for _, reader, _, _, _ in asked] == [300, 640, 300]
    for _, reader, _, options, device in asked:
        assert reader.camera_model == "OPENCV" and options.max_image_size == 123 and options.use_gpu == gpu
        assert device == (pycolmap.Device.cuda if gpu else pycolmap.Device.cpu)
    calls.clear()
    more = [*PHOTOGRAPHS, *(Photograph(f"{k}.jpg", 640, 480, "camera", 700.0) for k in range(3))]
    assert sought(tmp_path, config, more).keys() == cameras.keys()  # of what was sought before, nothing is again
    assert [call if isinstance(call, int) else call[0] for call in calls] == [
        2, 2, ["0.jpg", "1.jpg"], 1, ["2.jpg"],
    ]  # fmt: skip


def test_the_first_image_in_which_nothing_is_found_is_named(tmp_path, calls):
    photographs = [Photograph(name, 300, 400, "phone", None) for name in ("c dark.jpg", "a.jpg", "b dark.jpg")]
    with pytest.raises(DataError, match="/b dark.jpg: pycolmap finds no features in it; look at the image"):
        sought(tmp_path, PosesConfig(), photographs)
