"""The viewer without a browser: poses to pictures, when they are due, and where the model comes from."""

import math
import os

import numpy as np
import pytest
import tiny_data
from cut_models import with_cuts, with_second_cuts
from mi_dogsplat import Model, write_model, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import over_background, render_picture
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.runs.checkpoint import save_checkpoint
from mi_dogsplat.runs.run import CHECKPOINT, train
from mi_dogsplat.scene.appearance import Appearance, device_of, photographed, radii_squared
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.files import write_json
from mi_dogsplat.support.pictures import heat_map
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer
from mi_dogsplat.viewer import server
from mi_dogsplat.viewer.renderer import Renderer, fitted, nearest_view
from mi_dogsplat.viewer.source import Source, splats_of_state
from mi_dogsplat.viewer.view_state import (
    CUT_DIFFERENCE,
    DOG_DIFFERENCE,
    ERROR,
    MODEL,
    ONLY_DOG,
    ONLY_GAUSSIANS,
    PHOTOGRAPH,
    REST_SECONDS,
    SHIFT_DIFFERENCE,
    WITHOUT_CUTS,
    WITHOUT_DOG,
    WITHOUT_SHIFTS,
    Pace,
    Pose,
    Settings,
)
from scipy.spatial.transform import Rotation
from shifted_models import with_shifts
from sloped_models import with_curvatures, with_slopes

SMALL = Settings(height=48, gain=1.0)
NEAR = DrawnAs(near_clip=0.05)
CUTS, SHIFTS = [WITHOUT_CUTS, CUT_DIFFERENCE], [WITHOUT_SHIFTS, SHIFT_DIFFERENCE]


def pose_of(camera) -> Pose:
    x, y, z, w = Rotation.from_matrix(camera.c2w[:3, :3]).as_quat()
    fov = 2 * math.atan(camera.height / 2 / camera.fy)
    return Pose((w, x, y, z), tuple(camera.position), fov, camera.width / camera.height)


def test_a_window_that_is_pulled_flat_asks_for_no_larger_picture_and_one_without_area_for_any():
    front = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0
    sizes = [(c.width, c.height) for a in (1.5, 8, 200, np.inf, np.nan) for c in (Pose(*front, a).camera(600),)]
    assert sizes == [(900, 600), (4800, 600), (4800, 24), (600, 600), (600, 600)]
    flat = Pose(*front, 200).camera(600)
    assert flat.fy == pytest.approx(0.5 * 24 / math.tan(0.5)) and flat.fx == flat.fy  # it sees as much of the height


@pytest.fixture(scope="module")
def dataset(data):
    return load_dataset(data)


def uint8(image: np.ndarray) -> np.ndarray:
    return np.round(np.clip(image, 0, 1) * 255).astype(int)


# --- poses and pictures ---


def test_the_pose_of_a_camera_gives_that_camera_back_at_any_size():
    camera = tiny_data.cameras()[1]
    again = pose_of(camera).camera(3 * camera.height)
    assert again.w2c == pytest.approx(camera.w2c) and (again.width, again.height) == (144, 108)
    assert again.fx == pytest.approx(3 * camera.fx) and again.cx == pytest.approx(3 * camera.cx)


def test_a_picture_is_what_the_rasterizer_draws_and_smaller_while_moving():
    model, camera = tiny_data.dog_model(), tiny_data.cameras()[2]
    renderer = Renderer(model, NEAR)
    drawn = renderer.draw(pose_of(camera), Settings(height=camera.height, background=0.5))
    expected = render_picture(upload(model), camera, RasterOptions(1), 0.5, NEAR).color
    assert drawn.image.dtype == np.uint8 and np.abs(uint8(expected) - drawn.image).max() <= 1
    small = renderer.draw(pose_of(camera), Settings(height=300), moving=True).image
    assert small.shape == (120, 160, 3)


