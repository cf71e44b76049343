"""Masks: what they hide has no gradient, is not learned and not measured."""

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.masks import Masks, mask_files
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.images.photographs import Photographs
from photographs import SHAPE, changed, config_of, image_of, left_half, planes_of, trained, write_masks
from PIL import Image


@pytest.mark.parametrize("options", [{}, {"appearance_steps": 60}, {"on_disk": True}])
def test_masked_pixels_have_no_gradient_whatever_they_show(data, tmp_path, options):
    dataset = load_dataset(data, on_disk=bool(options.get("on_disk")))
    used = left_half()
    masks = str(write_masks(tmp_path, dataset, used))
    images = np.random.default_rng(0).uniform(0.1, 0.9, (*SHAPE, 3)).astype(np.float32)
    other = np.where(used[..., None] > 0, images, 1 - images)
    results = []
    for image in (images, other):
        l1, loss, gradient = Photographs(dataset, 0.0, masks=masks, **options).compare(planes_of(image), 0, 0)
        results.append((float(l1[0]), float(loss[0]), image_of(gradient)))
    (l1, loss, gradient), again = results
    assert (l1, loss) == pytest.approx(again[:2]) and np.abs(gradient - again[2]).max() < 1e-9
    assert not gradient[used == 0].any() and np.abs(gradient[used == 1]).min(axis=1).max() > 0


def test_masks_are_named_as_images_whose_own_names_have_two_extensions(tmp_path):
    for name in ("a.jpg.png", "b.png", "c.JPG.png"):
        write_png(tmp_path / name, np.ones((2, 2), np.float32))
    named = {view: path.name for view, path in mask_files(tmp_path).items()}
    assert named == {"a": "a.jpg.png", "a.jpg": "a.jpg.png", "b": "b.png", "c": "c.JPG.png", "c.JPG": "c.JPG.png"}


