"""A capture of a Mitsuba scene is an exact data set: the reader takes it, its parts fit, and it can be resumed."""

import json
import shutil
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from captured_scenes import BALLS, RADIUS, error_of, tiny, write_scene
from mi_dogsplat.datasets import capture as module
from mi_dogsplat.datasets import check_cameras, load_dataset
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.locks import locked
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer
from PIL import Image

DEMO = Path(__file__).parents[2] / "scenes" / "demo_truth.xml"


@pytest.fixture(scope="module")
def balls(tmp_path_factory) -> Path:
    return write_scene(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def captured(balls, tmp_path_factory) -> Path:
    return capture(balls, tmp_path_factory.mktemp("data") / "out", tiny())


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture
def rendered(monkeypatch) -> list[str]:
    """Names of the views that are rendered from now on."""
    names = []
    render = module.render_shot
    monkeypatch.setattr(module, "render_shot", lambda *a: names.append(a[2].name) or render(*a))
    return names


# --- the data set ---


def test_the_reader_takes_a_capture_and_keeps_its_split(captured):
    dataset = load_dataset(captured)
    assert [view.name for view in dataset.test] == ["001"]
    assert [view.name for view in dataset.train] == ["000", "002"]
    assert dataset.train[0].image.shape == (24, 32, 3) and not dataset.has_alpha
    assert len(dataset.points) == 200


def test_the_split_and_the_lens_are_where_nerfstudio_looks_for_them(captured):
    content = json.loads((captured / "transforms.json").read_text())
    assert content["train_filenames"] == ["images/000.png", "images/002.png"]
    assert content["val_filenames"] == content["test_filenames"] == ["images/001.png"]
    assert content["camera_model"] == "PINHOLE" and (content["w"], content["h"], content["cx"]) == (32, 24, 16)
    assert content["ply_file_path"] == "points.ply" and content["fl_x"] == content["fl_y"]


@pytest.mark.parametrize("up", ["x", "y", "z", "-y"])
def test_points_project_onto_their_own_colour(balls, tmp_path, up):
    dataset = load_dataset(capture(balls, tmp_path / "out", tiny(size=(64, 48), up=up)))
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
    np.testing.assert_allclose(distances.min(axis=1), RADIUS, atol=2e-6)
    signs = np.sign(np.array(BALLS))[distances.argmin(axis=1)]  # [P, 3]
    bright = np.where(dataset.point_colors > 0.7, 1, -1)
    assert (bright == signs).mean() > 0.9  # not all: pixels at an outline mix two colours


def test_a_sky_of_which_each_view_has_its_own_part_does_not_make_the_poses_look_wrong(tmp_path):
    dome = """<shape type="sphere"><float name="radius" value="100"/><boolean name="flip_normals" value="true"/>
        <emitter type="area"/></shape>"""
    data = load_dataset(capture(write_scene(tmp_path, dome, light=""), tmp_path / "out", tiny(views=4)))
    assert check_cameras(data).seen == 1


def test_points_at_outlines_have_the_colour_of_what_is_there_not_of_its_coverage(balls, tmp_path):
    out = capture(balls, tmp_path / "out", tiny(alpha=True, points=1000, spp=16))
    dataset = load_dataset(out)
    best, covered = np.full(len(dataset.points), np.inf), np.zeros(len(dataset.points))
    for view in dataset.train:
        column, line = np.floor(view.camera.project(dataset.points)[0]).astype(int).T
        pixels = np.asarray(Image.open(out / "images" / f"{view.name}.png"))[line, column] / 255  # straight
        difference = np.abs(pixels[:, :3] - dataset.point_colors).max(axis=1)
        covered = np.where(difference < best, pixels[:, 3], covered)
        best = np.minimum(best, difference)
    assert best.max() < 1.5 / 255 and (covered < 0.9).sum() > 10


def test_each_view_and_each_seed_has_noise_of_its_own(tmp_path):
    w2c = module.circling_shots(tiny(), 1, np.zeros(3), 2.0, "z")[0].camera.w2c.tolist()
    (tmp_path / "cameras.json").write_text(json.dumps(2 * [{"w2c": w2c, "fx": 30, "width": 32, "height": 24}]))
    scene = write_scene(tmp_path)
    images = []
    for seed in (0, 1):
        config = CaptureConfig(path=str(tmp_path / "cameras.json"), seed=seed, spp=4, points=0)
        data = capture(scene, tmp_path / f"out{seed}", config)
        images += [(data / "images" / f"00{i}.png").read_bytes() for i in range(2)]
    assert len(set(images)) == 4


def test_the_largest_seed_is_one(balls, tmp_path):
    """That of Mitsuba has 32 bits, and each view has its own."""
    config = tiny(seed=2**31 - 1, points=0)
    images = contents(capture(balls, tmp_path / "out", config))
    assert len({data for name, data in images.items() if name.endswith(".png")}) == 3


def test_rays_pass_masks_borders_of_media_and_hidden_lamps_to_the_surface(tmp_path):
    ball = '<shape type="sphere"><float name="radius" value="{}"/><bsdf type="{}">{}</bsdf>{}</shape>'
    mask = ball.format(3, "mask", '<float name="opacity" value="0.2"/><bsdf type="diffuse"/>', "")
    null = ball.format(2.5, "null", "", "")
    lamp = ball.format(2.8, "diffuse", "", '<emitter type="area"/>')
    scene = write_scene(tmp_path, mask, null, lamp)
    config = tiny(center=(0, 0, 0), radius=4.0, alpha=True, size=(64, 48))
    points = load_dataset(capture(scene, tmp_path / "out", config)).points
    distances = np.linalg.norm(points[:, None] - np.array(BALLS), axis=2).min(axis=1)
    np.testing.assert_allclose(distances, RADIUS, atol=2e-6)
    shown = load_dataset(capture(scene, tmp_path / "lit", tiny(center=(0, 0, 0), radius=4.0))).points
    np.testing.assert_allclose(np.linalg.norm(shown, axis=1), 2.8, atol=1e-5)  # lamps that are seen are surfaces


@pytest.mark.parametrize("form", ["npy", "exr"])
def test_depth_is_that_along_the_view_axis_and_zero_where_nothing_is(tmp_path, form):
    """A board across the view has one depth, where distances would grow towards the corners."""
    board = """<scene version="3.0.0"><integrator type="path"/><emitter type="constant"/><shape type="rectangle">
        <transform name="to_world"><lookat origin="0,0,0" target="1,2,3" up="0,0,1"/></transform></shape></scene>"""
    (tmp_path / "scene.xml").write_text(board)
    w2c = module.circling_shots(tiny(), 1, np.zeros(3), 1.0, "z")[0].camera.w2c.copy()
    toward = np.array([1.0, 2.0, 3.0]) / 14**0.5  # the board's front
    w2c[:3, :3] = np.stack([(-2 / 5**0.5, 1 / 5**0.5, 0), np.cross(-toward, (-2 / 5**0.5, 1 / 5**0.5, 0)), -toward])
    w2c[:3, 3] = (0, 0, 2.5)
    camera = {"w2c": w2c.tolist(), "fx": 20, "width": 32, "height": 24, "name": "front"}
    (tmp_path / "cameras.json").write_text(json.dumps([camera]))
    settings = CaptureConfig(path=str(tmp_path / "cameras.json"), depth=form, spp=1, points=50)
    out = capture(tmp_path / "scene.xml", tmp_path / "out", settings)
    frame = json.loads((out / "transforms.json").read_text())["frames"][0]
    file = str(out / frame["depth_file_path"])
    depth = np.load(file) if form == "npy" else OpenEXR.File(file).channels()["depth.Z"].pixels
    assert depth.dtype == np.float32 and depth.shape == (24, 32)
    np.testing.assert_allclose(depth[depth > 0], 2.5, rtol=1e-6)
    assert (depth > 0).mean() == pytest.approx(16 * 16 / (32 * 24), abs=0.08) and depth[0, 0] == 0


@pytest.mark.parametrize("hide", ["", '<boolean name="hide_emitters" value="true"/>'])
def test_alpha_is_the_coverage_of_the_shapes_whatever_the_scene_says_of_its_lamps(tmp_path, hide):
    integrator = f'<integrator type="path">{hide}</integrator>'
    config = tiny(size=(96, 72), spp=16, alpha=True)
    dataset = load_dataset(capture(write_scene(tmp_path, integrator=integrator), tmp_path / "out", config))
    assert dataset.has_alpha
    for view in dataset.views:
        rays = np.indices((96, 72)).reshape(2, -1).T + 0.5  # [n, 2] pixel centres
        local = np.concatenate([(rays - (48, 36)) / view.camera.fx, np.ones((len(rays), 1))], axis=1)
        directions = local @ view.camera.w2c[:3, :3]
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        offsets = np.array(BALLS) - view.camera.position  # [8, 3]
        along = directions @ offsets.T  # [n, 8]
        distance = np.sqrt((offsets**2).sum(1) - along**2).min(axis=1).reshape(96, 72).T  # [H, W] of ray and centre
        assert view.image[distance < RADIUS - 0.1][:, 3].min() == 1
        assert view.image[distance > RADIUS + 0.1][:, 3].max() == 0


@pytest.mark.parametrize(
    "integrator",
    [
        *(f'<integrator type="{kind}"/>' for kind in ("direct", "volpath", "volpathmis", "prb")),
        '<integrator type="aov"><string name="aovs" value="d:depth"/><integrator type="path" name="a"/></integrator>',
        '<integrator type="moment"><integrator type="path" name="a"/></integrator>',
    ],
)
def test_any_integrator_of_a_scene_renders_it(balls, captured, tmp_path, integrator):
    scene = write_scene(tmp_path, integrator=integrator)
    config = tiny(spp=64)
    pairs = zip(
        load_dataset(capture(scene, tmp_path / "a", config)).views,
        load_dataset(capture(balls, tmp_path / "b", config)).views,
        strict=True,
    )
    for view, path_traced in pairs:
        assert view.image.shape == (24, 32, 3)
        assert np.abs(view.image - path_traced.image).mean() < 0.03  # noise, and light that direct leaves out
    config = tiny(spp=4, alpha=True)
    assert load_dataset(capture(scene, tmp_path / "c", config)).has_alpha


def test_a_particle_tracer_renders_a_scene_too_but_its_alpha_is_no_coverage(tmp_path):
    light = '<emitter type="constant"><float name="radiance" value="0.3"/></emitter>'  # noise around it is not clipped
    pictures = []
    for kind in ("path", "ptracer"):
        scene = write_scene(tmp_path, integrator=f'<integrator type="{kind}"/>', light=light)
        dataset = load_dataset(capture(scene, tmp_path / kind, tiny(spp=1024)), downscale=8)
        pictures.append([view.image for view in dataset.views])
    np.testing.assert_allclose(pictures[0], pictures[1], atol=0.05)
    assert "view 000 has no coverage as alpha" in error_of(scene, tmp_path / "alpha", tiny(alpha=True))


def test_training_starts_from_the_points_and_uses_alpha(balls, tmp_path):
    data = capture(balls, tmp_path / "out", tiny(alpha=True))
    trainer = Trainer(TrainConfig(str(data), steps=2, sh_degree=0), load_dataset(data))
    assert trainer.optimizer.n == 200 and trainer.background == 1
    means = trainer.optimizer.to_splats().means
    distances = np.linalg.norm(means[:, None] - np.array(BALLS), axis=2).min(axis=1)
    np.testing.assert_allclose(distances, RADIUS, atol=2e-6)


def test_many_samples_are_split_into_passes_with_the_same_mean(balls, captured, tmp_path, monkeypatch):
    config = tiny(spp=64)
    whole = load_dataset(capture(balls, tmp_path / "a", config)).train[0].image
    monkeypatch.setattr("mi_dogsplat.datasets.traced_view.PASS_SAMPLES", 32 * 24 * 16)
    passes = load_dataset(capture(balls, tmp_path / "b", config)).train[0].image
    assert 0 < np.abs(whole - passes).mean() < 0.01
    assert abs((whole - passes).mean()) < 0.001


def test_the_demo_scene_can_be_captured_and_its_cameras_see_all_of_it(tmp_path):
    dataset = load_dataset(capture(DEMO, tmp_path / "out", tiny()))
    check = check_cameras(dataset)
    assert check.seen == 1 and check.inside == 1
    assert np.ptp(dataset.points, axis=0).max() < 3.5  # the table, not the lamp far away


# --- resume ---


def test_a_capture_repeats_itself_bit_by_bit(balls, captured, tmp_path):
    again = contents(capture(balls, tmp_path / "out", tiny()))
    assert again == contents(captured) and len(again) == 6


def test_ctrl_c_loses_the_view_under_way_and_the_same_command_goes_on(balls, captured, tmp_path, monkeypatch, rendered):
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        stopped = module.render_shot

        def stop(*arguments):
            if arguments[2].name == "002":
                raise KeyboardInterrupt
            return stopped(*arguments)

        patch.setattr(module, "render_shot", stop)
        with pytest.raises(KeyboardInterrupt):
            capture(balls, out, tiny())
    assert set(contents(out)) == {"capture.json", "images/000.png", "images/001.png"}
    with pytest.raises(DataError, match="not a known data set"):
        load_dataset(out)
    rendered.clear()
    capture(balls, out, tiny())
    assert rendered == ["002"] and contents(out) == contents(captured)


def test_what_is_complete_is_not_rendered_again_and_what_is_lost_or_cut_is(balls, captured, tmp_path, rendered):
    out = capture(balls, tmp_path / "out", tiny())
    rendered.clear()
    capture(balls, out, tiny())
    assert rendered == []
    (out / "images" / "000.png").write_bytes(b"")
    (out / "images" / "002.png").write_bytes((out / "images" / "002.png").read_bytes()[:-30])
    (out / "images" / "001.png").unlink()
    capture(balls, out, tiny())
    assert rendered == ["000", "001", "002"] and contents(out) == contents(captured)


def test_depth_that_is_lost_is_made_again(balls, tmp_path):
    out = capture(balls, tmp_path / "out", tiny(depth="npy"))
    before = contents(out)
    (out / "depth" / "001.npy").unlink()
    capture(balls, out, tiny(depth="npy"))
    assert contents(out) == before


def test_only_the_points_may_change_in_a_folder(balls, tmp_path, rendered):
    out = capture(balls, tmp_path / "out", tiny())
    before = (out / "images" / "000.png").read_bytes()
    message = error_of(balls, out, tiny(spp=9))
    assert message.startswith(f"{out}: spp was 4 and is 9 now;")
    assert "size was [32, 24] and is [24, 32] now" in error_of(balls, out, tiny(size=(24, 32)))
    rendered.clear()
    assert len(load_dataset(capture(balls, out, tiny(points=150))).points) == 150
    assert len(load_dataset(capture(balls, out, tiny(points=0))).points) == 0 and not (out / "points.ply").exists()
    assert rendered == [] and (out / "images" / "000.png").read_bytes() == before


def test_pictures_of_radiance_and_of_a_screen_are_two_captures(balls, tmp_path):
    for began, name in ((True, "a"), (False, "b")):
        out = capture(balls, tmp_path / name, tiny(hdr=began, points=0))
        before = contents(out)
        assert f"{out}: hdr was {began} and is {not began} now;" in error_of(balls, out, tiny(hdr=not began, points=0))
        assert contents(out) == before


def test_a_capture_of_a_version_that_knew_no_radiance_can_be_gone_on_with(balls, captured, tmp_path, rendered):
    shutil.copytree(captured, out := tmp_path / "out")
    noted = json.loads((out / "capture.json").read_text())
    del noted["hdr"]
    (out / "capture.json").write_text(json.dumps(noted))
    assert "hdr was False and is True now" in error_of(balls, out, tiny(hdr=True))
    assert contents(capture(balls, out, tiny())) == contents(captured) and rendered == []


@pytest.mark.parametrize("name", ["cameras.json", "CAMERAS.JSON"])
def test_a_scene_or_list_of_cameras_that_has_changed_is_not_mixed_with_the_older_one(tmp_path, name):
    scene = write_scene(tmp_path)
    camera = {"w2c": np.eye(4).tolist(), "fx": 20, "width": 8, "height": 6}
    camera["w2c"][2][3] = 5.0
    cameras = tmp_path / name
    cameras.write_text(json.dumps([camera, camera]))
    config = CaptureConfig(path=str(cameras), spp=1, points=10)
    capture(scene, tmp_path / "out", config)
    cameras.write_text(json.dumps([camera]))
    assert "the file of the cameras has changed" in error_of(scene, tmp_path / "out", config)
    cameras.write_text(json.dumps([camera, camera]))
    scene.write_text(scene.read_text().replace("0.9", "0.8"))
    assert "the file of the scene has changed" in error_of(scene, tmp_path / "out", config)


def test_a_scene_of_which_an_included_file_has_changed_is_another(tmp_path):
    scene, included = write_scene(tmp_path, '<include filename="more.xml"/>'), tmp_path / "more.xml"
    included.write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    config = tiny(views=1, test=0, size=(8, 6), spp=1, points=0)
    capture(scene, tmp_path / "out", config)
    included.write_text('<scene version="3.0.0"><shape type="cube"/></scene>')
    assert "the file of the scene has changed" in error_of(scene, tmp_path / "out", config)


def test_a_scene_of_which_a_texture_or_mesh_has_changed_is_another(tmp_path):
    (tmp_path / "more" / "textures").mkdir(parents=True)
    image, mesh = tmp_path / "more" / "textures" / "a.png", tmp_path / "mesh.obj"
    Image.new("RGB", (2, 2), (200, 100, 50)).save(image)
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    texture = '<texture type="bitmap" name="reflectance"><string name="filename" value="textures/a.png"/></texture>'
    shape = f'<shape type="obj"><string name="filename" value="mesh.obj"/><bsdf type="diffuse">{texture}</bsdf></shape>'
    scene, config = write_scene(tmp_path, '<path value="more"/>', shape), tiny(views=1, test=0, size=(8, 6), points=0)
    capture(scene, tmp_path / "out", config)
    capture(scene, tmp_path / "out", config)
    mesh.write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n")
    assert "the file mesh.obj has changed since it was begun" in error_of(scene, tmp_path / "out", config)
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    Image.new("RGB", (2, 2), (200, 100, 60)).save(image)
    assert "the file textures/a.png has changed since it was begun" in error_of(scene, tmp_path / "out", config)


def test_what_a_kill_left_is_removed_and_one_capture_at_a_time_writes(balls, captured, tmp_path):
    shutil.copytree(captured, out := tmp_path / "out")
    (out / "images" / ".002.png.0123456789ab.part").write_bytes(b"half a picture")
    with locked(out, "another"):
        assert "another capture is writing to it" in error_of(balls, out, tiny())
    assert contents(capture(balls, out, tiny())) == contents(captured)


def test_a_folder_with_other_contents_is_left_alone(balls, tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    assert "other contents" in error_of(balls, tmp_path, tiny())
    assert "is a file" in error_of(balls, tmp_path / "thesis.tex", tiny())
    (tmp_path / "capture.json").write_text("[1")
    assert "capture.json: not valid JSON" in error_of(balls, tmp_path, tiny())
    assert set(contents(tmp_path)) == {"thesis.tex", "capture.json"}