def test_each_choice_draws_its_part_of_the_model():
    model, camera = tiny_data.dog_model(), tiny_data.cameras()[0]
    renderer, pose = Renderer(model, NEAR), pose_of(camera)
    picture = {show: renderer.draw(pose, Settings(show, camera.height, gain=2.0)).image for show in renderer.choices}
    assert list(picture) == [MODEL, WITHOUT_DOG, ONLY_DOG, ONLY_GAUSSIANS, DOG_DIFFERENCE]
    parts = {MODEL: model, WITHOUT_DOG: model.plain(), ONLY_DOG: model.only_dog()}
    parts[ONLY_GAUSSIANS] = model.only_gaussians()
    floats = {s: render_picture(upload(part), camera, RasterOptions(1), 0.0, NEAR).color for s, part in parts.items()}
    for show, expected in floats.items():
        assert np.abs(uint8(expected) - picture[show]).max() <= 1, show
    difference = np.abs(floats[MODEL] - floats[WITHOUT_DOG]).mean(axis=-1)
    assert np.abs(uint8(heat_map(np.clip(2 * difference, 0, 1))) - picture[DOG_DIFFERENCE]).max() <= 2


@pytest.mark.parametrize(
    ("changed", "bare", "choices"),
    [
        (with_slopes, Splats.without_slopes, ["slopes switched off", "slopes on and off: difference"]),
        (
            with_curvatures,
            Splats.without_slopes,
            ["curvatures switched off", "curvatures on and off: difference"],
        ),
        (
            lambda splats, every: with_curvatures(with_slopes(splats, every), 2),
            Splats.without_slopes,
            ["slopes and curvatures switched off", "slopes and curvatures on and off: difference"],
        ),
        (with_cuts, Splats.without_cuts, CUTS),
        (with_second_cuts, Splats.without_cuts, CUTS),
        (lambda splats, every: with_second_cuts(with_cuts(splats, every)), Splats.without_cuts, CUTS),
        (with_shifts, Splats.without_shifts, SHIFTS),
    ],
    ids=["slopes", "curvatures", "slopes and curvatures", "cuts", "second_cuts", "both cuts", "shifts"],
)
def test_slopes_and_cuts_can_be_switched_off_and_their_difference_shown(changed, bare, choices):
    model, camera = changed(tiny_data.dog_model(), every=3), tiny_data.cameras()[0]
    renderer, pose = Renderer(model, NEAR), pose_of(camera)
    assert renderer.choices == [MODEL, WITHOUT_DOG, ONLY_DOG, ONLY_GAUSSIANS, DOG_DIFFERENCE, *choices]
    with_them, without = (render_picture(upload(part), camera, RasterOptions(1), 0.0, NEAR).color
                          for part in (model, bare(model)))  # fmt: skip
    assert np.abs(uint8(without) - renderer.draw(pose, Settings(choices[0], camera.height)).image).max() <= 1
    drawn = renderer.draw(pose, Settings(choices[1], camera.height, gain=2.0))
    difference = np.abs(with_them - without).mean(axis=-1)
    assert np.abs(uint8(heat_map(np.clip(2 * difference, 0, 1))) - drawn.image).max() <= 2
    assert difference.mean() > 1e-3 and f"{difference.mean():.4f}" in drawn.about
    renderer.replace(model.plain(), NEAR)
    assert renderer.choices == [MODEL, *choices]


def test_the_sh_degree_is_limited():
    model, pose = tiny_data.truth(), pose_of(tiny_data.cameras()[0])
    renderer = Renderer(model, NEAR)
    full, flat = (renderer.draw(pose, Settings(height=36, sh_degree=degree)).image for degree in (3, 0))
    truth = render_picture(upload(model), tiny_data.cameras()[0], RasterOptions(0), 0.0, NEAR).color
    assert np.abs(uint8(truth) - flat).max() <= 1 and np.abs(full.astype(int) - flat).max() > 2


def test_the_error_is_that_at_the_nearest_photograph(dataset):
    wrong = tiny_data.truth()
    wrong.logit_opacities[:30] = -9
    renderer, view = Renderer(wrong, DrawnAs(), dataset.views), dataset.views[3]
    assert renderer.choices == [MODEL, ERROR, PHOTOGRAPH]
    moved = Pose(pose_of(view.camera).wxyz, tuple(view.camera.position + 0.02), 0.7, 48 / 36)
    drawn = renderer.draw(moved, Settings(ERROR, 36, gain=3.0))
    picture = render_picture(upload(wrong), view.camera, RasterOptions(1)).color
    error = np.abs(picture - over_background(view.image, 0.0)).mean(axis=-1)
    assert np.abs(uint8(heat_map(np.clip(3 * error, 0, 1))) - drawn.image).max() <= 2
    assert view.name in drawn.about and f"{error.mean():.4f}" in drawn.about
    photograph = renderer.draw(moved, Settings(PHOTOGRAPH, 36)).image
    assert np.abs(uint8(view.image) - photograph).max() <= 1