def test_inside_of_the_mask_and_away_from_its_edge_the_gradient_is_that_without(data, tmp_path):
    dataset, used = load_dataset(data), left_half()
    image = np.random.default_rng(0).uniform(0.1, 0.9, (*SHAPE, 3)).astype(np.float32)
    masked = Photographs(dataset, 0.0, masks=str(write_masks(tmp_path, dataset, used)))
    free = Photographs(dataset, 0.0)
    gradients = [image_of(p.compare(planes_of(image), 2, 0)[2]) for p in (masked, free)]
    inside = slice(None), slice(SHAPE[1] // 2 + 11, None)
    assert gradients[0][inside] == pytest.approx(gradients[1][inside], rel=1e-3, abs=1e-9)


def test_training_with_masks_does_not_learn_what_they_hide(data, tmp_path):
    """A white box walks through the photographs, always somewhere else."""
    clean, used = load_dataset(data), np.ones((8, *SHAPE))
    for k, view in enumerate(clean.train):
        used[k, 2 + 2 * k : 20 + 2 * k, 4 * k : 20 + 4 * k] = 0
        write_png(tmp_path / f"{view.name}.png.png", used[k].astype(np.float32))  # COLMAP's way of naming
    spoiled = changed(clean, lambda k, image: np.where(used[k, ..., None] > 0, image, 1))
    without, hidden = (trained(spoiled, steps=250, masks=m).test_errors()["test_psnr"] for m in (None, str(tmp_path)))
    assert hidden > without + 1, (hidden, without)


def test_what_a_mask_hides_is_not_measured_and_a_view_that_is_all_black_is_left_out(data, tmp_path):
    config = config_of(steps=5, masks=str(tmp_path / "masks"))
    dataset = load_dataset(data)
    write_masks(tmp_path / "masks", dataset, left_half())
    hidden, clean = dataset.test[0], dataset.test[0].image
    spoiled = np.where(left_half()[..., None] > 0, clean, 1 - clean).astype(np.float32)
    found = []
    for image in (clean, spoiled):
        dataset.test[0] = View(hidden.name, hidden.camera, image)
        found.append(trained(dataset, steps=5, masks=config.masks).test_errors())
    assert found[0] == found[1]
    for view in dataset.test:
        write_png(tmp_path / "masks" / f"{view.name}.png", np.zeros(SHAPE, np.float32))
    assert trained(dataset, steps=5, masks=config.masks).test_errors(with_flip=True) == {}


def test_masks_of_any_size_are_scaled_and_read_as_black_or_white(tmp_path):
    for name, width, height in (("a", 4, 6), ("b", 2, 2)):
        write_png(tmp_path / f"{name}.png", np.array([[0, 1], [1, 0.2]], np.float32))
        view = View(name, tiny_data.cameras(1, width, height)[0], np.zeros((height, width, 3), np.float32))
        mask = Masks(tmp_path, [view]).of(view)
        expected = np.kron([[0, 1], [1, 0]], np.ones((height // 2, width // 2)))
        assert mask is not None and mask.tolist() == expected.tolist()


def test_a_mask_of_ones_instead_of_white_is_refused(tmp_path):
    view = View("a", tiny_data.cameras(1, 4, 6)[0], np.zeros((6, 4, 3), np.float32))
    for number, kind in ((1, np.uint8), (1, np.uint16), (0, np.uint8)):
        Image.fromarray(np.full((6, 4), number, kind)).save(tmp_path / "a.png")
        if number:
            with pytest.raises(DataError, match="a.png: has only 0 and 1, and both are black; multiply it by 255"):
                Masks(tmp_path, [view]).of(view)
            continue
        mask = Masks(tmp_path, [view]).of(view)
        assert mask is not None and not mask.any()


def test_a_mask_that_stands_where_its_image_lies_is_refused(tmp_path):
    """As one that was painted on a photograph as EXIF turns it, where the poses are of its pixels as they lie."""
    camera = tiny_data.cameras(1, 60, 40)[0]
    view = View("a", camera, np.zeros((40, 60, 3), np.float32))
    for width, height, fits in ((80, 120, False), (40, 59, False), (120, 80, True), (50, 50, True), (40, 80, True)):
        Image.fromarray(np.full((height, width), 255, np.uint8)).save(tmp_path / "a.png")
        if fits:
            assert Masks(tmp_path, [view]).of(view) is not None
            continue
        with pytest.raises(DataError, match=f"a.png: is {width}x{height}, turned by 90° against its image, 60x40; tu"):
            Masks(tmp_path, [view]).of(view)


@pytest.mark.parametrize(
    "mask",
    [
        "left/1.png", "left/1.JPG", "left/1.JPG.png", "left_1.webp", "left/1.PNG.png", "images/left/1.tif.png",
        "left/1.HEIC.png", "left/1.hif.PNG", "left_1.CR2.png", "left/1.exr.webp", "left/1.jxl.png",
    ],
)  # fmt: skip
def test_a_mask_is_found_by_the_name_of_its_image_in_every_way_of_writing_it(tmp_path, mask):
    camera, image = tiny_data.cameras(1, 2, 2)[0], np.zeros((2, 2, 3), np.float32)
    named, other = (View(name, camera, image) for name in ("left_1", "left_11"))
    (tmp_path / mask).parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.array([[0, 255], [255, 0]], np.uint8)).save(tmp_path / mask, lossless=True, quality=100)
    found = Masks(tmp_path, [other, named]).of(named)
    assert found is not None and found.tolist() == [[0, 1], [1, 0]]
    assert Masks(tmp_path, [other, named]).of(other) is None


@pytest.mark.parametrize("first, second, view", [("1.JPG", "1.JPG.png", "1"), ("left/c.jpg", "left/c.webp", "left_c")])
def test_photographs_beside_their_masks_are_not_taken_for_some(tmp_path, first, second, view):
    for name in (first, second):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with pytest.raises(DataError, match=f'{second}: would be a second mask of "{view}", besides {first}; remove one'):
        mask_files(tmp_path)


def test_of_a_capture_with_masks_beside_its_images_these_are_no_masks(tmp_path):
    for name in ("images/a.jpg", "images/b.jpg", "images_2/a.jpg", "b.png", "c/d.jpg.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    named = {view: path.relative_to(tmp_path).as_posix() for view, path in mask_files(tmp_path).items()}
    assert named == {"b": "b.png", "c_d": "c/d.jpg.png", "c_d.jpg": "c/d.jpg.png"}
    (tmp_path / "b.png").unlink()
    (tmp_path / "c" / "d.jpg.png").unlink()
    (tmp_path / "images_2" / "a.jpg").unlink()
    assert set(mask_files(tmp_path)) == {"a", "b"}


def test_what_downscaling_cuts_off_is_cut_off_masks_too(tmp_path):
    grey = np.zeros((7, 11), np.uint8)
    grey[:, 9:] = 255  # the columns that are left over when 11 are divided by 3
    Image.fromarray(grey).save(tmp_path / "a.png")
    view = View("a", tiny_data.cameras(1, 3, 2)[0], np.zeros((2, 3, 3), np.float32))
    mask = Masks(tmp_path, [view]).of(view)
    assert mask is not None and not mask.any()


@pytest.mark.parametrize("on_disk", [False, True])
def test_masks_that_leave_nothing_to_train_on_are_refused(data, tmp_path, on_disk):
    dataset, first = load_dataset(data), np.zeros(SHAPE)
    write_masks(tmp_path, dataset, first)
    with pytest.raises(DataError, match=f"{tmp_path}: is black in every view that is trained on; paint white"):
        Photographs(dataset, 0.0, masks=str(tmp_path), on_disk=on_disk)
    first[3, 5] = 1  # a pixel of one view counts
    write_png(tmp_path / f"{dataset.train[0].name}.png", first.astype(np.float32))
    Photographs(dataset, 0.0, masks=str(tmp_path), on_disk=on_disk)


def test_bad_masks_are_refused_in_one_line(data, tmp_path):
    dataset = load_dataset(data)
    with pytest.raises(DataError, match="no such folder"):
        Photographs(dataset, 0.0, masks=str(tmp_path / "none"))
    with pytest.raises(DataError, match="has no mask for any"):
        Photographs(dataset, 0.0, masks=str(tmp_path))
    (tmp_path / f"{dataset.train[0].name}.png").write_text("no image")
    with pytest.raises(DataError, match="cannot be read"):
        Photographs(dataset, 0.0, masks=str(tmp_path))
