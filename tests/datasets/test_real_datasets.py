"""The captures in ../shared: they load, their cameras see their points, and other readers agree."""

from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.datasets import check_cameras, load_dataset

DATA = Path(__file__).parents[2].parent / "shared" / "data"

def real(name: str) -> Path:
    if not (DATA / name).is_dir():
        pytest.skip(f"real data not there; put them in {DATA / name}")
    return DATA / name


@pytest.mark.parametrize(("name", "n", "size"), [("fox", 50, (112, 200)), ("fern", 20, (200, 150))])
def test_real_colmap_captures_load_with_every_eighth_image_for_test_and_cameras_that_see_the_points(
    name, n, size
):
    dataset = load_dataset(real(name), downscale=4)
    names = sorted(view.name for view in dataset.views)
    assert len(names) == n and [view.name for view in dataset.test] == names[::8]
    assert all((v.camera.width, v.camera.height) == size for v in dataset.views)
    assert all(v.image.shape == (size[1], size[0], 3) and v.image.dtype == np.float32 for v in dataset.views)
    check = check_cameras(dataset)
    assert check.n_points == len(dataset.points) == len(dataset.point_colors) > 9000
    assert check.in_front is not None and check.in_front > 0.99
    assert check.seen is not None and check.seen > 0.99
    assert check.color_difference is not None and check.color_difference < 0.15
    assert check.reprojection_px is None  # these models come without observations


def test_colour_agreement_is_far_better_than_with_shuffled_colours():
    dataset = load_dataset(real("fox"), downscale=4)
    agreement = check_cameras(dataset).color_difference
    dataset.point_colors = np.random.default_rng(0).permutation(dataset.point_colors)
    shuffled = check_cameras(dataset).color_difference
    assert agreement is not None and shuffled is not None and agreement < 0.6 * shuffled


def test_both_descriptions_of_fox_give_the_same_cameras_and_points():
    colmap = load_dataset(real("fox"), downscale=8)
    transforms = load_dataset(real("fox") / "transforms.json", downscale=8)
    for a, b in zip(colmap.views, transforms.views, strict=True):
        assert a.name == b.name
        np.testing.assert_allclose(a.camera.w2c, b.camera.w2c, atol=1e-4)
        np.testing.assert_allclose(a.camera.K, b.camera.K, rtol=1e-6)
    np.testing.assert_array_equal(colmap.points, transforms.points)


def test_lego_keeps_its_given_split_and_its_alpha_premultiplied():
    dataset = load_dataset(real("lego"), downscale=4)
    assert (len(dataset.train), len(dataset.test)) == (100, 100)
    assert dataset.has_alpha and len(dataset.points) == 0
    image = dataset.train[0].image
    assert image.shape == (100, 100, 4)
    assert (image[..., :3] <= image[..., 3:] + 1e-6).all()
    assert (dataset.train[0].name, dataset.test[0].name) == ("train_r_0", "test_r_0")
    axes = np.array([view.camera.c2w[:3, 2] for view in dataset.train])  # [V, 3]
    centres = np.array([view.camera.position for view in dataset.train])
    assert (np.einsum("vi,vi->v", axes, -centres) > 0).all()  # all of them look at the object in the origin


def test_our_reader_agrees_with_pycolmap_on_real_models():
    pycolmap = pytest.importorskip("pycolmap")
    folder = real("fox")
    model = pycolmap.Reconstruction(folder / "sparse/0")
    images = sorted(model.images.values(), key=lambda image: image.name)
    dataset = load_dataset(folder, downscale=8)
    for image, view in zip(images, sorted(dataset.views, key=lambda view: view.name), strict=True):
        np.testing.assert_allclose(view.camera.w2c[:3], image.cam_from_world().matrix(), atol=1e-12)
    expected = np.array([model.points3D[i].xyz for i in sorted(model.points3D)], np.float32)
    np.testing.assert_array_equal(dataset.points, expected)