def test_the_error_is_that_of_the_model_as_its_cameras_took_it_where_a_run_has_learned_how(dataset, tmp_path):
    view, dark = dataset.views[3], np.array([-1.0, -1.2, -0.9])
    learned = Appearance([view.name], [device_of(view.camera)], dark[None], np.array([[-0.3, -0.2]]))
    learned.write(tmp_path / "appearance.json")
    write_ply(tmp_path / "point_cloud.ply", tiny_data.truth())
    source = Source(tmp_path)
    found = source.poll()
    assert found and source.appearance
    taken = photographed(view.image, radii_squared(view.camera), learned.numbers(view.camera, view.name))
    views = [View(view.name, view.camera, taken)]
    said = []
    for appearance in (source.appearance, None):
        drawn = Renderer(found[0], DrawnAs(), views, appearance).draw(pose_of(view.camera), Settings(ERROR, 36))
        said.append(float(drawn.about.split()[-1]))
    assert said[0] < 0.005 and said[1] > 0.05
    (tmp_path / "appearance.json").unlink()  # as a new training does
    os.utime(tmp_path / "point_cloud.ply", ns=(1, 1))
    assert source.poll() and source.appearance is None


def test_what_a_new_model_does_not_have_is_drawn_as_the_model():
    renderer, pose = Renderer(tiny_data.dog_model(), NEAR), pose_of(tiny_data.cameras()[0])
    with_dog = renderer.draw(pose, Settings(ONLY_DOG, 36)).image
    renderer.replace(tiny_data.truth(), NEAR)
    assert ONLY_DOG not in renderer.choices
    plain = renderer.draw(pose, Settings(ONLY_DOG, 36)).image
    assert np.array_equal(plain, renderer.draw(pose, Settings(MODEL, 36)).image) and not np.array_equal(plain, with_dog)


def test_the_nearest_view_looks_the_same_way(dataset):
    for view in dataset.views:
        assert nearest_view(dataset.views, view.camera) is view
    first = dataset.views[0]
    turned = pose_of(first.camera)
    back = Pose((0, *turned.wxyz[1:]), turned.position, 0.7, 1).camera(36)
    assert isinstance(nearest_view(dataset.views, back).name, str)


def test_a_picture_is_fitted_whole_with_bars():
    image = np.random.default_rng(0).uniform(0.1, 1, (6, 4, 3))
    wide = fitted(image, 16, 12)
    assert wide.shape == (12, 16, 3) and not wide[:, :4].any() and not wide[:, 12:].any()
    assert np.array_equal(wide[::2, 4:12:2], image)
    assert np.array_equal(fitted(image, 4, 6), image)
    tall = fitted(image, 4, 20)
    assert not tall[:7].any() and np.array_equal(tall[7:13], image)


# --- when ---


def test_a_moving_camera_gets_a_small_picture_at_once_and_a_full_one_when_it_rests():
    pace = Pace()
    assert pace.due(0.0) is None
    pace.moved(1.0)
    assert pace.due(1.0) == "small" and pace.due(1.01) is None
    pace.moved(1.1)
    pace.moved(1.2)
    assert pace.due(1.2) == "small" and pace.due(1.2 + 0.9 * REST_SECONDS) is None
    assert pace.due(1.2 + REST_SECONDS) == "full" and pace.due(9.0) is None


def test_a_change_of_settings_gives_the_full_picture_but_not_while_the_camera_moves():
    pace = Pace()
    pace.changed()
    assert pace.due(0.0) == "full" and pace.due(0.0) is None
    pace.moved(5.0)
    pace.changed()
    assert pace.due(5.0) == "small" and pace.due(5.1) is None and pace.due(5.0 + REST_SECONDS) == "full"


