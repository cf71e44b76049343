"""A capture of a scene with splats: its depth and its points are where splats and surfaces are seen."""

import json
from pathlib import Path

import numpy as np
import pytest
from captured_scenes import error_of, tiny
from mi_dogsplat.datasets import check_cameras, load_dataset
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.scene.drawing import Drawing, comments_of
from mi_dogsplat.scene.ply import write_ply
from splat_scenes import make_splats, rounded

STILL_LIFE = Path(__file__).parents[2] / "scenes" / "still_life.xml"
BEFORE, BOARD, BEHIND = 2.0, 2.5, 3.0  # depths
DOGSPLAT = '<integrator type="dogsplat"><integrator type="direct"/></integrator>'
ALONE = '<integrator type="dogsplat"/>'
PATH = '<integrator type="path"/>'
DOGPATH = '<integrator type="dogpath"/>'
SCENE = """<scene version="3.0.0">{}<shape type="dog"><string name="filename" value="model.ply"/></shape>
    <emitter type="constant"/><shape type="rectangle"><transform name="to_world"><lookat origin="0,0,2.5"
    target="0,0,0" up="0,1,0"/></transform></shape></scene>"""


def test_a_scene_of_splats_alone_is_captured_with_points_on_what_they_show(tmp_path):
    dataset = load_dataset(capture(STILL_LIFE, tmp_path / "out", tiny(size=(64, 48), spp=1)))
    check = check_cameras(dataset)
    assert len(dataset.points) == 200 and check.in_front == 1 and check.seen == 1
    best = np.full(len(dataset.points), np.inf)
    for view in dataset.train:  # in that from which a point comes its pixel has its colour, up to 8 bits
        column, line = np.floor(view.camera.project(dataset.points)[0]).astype(int).T
        best = np.minimum(best, np.abs(view.image[line, column] - dataset.point_colors).max(axis=1))
    assert best.max() < 1e-6


def test_a_scene_of_splats_can_be_captured_without_points(tmp_path):
    dataset = load_dataset(capture(STILL_LIFE, tmp_path / "out", tiny(spp=1, points=0)))
    assert len(dataset.points) == 0 and dataset.train[0].image.std() > 0.05
    assert "ply_file_path" not in json.loads((tmp_path / "out" / "transforms.json").read_text())


@pytest.mark.parametrize(
    "integrator, left, right",
    [(DOGSPLAT, BEFORE, BOARD), (DOGPATH, BEFORE, BOARD), (PATH, BOARD, BOARD), (ALONE, BEFORE, BEHIND)],
)
def test_depth_is_that_of_splats_where_they_hide_what_is_behind(tmp_path, integrator, left, right):
    """Splats cover the left half before a board, faint ones all of it, and a dense wall stands behind: only the first
    are seen, and only by integrators that know splats; the wall by one that shows no board."""
    x, y = np.meshgrid(np.arange(-1.5, 1.51, 0.1), np.arange(-1.5, 1.51, 0.1))
    places = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    layers = [places[places[:, 0] < -0.15] + (0, 0, BEFORE), places + (0, 0, 1), places + (0, 0, BEHIND)]
    opacities = np.concatenate([np.full(len(layer), o) for layer, o in zip(layers, (0.99, 0.02, 0.99), strict=True)])
    write_ply(tmp_path / "model.ply", rounded(make_splats(np.concatenate(layers), 0.06, opacities)))
    (tmp_path / "scene.xml").write_text(SCENE.format(integrator))
    camera = {"w2c": np.eye(4).tolist(), "fx": 40, "width": 32, "height": 24}
    (tmp_path / "cameras.json").write_text(json.dumps([camera]))
    settings = CaptureConfig(path=str(tmp_path / "cameras.json"), depth="npy", spp=1, points=300)
    depth = np.load(capture(tmp_path / "scene.xml", tmp_path / "out", settings) / "depth" / "000.npy")
    np.testing.assert_allclose(depth[:, :10], left, rtol=1e-6)
    np.testing.assert_allclose(depth[:, 18:], right, rtol=1e-6)
    points = load_dataset(tmp_path / "out").points
    kinds = {round(float(z), 4) for z in points[:, 2]}
    assert kinds == {left, right} and (points[points[:, 2] == right, 0].min() < -0.3) == (left == right)


def test_depth_is_that_of_splats_as_the_integrator_of_the_scene_draws_them(tmp_path, capfd):
    """Two files disagree in all that the integrator decides, and it drops what is nearer than a unit. What it does not
    see beside splats, a capture does, and warns of nothing."""
    near, far = (rounded(make_splats([[0, 0, z]], 5.0, 0.99)) for z in (0.5, BEFORE))
    write_ply(tmp_path / "model.ply", near, comments=comments_of(Drawing(antialiased=True, near_clip=0.1, linear=True)))
    write_ply(tmp_path / "far.ply", far, comments=comments_of(Drawing(antialiased=False, near_clip=0.2, linear=False)))
    decided = '<float name="near_clip" value="1"/>' + "".join(
        f'<boolean name="{name}" value="false"/>' for name in ("antialiased", "srgb_primitives")
    )
    scene = SCENE.format(f'<integrator type="dogpath">{decided}</integrator>')
    shape = '<shape type="dog"><string name="filename" value="far.ply"/></shape>'
    (tmp_path / "scene.xml").write_text(scene.replace("</scene>", f"{shape}</scene>"))
    camera = {"w2c": np.eye(4).tolist(), "fx": 40, "width": 8, "height": 6}
    (tmp_path / "cameras.json").write_text(json.dumps([camera]))
    settings = CaptureConfig(path=str(tmp_path / "cameras.json"), depth="npy", spp=1, points=10)
    depth = np.load(capture(tmp_path / "scene.xml", tmp_path / "out", settings) / "depth" / "000.npy")
    np.testing.assert_allclose(depth, BEFORE, rtol=1e-6)
    assert "not seen" not in "".join(capfd.readouterr())


def test_splats_through_which_all_can_be_seen_are_no_place_to_start_from(tmp_path):
    write_ply(tmp_path / "model.ply", rounded(make_splats([[0, 0, 0], [0.5, 0, 0]], 0.2, 0.3)))
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><integrator type="dogsplat"/><shape type="dog"><string name="filename" '
        'value="model.ply"/></shape></scene>'
    )
    assert "no camera sees anything opaque; " in error_of(tmp_path / "scene.xml", tmp_path / "out", tiny(spp=1))
