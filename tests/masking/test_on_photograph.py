"""Masks on the photographs as they were taken: reading them for a view gives what was found in it."""

import numpy as np
import pytest
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.lens import Lens, undistortion
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.masking.on_photograph import on_photograph
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.pictures import write_png

LENSES = {
    "barrel": Lens((-0.15, 0.01)),
    "pincushion": Lens((0.08,), (0.002, -0.001)),
    "fisheye": Lens((0.01, 0, 0, 0), fisheye=True),
}


def disc(height: int, width: int) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return np.hypot(x - 0.7 * width, y - 0.4 * height) < 0.2 * height


def read_for(view: View, mask: np.ndarray, folder) -> np.ndarray:
    """What counts in the view by this mask [H, W], True where it does not."""
    write_png(folder / f"{view.name}.png", np.where(mask, 0.0, 1.0)[..., None].repeat(3, axis=2))
    found = Masks(folder, [view]).of(view)
    assert found is not None
    return found < 0.5


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("shrink", [1, 2])
def test_the_lens_is_put_back(name, shrink, tmp_path):
    source = Camera(np.eye(4), 150, 130, 102, 73, 200, 150)
    straight = undistortion(source, LENSES[name])
    camera = straight.camera.downscaled(shrink)
    view = View("a", camera, np.zeros((camera.height, camera.width, 3), np.uint8), straight)
    found = disc(camera.height, camera.width)
    mask = on_photograph(found, view)
    assert mask.shape == (150, 200)
    back = read_for(view, mask, tmp_path)
    assert back.shape == found.shape
    assert (back != found).sum() < 0.12 * found.sum()  # a ring of half a pixel, of a disc of 30
    whole = straight.camera
    for radius, inside in ((0.17, True), (0.23, False)):
        for angle in np.arange(0, 2 * np.pi, 0.5):
            edge = radius * whole.height * np.array([np.cos(angle), np.sin(angle)])
            ray = (edge + (0.7 * whole.width, 0.4 * whole.height) - (whole.cx, whole.cy)) / (whole.fx, whole.fy)
            x, y = np.floor(LENSES[name].distort(ray) * (150, 130) + (102, 73)).astype(int)
            assert mask[y, x] == inside


def test_what_the_pinhole_does_not_see_is_not_masked():
    source = Camera(np.eye(4), 150, 150, 100, 75, 200, 150)
    straight = undistortion(source, LENSES["barrel"])  # of whose photographs the corners are lost
    camera = straight.camera
    view = View("a", camera, np.zeros((camera.height, camera.width, 3), np.uint8), straight)
    mask = on_photograph(np.ones((camera.height, camera.width), bool), view)
    x, y = np.moveaxis(straight.source_pixels(), -1, 0)
    seen = np.zeros_like(mask)
    seen[y.astype(int), x.astype(int)] = True
    assert mask[seen].mean() > 0.99
    assert not mask[0, 0] and not mask[-1, -1]


def test_without_a_lens_a_mask_is_as_large_as_the_view(tmp_path):
    view = View("a", Camera(np.eye(4), 300, 300, 200, 150, 403, 302), np.zeros((302, 403, 3), np.uint8))
    found = disc(151, 201)  # in which it was looked for
    mask = on_photograph(found, view)
    assert mask.shape == (302, 403)
    assert (mask[:302, :402] != found.repeat(2, axis=0).repeat(2, axis=1)).sum() < 0.03 * mask.sum()
    np.testing.assert_array_equal(read_for(view, mask, tmp_path), mask)