# --- from where ---


def test_a_file_is_read_again_when_it_changes_and_only_then(tmp_path):
    path = tmp_path / "model.ply"
    write_ply(path, tiny_data.truth())
    source = Source(path)
    found = source.poll()
    assert found and found[0].n_splats == tiny_data.N_TRUTH and found[1] == "model.ply" and source.poll() is None
    write_ply(path, tiny_data.truth().select(range(20)))
    found = source.poll()
    assert found and found[0].n_splats == 20 and source.poll() is None
    path.unlink()
    with pytest.raises(DataError, match="no such file"):
        source.poll()


def test_a_stage_is_read_again_when_a_layer_of_it_changes(tmp_path):
    """Of several files that make a model any one may change, and the first one stays as it is."""
    layer, path = tmp_path / "layer.usdc", tmp_path / "shot.usda"
    write_model(layer, Model(tiny_data.truth()))
    path.write_text('#usda 1.0\n(\n    subLayers = [@./layer.usdc@]\n)\n')
    source = Source(path)
    found = source.poll()
    assert found and found[0].n_splats == tiny_data.N_TRUTH and source.poll() is None
    write_model(layer, Model(tiny_data.truth().select(range(20))))
    found = source.poll()
    assert found and found[0].n_splats == 20 and source.poll() is None
    layer.unlink()
    with pytest.raises(DataError, match="shot.usda: .*cannot be found"):
        source.poll()


def test_the_model_of_a_checkpoint_is_that_of_the_trainer(dataset):
    config = TrainConfig("", steps=20, sh_degree=1, max_primitives=80, target=0.5)
    trainer = Trainer(config, dataset)
    for _ in range(20):
        trainer.step()
    ours, theirs = splats_of_state(trainer.state()), trainer.optimizer.to_splats()
    assert theirs.n_dog > 0
    for name in theirs.__dataclass_fields__:
        assert np.array_equal(getattr(ours, name), getattr(theirs, name)), name


def test_a_run_is_followed_from_checkpoint_to_checkpoint_to_its_model(dataset, tmp_path):
    config = TrainConfig(str(dataset.path), preset="3dgs", steps=8, sh_degree=1, max_primitives=70)
    run = tmp_path / "run"
    train(config, run)
    later = (run / "point_cloud.ply").stat().st_mtime_ns + 10**9
    source = Source(run)
    found = source.poll()
    assert found and found[1] == "point_cloud.ply" and source.config["steps"] == 8 and source.poll() is None
    trainer = Trainer(config, dataset)
    save_checkpoint(run / CHECKPOINT, trainer.state())
    os.utime(run / CHECKPOINT, ns=(later, later))
    found = source.poll()
    assert found and found[1] == "step 0 of 8" and found[0].n_splats == trainer.optimizer.n and source.poll() is None
    (run / "config.json").unlink()
    found = Source(run).poll()
    assert found and found[1] == "step 0"


def test_a_folder_without_a_model_says_what_to_wait_for(tmp_path):
    with pytest.raises(DataError, match="wait for its first checkpoint"):
        Source(tmp_path).poll()


@pytest.mark.parametrize("named", [False, True])
def test_photographs_beside_a_run_are_as_large_and_split_as_its_training_had_them(data, tmp_path, monkeypatch, named):
    shown = []

    class Shown:
        url = ""

        def __init__(self, source, dataset, *given):
            shown.append(dataset)

        def serve(self):
            pass

        stop = serve

    monkeypatch.setattr(server, "Server", Shown)
    write_json(tmp_path / "config.json", {"data": str(data), "downscale": 2, "split": "validation"})
    for options in (PictureOptions(), PictureOptions(downscale=1)):
        server.serve(tmp_path, data if named else None, options=options, show=lambda line: None)
    of_run = load_dataset(data, split="validation")
    assert {view.name for view in of_run.test} != {view.name for view in load_dataset(data).test}
    for found, width in zip(shown, (tiny_data.WIDTH // 2, tiny_data.WIDTH), strict=True):
        assert [view.name for view in found.test] == [view.name for view in of_run.test]
        assert {view.camera.width for view in found.views} == {width}
