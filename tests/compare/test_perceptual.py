"""LPIPS of a comparison: of pictures as they lie in the run folders, where masks let them count."""

import json

import numpy as np
import pytest
from mi_dogsplat.compare.perceptual import measure_lpips
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.measure.lpips import Lpips
from PIL import Image
from small_vgg import small_weights
from tiny_data import HEIGHT, WIDTH, cameras


def test_a_view_that_masks_leave_nothing_of_has_no_picture_and_no_weight(tmp_path):
    rng, lpips = np.random.default_rng(0), Lpips(small_weights())
    views = [View(name, camera, np.zeros((HEIGHT, WIDTH, 3))) for name, camera in zip("ab", cameras(2), strict=True)]
    (tmp_path / "masks").mkdir()
    Image.new("L", (WIDTH, HEIGHT)).save(tmp_path / "masks" / "a.png")
    pictures = {end: rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8) for end in ("", "_gt")}
    (tmp_path / "run" / "test").mkdir(parents=True)
    for end, pixels in pictures.items():
        Image.fromarray(pixels).save(tmp_path / "run" / "test" / f"b{end}.png")
    measure_lpips([tmp_path / "run"], views, lpips, Masks(tmp_path / "masks", views))
    found = json.loads((tmp_path / "run" / "lpips.json").read_text())
    assert found == {"lpips": pytest.approx(lpips(pictures[""] / 255, pictures["_gt"] / 255), rel=1e-5)}
