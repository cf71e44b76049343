"""A capture of a Mitsuba scene is an exact data set: the reader takes it, and its parts fit together."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.datasets import check_cameras, load_dataset
from mi_dogsplat.datasets.capture import capture, look_at, spiral
from mi_dogsplat.errors import DataError

DEMO = Path(__file__).parents[1] / "scenes" / "demo_truth.xml"
TINY: dict[str, Any] = {"n_views": 2, "n_test": 1, "width": 32, "height": 24, "spp": 4, "n_points": 300}

# Eight balls of eight colours at the corners of a box: no rotation or mirroring maps the scene to itself.
BALLS = [(x, y, z) for x in (-1, 1) for y in (-0.7, 0.7) for z in (-0.5, 0.5)]
BALL = """
<shape type="sphere"><point name="center" x="{}" y="{}" z="{}"/><float name="radius" value="0.4"/>
<bsdf type="diffuse"><rgb name="reflectance" value="{}, {}, {}"/></bsdf></shape>"""


@pytest.fixture(scope="module", autouse=True)
def variant():
    mi = pytest.importorskip("mitsuba", reason="install mitsuba to render")
    mi.set_variant("llvm_ad_rgb")


@pytest.fixture(scope="module")
def balls(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "balls.xml"
    shapes = [BALL.format(*p, *(0.1 + 0.8 * (np.sign(p) > 0))) for p in BALLS]
    head = '<scene version="3.0.0"><integrator type="path"/><emitter type="constant"/>'
    file.write_text(head + "".join(shapes) + "</scene>")
    return file


@pytest.fixture(scope="module")
def captured(balls, tmp_path_factory) -> Path:
    return capture(balls, tmp_path_factory.mktemp("data"), **TINY)


def test_the_reader_takes_a_capture_and_keeps_its_split(captured):
    dataset = load_dataset(captured)
    assert [view.name for view in dataset.test] == ["001"]
    assert [view.name for view in dataset.train] == ["000", "002"]
    assert dataset.train[0].image.shape == (24, 32, 3) and not dataset.has_alpha
    assert 200 < len(dataset.points) <= TINY["n_points"]


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_points_project_onto_their_own_colour(balls, tmp_path, up):
    dataset = load_dataset(capture(balls, tmp_path, **{**TINY, "width": 64, "height": 48}, up=up))
    check = check_cameras(dataset)
    assert check.in_front == 1 and check.seen == 1
    # Each point came from a pixel of one view: there it must find its colour, up to PLY's and PNG's 8 bits.
    best = np.full(len(dataset.points), np.inf)
    for view in dataset.train:
        column, line = np.floor(view.camera.project(dataset.points)[0]).astype(int).T
        best = np.minimum(best, np.abs(view.image[line, column] - dataset.point_colors).max(axis=1))
    assert best.max() < 1e-6


def test_points_lie_on_the_surfaces_whose_colour_they_have(captured):
    dataset = load_dataset(captured)
    offsets = dataset.points[:, None] - np.array(BALLS)  # [P, 8, 3]
    distances = np.linalg.norm(offsets, axis=2)  # [P, 8]
    np.testing.assert_allclose(distances.min(axis=1), 0.4, atol=1e-4)
    signs = np.sign(np.array(BALLS))[distances.argmin(axis=1)]  # [P, 3]
    bright = np.where(dataset.point_colors > 0.7, 1, -1)
    assert (bright == signs).mean() > 0.9  # not all: pixels at an outline mix two colours


def test_a_capture_repeats_itself_bit_by_bit_and_replaces_the_older_one(balls, captured, tmp_path):
    capture(balls, tmp_path, **{**TINY, "n_views": 4, "n_test": 2})
    capture(balls, tmp_path, **TINY)
    for name in ("transforms_train.json", "transforms_test.json", "points.ply", "images/000.png"):
        assert (tmp_path / name).read_bytes() == (captured / name).read_bytes(), name


def test_an_interrupted_capture_is_no_data_set(balls, tmp_path, monkeypatch):
    capture(balls, tmp_path, **TINY)
    monkeypatch.setattr("mi_dogsplat.datasets.capture.write_point_ply", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        capture(balls, tmp_path, **TINY)
    with pytest.raises(DataError, match="not a known data set"):
        load_dataset(tmp_path)


def test_the_demo_scene_can_be_captured_and_its_cameras_see_all_of_it(tmp_path):
    dataset = load_dataset(capture(DEMO, tmp_path, **TINY))
    check = check_cameras(dataset)
    assert check.seen == 1 and check.inside == 1
    assert np.ptp(dataset.points, axis=0).max() < 3.5  # the table, not the lamp far away


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_the_orbit_stays_in_its_band_and_looks_at_the_centre_upright(up):
    axis = "xyz".index(up)
    directions = spiral(50, up, (10, 60))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    elevation = np.degrees(np.arcsin(directions[:, axis]))
    assert 10 < elevation.min() < 12 and 58 < elevation.max() < 60
    assert np.linalg.norm(np.delete(directions, axis, axis=1).mean(axis=0)) < 0.05  # all around
    target = np.array([1.0, 2.0, 3.0])
    w2c = look_at(target + 5 * directions[7], target, up)
    np.testing.assert_allclose(w2c @ [*target, 1], [0, 0, 5, 1], atol=1e-12)
    assert np.linalg.det(w2c[:3, :3]) == pytest.approx(1)
    raised = w2c[:3, :3] @ np.eye(3)[axis]
    assert raised[0] == pytest.approx(0) and raised[1] < 0  # up in the world is up in the image


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "no such file"),
        ("<scene", "Mitsuba cannot load it"),
        ('<scene version="3.0.0"><emitter type="constant"/></scene>', "no shape besides its lamps"),
    ],
)
def test_a_scene_that_cannot_be_captured_is_named(tmp_path, content, problem):
    file = tmp_path / "scene.xml"
    if content is not None:
        file.write_text(content)
    with pytest.raises(DataError, match=problem) as raised:
        capture(file, tmp_path / "out", **TINY)
    assert str(raised.value).startswith(str(file)) and "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "wrong", [{"n_views": 0}, {"up": "-z"}, {"elevations": (30, 20)}, {"elevations": (0, 90)}]
)
def test_numbers_that_make_no_orbit_are_refused(balls, tmp_path, wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        capture(balls, tmp_path, **{**TINY, **wrong})
