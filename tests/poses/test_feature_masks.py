"""Where no features are sought: a transparent pixel keeps a colour that nobody sees."""

import numpy as np
import pytest
from mi_dogsplat.poses.colmap_database import opened, pycolmap_module
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.feature_masks import feature_masks
from mi_dogsplat.poses.features import extract
from mi_dogsplat.poses.photographs import Photograph
from PIL import Image
from posed_room import SIZE

WIDTH, HEIGHT = SIZE
THIRD = WIDTH // 3
NAMES = ("both.png", "given.png", "opaque.png", "plain.png", "transparent.png")


def left(alpha: int, rest: int = 255) -> np.ndarray:
    """Levels [H, W]: the left third has the first, the rest the other one."""
    levels = np.full((HEIGHT, WIDTH), rest, np.uint8)
    levels[:, :THIRD] = alpha
    return levels


@pytest.fixture
def photographs(pixels, tmp_path) -> list[Photograph]:
    """One picture, with and without masks, and with colours below what is transparent."""
    (tmp_path / "images").mkdir()
    (tmp_path / "given").mkdir()
    alphas = {"transparent.png": left(0), "both.png": left(127, 128), "opaque.png": left(255)}
    for name in NAMES:
        image = Image.fromarray(pixels[0])
        if name in alphas:
            image.putalpha(Image.fromarray(alphas[name]))
        image.save(tmp_path / "images" / name)
    for name in ("given.png", "both.png"):
        Image.fromarray(np.flipud(np.triu(np.full((HEIGHT, WIDTH), 1, np.uint8)))).save(  # all but black is seen
            tmp_path / "given" / f"{name}.png"
        )
    return [Photograph(name, *SIZE, "camera", None) for name in NAMES]


def test_what_is_transparent_is_masked_as_well_as_what_masks_hide(photographs, tmp_path):
    given, made = tmp_path / "given", tmp_path / "made"
    folders = feature_masks(photographs, tmp_path / "images", given, made)
    assert folders == {"both.png": made, "given.png": given, "transparent.png": made}
    masks = {name: np.asarray(Image.open(folder / f"{name}.png")) > 0 for name, folder in folders.items()}
    np.testing.assert_array_equal(masks["transparent.png"], left(0) > 0)
    np.testing.assert_array_equal(masks["both.png"], masks["given.png"] & masks["transparent.png"])
    assert feature_masks(photographs[2:4], tmp_path / "images", None, made) == {}


def test_no_feature_is_found_of_a_colour_that_is_hidden(photographs, tmp_path):
    pycolmap, database = pycolmap_module(False), tmp_path / "database.db"
    masks = feature_masks(photographs, tmp_path / "images", None, tmp_path / "made")
    extract(pycolmap, database, tmp_path / "images", masks, photographs, PosesConfig(), lambda done, n: None)
    with opened(pycolmap, database) as content:
        found = {image.name: content.read_keypoints(image.image_id)[:, 0] for image in content.read_all_images()}
    assert sorted(found) == sorted(NAMES)
    hidden = {name: int((across < THIRD - 1).sum()) for name, across in found.items()}
    assert hidden["plain.png"] == hidden["opaque.png"] == hidden["given.png"] > 100
    assert hidden["transparent.png"] == hidden["both.png"] == 0 and len(found["transparent.png"]) > 100
