"""Training images that do not fit: each cause, planted in a photograph of a known model, is found, and no other."""

import json
from pathlib import Path

import numpy as np
import pytest
import tiny_data
from html_pages import parsed, section, words
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.measure.misfit import CAUSES, explained, likely_cause, relative_sharpness, usual_shares
from mi_dogsplat.render.picture import picture_of
from mi_dogsplat.report.run_folder import MISFITS
from mi_dogsplat.report.write import write_report
from mi_dogsplat.runs.misfits import FEWEST, LEAST_PSNR, _low, find_misfits, write_misfits
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support import pipeline
from mi_dogsplat.support.pictures import heat_map
from PIL import Image
from scipy.ndimage import gaussian_filter, shift
from splat_scenes import make_splats, rounded

NOISE = 0.01
PLANTED = {2: "blur", 4: "exposure", 6: "pose", 8: "region"}


def camera_of(camera: Camera, degrees: float) -> Camera:
    """The camera turned about its vertical."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
    return Camera(turn @ camera.w2c, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)


@pytest.fixture(scope="module")
def scene():
    """Renders of a model with detail, by view; and the views, whose images are from a pose that is a degree off."""
    rng = np.random.default_rng(0)
    sizes = rng.uniform(0.02, 0.08, (500, 3))
    splats = rounded(make_splats(rng.uniform(-0.8, 0.8, (500, 3)), sizes, 0.9, rng.uniform(0.1, 0.9, (500, 3))))
    shot = picture_of(splats, 0.5)
    renders, views = {}, []
    for i, camera in enumerate(tiny_data.cameras(12, 120, 90)):
        name = f"{i:02d}"
        renders[name], shown = (shot(camera_of(camera, degrees)).color for degrees in (0.0, 1.0))
        views.append(View(name, camera, shown))
    return renders, views


def noisy(image: np.ndarray, seed: int) -> np.ndarray:
    noise = NOISE * np.random.default_rng(seed).normal(size=image.shape)
    return np.clip(image + noise, 0, 1).astype(np.float32)


def photographs(scene, planted: bool) -> list[View]:
    """The views, each with its photograph; those of ``PLANTED`` with what is wrong in it."""
    renders, views = scene
    found = []
    for i, view in enumerate(views):
        image = renders[view.name]
        match PLANTED.get(i) if planted else None:
            case "blur":
                image = gaussian_filter(image, (1.5, 1.5, 0))
            case "exposure":
                image = 0.6 * image
            case "pose":
                image = view.image
            case "region":
                image = image.copy()
                image[20:55, 30:60] = (0.1, 0.2, 0.7)
        found.append(View(view.name, view.camera, noisy(image, i)))
    return found


def misfits(scene, planted: bool, **how):
    return find_misfits(lambda view: scene[0][view.name], photographs(scene, planted), 0.0, **how)


def test_each_cause_is_found_where_it_was_planted_and_nowhere_else(scene):
    quality, found = misfits(scene, planted=True)
    assert {misfit.name: misfit.cause for misfit in found} == {f"{i:02d}": cause for i, cause in PLANTED.items()}
    assert [misfit.below for misfit in found] == sorted((misfit.below for misfit in found), reverse=True)
    assert all(misfit.explained > 0.3 and misfit.psnr == quality[misfit.name] for misfit in found)


def test_a_clean_capture_has_none(scene):
    quality, found = misfits(scene, planted=False)
    assert len(quality) == 12 and not found


def test_what_is_masked_does_not_count_and_colours_that_are_learnt_are_not_held_against_an_image(scene):
    class Masks:
        def of(self, view):
            mask = np.ones((90, 120), np.float32)
            mask[15:60, 25:65] = 0
            return mask * (view.name != "03")

    quality, found = misfits(scene, planted=True, masks=Masks())
    assert {misfit.name for misfit in found} == {"02", "04", "06"} and len(quality) == 11 and "03" not in quality
    assert "04" not in {misfit.name for misfit in misfits(scene, planted=True, exposure=True)[1]}


@pytest.mark.parametrize("exposure", [False, True])
def test_threads_find_what_is_found_one_by_one(scene, monkeypatch, exposure):
    found = []
    for cores in (1, 3):
        monkeypatch.setattr(pipeline, "usable_cores", lambda cores=cores: cores)
        quality, views = misfits(scene, planted=True, exposure=exposure)
        found.append((list(quality.items()), views))
    assert found[0] == found[1] and found[0][1]


def test_a_blurred_image_is_found_where_the_model_is_not_sharp_and_shows_it_better_than_others(scene):
    renders, views = scene
    soft = {name: gaussian_filter(image, (1.2, 1.2, 0)) for name, image in renders.items()}
    blurred = {"02": gaussian_filter(renders["02"], (2, 2, 0))}
    views = [View(view.name, view.camera, (renders | blurred)[view.name]) for view in views]
    quality, found = find_misfits(lambda view: soft[view.name], views, 0.0)
    assert [(misfit.name, misfit.cause) for misfit in found] == [("02", "blur")]
    assert quality["02"] > np.median(list(quality.values())) and found[0].below < 0


def test_what_is_low_is_so_by_the_spread_of_the_lower_half_where_that_is_less():
    even = {str(k): 20.0 + k for k in range(21)}
    assert _low(even, LEAST_PSNR) == set()  # as far below as most are from the middle
    long_tail = {str(k): 30 + (0.01 * k if k < 0 else k) for k in range(-9, 11)} | {"poor": 30 - 2 * LEAST_PSNR}
    assert _low(long_tail, LEAST_PSNR) == {"poor"}
    assert _low(long_tail | {"poor": 30 - 0.9 * LEAST_PSNR}, LEAST_PSNR) == set()


def test_few_views_tell_nothing(scene):
    quality, found = find_misfits(lambda view: scene[0][view.name], photographs(scene, True)[: FEWEST - 1], 0.0)
    assert len(quality) == FEWEST - 1 and not found


@pytest.mark.parametrize(("change", "cause"), [
    (lambda image: gaussian_filter(image, (2, 2, 0)), "blur"),
    (lambda image: np.mean([np.roll(image, k, axis=1) for k in range(-3, 4)], axis=0), "blur"),
    (lambda image: np.clip(image * (1.2, 1.0, 0.7), 0, 1), "exposure"),
    (lambda image: image**1.4, "exposure"),
    (lambda image: shift(image, (0, 2.5, 0), order=1, mode="nearest"), "pose"),
])  # fmt: skip
def test_a_cause_explains_most_of_the_error_that_it_makes(scene, change, cause):
    render = next(iter(scene[0].values()))
    shares = explained(render, noisy(change(render), 0))
    assert max(CAUSES, key=lambda name: shares[name]) == cause and shares[cause] > 0.5
    assert likely_cause(shares, usual_shares([explained(render, noisy(render, 1))])) == cause


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 900), (900, 1)])
def test_images_of_few_pixels_have_shares_too(size):
    render, photograph = np.random.default_rng(0).uniform(size=(2, *size, 3))
    assert all(0 <= share <= 1 for share in explained(render, photograph).values())


def test_pictures_that_are_alike_have_no_cause(scene):
    render = next(iter(scene[0].values()))
    assert set(explained(render, render).values()) == {0.0} and relative_sharpness(render, render) == 0
    assert relative_sharpness(render, gaussian_filter(render, (2, 2, 0))) < -1
    assert not likely_cause(dict.fromkeys(CAUSES, 0.3), dict.fromkeys(CAUSES, 0.2))


@pytest.fixture
def folder(scene, tmp_path):
    """A run folder with what does not fit in it."""
    (tmp_path / "config.json").write_text("{}")
    write_misfits(tmp_path, lambda view: scene[0][view.name], photographs(scene, True), 100, 0.0)
    return tmp_path


def test_the_report_names_them_with_pictures_and_what_helps(folder):
    page = parsed(write_report(folder).read_text())
    part = section(page, "Images that do not fit")
    assert part is not None
    text = words(part)
    remedy = "mask it (by dogsplat masks, or by hand)"
    for said in ("12 of 12 training views were looked at", remedy, "something was in the way"):
        assert said in text
    sources = [image.get("src", "") for image in part.iter("img")]
    assert len(sources) == 3 * len(PLANTED) and all(source.startswith("data:image/jpeg") for source in sources)
    assert sum(map(len, sources)) < 400_000


def test_pictures_of_errors_show_what_is_too_dark_as_what_is_too_bright(scene, folder):
    renders, truths = scene[0], {view.name: view.image for view in photographs(scene, True)}
    for name in json.loads((folder / MISFITS).read_text())["misfits"]:
        errors = np.abs(np.clip(renders[name], 0, 1) - truths[name]).mean(axis=2)
        expected = 255 * heat_map(np.clip(errors / 0.25, 0, 1))
        shown = np.asarray(Image.open(folder / Path(MISFITS).parent / f"{name}_error.png"), np.float64)
        np.testing.assert_allclose(shown, expected, atol=1.01)


def test_a_report_says_that_there_are_none_and_nothing_of_a_run_that_did_not_look(scene, tmp_path):
    (tmp_path / "config.json").write_text("{}")
    assert "do not fit" not in write_report(tmp_path).read_text()
    write_misfits(tmp_path, lambda view: scene[0][view.name], photographs(scene, False), 100, 0.0)
    assert "None: 12 of 12 training views" in write_report(tmp_path).read_text()
    found = json.loads((tmp_path / MISFITS).read_text())
    assert found["misfits"] == {} and found["n_views"] == 12 and found["seconds"] > 0


@pytest.mark.parametrize("least, looked_at", [(4, 5), (7, 7), (11, 11), (12, 12), (13, 12)])
def test_of_many_views_some_are_looked_at_evenly_spread(scene, tmp_path, monkeypatch, least, looked_at):
    """One for every 20 of 100 steps, and ``least``; every second of twelve would be six where eleven are due."""
    monkeypatch.setattr("mi_dogsplat.runs.misfits.LEAST_VIEWS", least)
    write_misfits(tmp_path, lambda view: scene[0][view.name], photographs(scene, False), 100, 0.0)
    places = [int(name) for name in json.loads((tmp_path / MISFITS).read_text())["psnr"]]
    assert len(places) == looked_at
    assert set(np.diff([*places, 12])) <= {12 // looked_at, -(-12 // looked_at)}
