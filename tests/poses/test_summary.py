"""What was found, in numbers and in words: of models that are made here."""

from types import SimpleNamespace
from typing import Any

import pytest
from mi_dogsplat.datasets.world import World
from mi_dogsplat.poses.advice import Advice
from mi_dogsplat.poses.photographs import Photograph
from mi_dogsplat.poses.summary import Summary, outcome_of, summary_of
from mi_dogsplat.poses.world import Placed

pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")


def camera(model: str, width: int, height: int, prior: bool = False) -> Any:
    """Of a focal length of 400 pixels."""
    made = pycolmap.Camera.create_from_model_name(1, model, 400, width, height)
    made.has_prior_focal_length = prior
    return made


def model_of(posed: str, others: str = "", cameras: tuple = ()) -> Any:
    """What is read of a model of pycolmap's with images of these letters, with a pose or without."""
    images = [SimpleNamespace(name=name, has_pose=name in posed) for name in posed + others]
    return SimpleNamespace(
        images=dict(enumerate(images)), cameras=dict(enumerate(cameras)), num_points3D=lambda: 1234,
        compute_mean_reprojection_error=lambda: 0.8, compute_mean_observations_per_reg_image=lambda: 56.7,
    )  # fmt: skip


def photographs(names: str, width: int = 3000, height: int = 4000) -> list[Photograph]:
    return [Photograph(name, width, height, "", None) for name in names]


def test_other_models_count_by_what_the_first_one_does_not_connect_to():
    models = [model_of("abc", "d"), model_of("cde"), model_of("ab"), model_of("fg")]
    outcome = outcome_of(models, photographs("abcdefg"), 2000)
    assert (outcome.n_images, outcome.n_registered, outcome.others) == (7, 3, (2, 2))


@pytest.mark.parametrize("size, error", [((3000, 4000), 0.4), ((4000, 3000), 0.4), ((1000, 500), 0.8)])
def test_the_error_is_in_pixels_of_the_images_in_which_features_were_sought(size, error):
    assert outcome_of([model_of("ab")], photographs("ab", *size), 2000).error == pytest.approx(error)


def test_fields_of_view_that_were_guessed_are_those_along_the_longer_side():
    cameras = camera("PINHOLE", 300, 800), camera("PINHOLE", 999, 9, prior=True), camera("OPENCV_FISHEYE", 800, 300)
    outcome = outcome_of([model_of("ab", cameras=cameras)], photographs("ab"), 2000)
    assert outcome.guessed == pytest.approx((90, 360 / 3.14159265))


def test_a_summary_counts_what_has_a_pose_and_names_the_rest():
    cameras = camera("PINHOLE", 300, 800), camera("PINHOLE", 300, 800), camera("PINHOLE", 800, 300)
    model, placed = model_of("ab", "c", cameras), Placed(World("-y", 1.0), "as 3 images say")
    found = summary_of(model, photographs("dabc"), 2, placed, [Advice("it rains", "wait")], {"images": 1.0})
    assert (found.n_images, found.n_registered, found.n_points, found.observations) == (4, 2, 1234, 56.7)
    assert found.without_pose == ["d", "c"] and len(found.cameras) == 2
    assert found.lines()[3:7] == [
        "up is -y, as 3 images say; the unit is a metre", "2 masks; train with --masks and the folder masks/ here",
        "without a pose: d, c", "warning: it rains; wait",
    ]  # fmt: skip


@pytest.mark.parametrize("names, said", [("abcde", "a, b, c, d, e"), ("abcdefg", "a, b, c, d, e and 2 more")])
def test_few_of_the_images_without_a_pose_are_named(names, said):
    lines = Summary(9, 2, 100, 0.5, 70.0, [], 0, list(names), [], {}).lines()
    assert f"without a pose: {said}" in lines
    assert "up is -y, as the cameras were held; the unit is arbitrary; --scale makes it a metre" in lines
