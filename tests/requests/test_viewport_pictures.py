"""Pictures for viewports."""

import io
import json
import threading
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.requests import headlight
from mi_dogsplat.requests import views as views_module
from mi_dogsplat.requests.serve import Lines, serve
from mi_dogsplat.requests.shares import Shares, importance
from mi_dogsplat.requests.view_request import read_view_request
from mi_dogsplat.requests.views import Views
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import displayed, srgb_to_linear
from scene_requests import camera_json
from splat_scenes import random_splats, rounded, square_camera

WIDTH, HEIGHT = 24, 16
SPLATS = rounded(random_splats(40, seed=1))
CAMERA = square_camera(WIDTH, HEIGHT, 22.0)
WALL_DEPTH = 30.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A model, a white wall behind it under a sky, and the wall without a sky."""
    folder = tmp_path_factory.mktemp("views")
    write_ply(folder / "model.ply", SPLATS)
    wall = np.linalg.inv(CAMERA.w2c) @ np.diag([-10.0, 4.0, -1.0, 1.0])
    wall[:3, 3] += WALL_DEPTH * CAMERA.w2c[2, :3]
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1, 1, 1]}}
    shapes = {"object_1_wall": {"type": "rectangle", "to_world": {"matrix": wall.tolist()}, "bsdf": white}}
    (folder / "dark.json").write_text(json.dumps(shapes))
    (folder / "scene.json").write_text(json.dumps({**shapes, "sky": {"type": "constant", "radiance": 0.25}}))
    return folder


@pytest.fixture(scope="module")
def views():
    return Views()


def last(views, request):
    (*_, (share, picture)) = views.frames(read_view_request(request))
    assert share == 1 and picture.dtype == np.float32
    return picture


def test_splats_alone_are_those_of_the_final_picture(folder, views):
    request = {"model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    expected = render_picture(upload(SPLATS), CAMERA, RasterOptions(sh_degree=SPLATS.sh_degree))
    color, alpha = expected.color, expected.alpha[..., None]
    np.testing.assert_allclose(last(views, request), np.concatenate([color, alpha], -1), atol=1e-5)
    behind = [0.2, 0.4, 0.6]
    found = last(views, {**request, "background": behind, "linear": True})
    np.testing.assert_allclose(found[..., :3], srgb_to_linear(color + (1 - alpha) * behind), atol=1e-5)
    assert (found[..., 3] == 1).all()
    found, share = last(views, {**request, "linear": True}), np.maximum(alpha, 1e-6)
    np.testing.assert_allclose(found[..., :3], share * srgb_to_linear(np.minimum(color / share, 1)), atol=1e-5)


def test_a_share_is_that_of_the_most_important(folder, views):
    """Of 40 primitives a quarter."""
    request = {"model": str(folder / "model.ply"), "camera": camera_json(CAMERA), "share": 0.25}
    chosen = SPLATS.select(np.sort(np.argsort(-importance(SPLATS))[:10]))
    expected = render_picture(upload(chosen), CAMERA, RasterOptions(sh_degree=SPLATS.sh_degree))
    np.testing.assert_allclose(last(views, request)[..., :3], expected.color, atol=1e-5)
    smallest, scales = {**request, "share": 1e-9}, np.sort(np.exp(SPLATS.log_scales), axis=1)
    opacities = 1 / (1 + np.exp(-SPLATS.logit_opacities))
    first = SPLATS.select([np.argmax(opacities * scales[:, 1] * scales[:, 2])])
    expected = render_picture(upload(first), CAMERA, RasterOptions(sh_degree=SPLATS.sh_degree))
    np.testing.assert_allclose(last(views, smallest)[..., :3], expected.color, atol=1e-5)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("scene", [False, True])
def test_a_part_looks_as_in_the_whole_picture(folder, views, scene, orthographic):
    """Splats, and the edges of what is around them."""
    focal, (left, top, right, bottom) = 3.0 if orthographic else 22.0, (9, 5, 20, 12)
    camera = Camera(CAMERA.w2c, focal, focal, 11.0, 9.5, WIDTH, HEIGHT)
    part = Camera(CAMERA.w2c, focal, focal, 11.0 - left, 9.5 - top, right - left, bottom - top)
    request = {"model": str(folder / "model.ply"), "orthographic": orthographic, "samples": 0}
    if scene:
        request |= {"scene": str(folder / "scene.json"), "near_clip": 0.2}
    whole = last(views, {**request, "camera": camera_json(camera)})[top:bottom, left:right]
    film = [-left, -top, WIDTH - left, HEIGHT - top]
    found = last(views, {**request, "camera": camera_json(part), "film": film})
    np.testing.assert_allclose(found, whole, atol=1e-4)
    assert orthographic or np.abs(last(views, {**request, "camera": camera_json(part)}) - whole).max() > 0.01


@pytest.mark.parametrize("samples", [None, 0, 1])
def test_a_picture_looks_as_it_is_though_more_is_seen(folder, views, samples):
    """Of a viewport whose camera's picture is smaller; samples of a scene without light, None: of splats alone."""
    request, (left, top, right, bottom) = {"model": str(folder / "model.ply")}, (9, 5, 20, 12)
    if samples is not None:
        request |= {"scene": str(folder / "dark.json"), "near_clip": 0.2, "samples": samples}
    camera = Camera(CAMERA.w2c, 22.0, 22.0, 11.0, 9.5, WIDTH, HEIGHT)
    part = Camera(CAMERA.w2c, 22.0, 22.0, 11.0 - left, 9.5 - top, right - left, bottom - top)
    expected = last(views, {**request, "camera": camera_json(part)})
    found = last(views, {**request, "camera": camera_json(camera), "film": [left, top, right, bottom]})
    np.testing.assert_allclose(found[top:bottom, left:right], expected, atol=1e-4)


def test_parallel_rays(folder, views):
    camera = Camera(CAMERA.w2c, 3.0, 3.0, 11.0, 9.5, WIDTH, HEIGHT)
    request = {"model": str(folder / "model.ply"), "camera": camera_json(camera), "orthographic": True}
    seen = DeviceCamera.upload(camera, perspective=False)
    frame = rasterize(upload(SPLATS), seen, RasterOptions(sh_degree=SPLATS.sh_degree))
    expected = np.stack([np.clip(c.numpy(), 0, 1) for c in frame.colors], -1).reshape(HEIGHT, WIDTH, 3)
    assert expected.max() > 0.1
    np.testing.assert_allclose(last(views, request)[..., :3], expected, atol=1e-5)


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_quick_picture_of_a_scene_has_its_edges_where_its_paths_have(folder, views, orthographic):
    """A wall under a sky, seen by a camera whose principal point is off the middle."""
    focal = 0.5 if orthographic else 22.0
    camera = Camera(CAMERA.w2c, focal, focal, 9.0, 10.0, WIDTH, HEIGHT)
    request = {"scene": str(folder / "scene.json"), "camera": camera_json(camera), "orthographic": orthographic}
    quick = last(views, {**request, "samples": 0, "transparent": True})[..., 3]
    slow = last(views, {**request, "samples": 16, "transparent": True})[..., 3]
    x, y = (np.array([-10, -4]) / (1 if orthographic else WALL_DEPTH) * focal + (9, 10)).round(3)
    assert 0 < x < WIDTH / 2 and 0 < y < HEIGHT
    expected = np.zeros((HEIGHT, WIDTH))
    columns, rows = np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5
    right, bottom = 18 - x, 20 - y
    expected[(rows[:, None] > y) & (rows[:, None] < bottom) & (columns > x) & (columns < right)] = 1
    np.testing.assert_array_equal(quick, expected)
    np.testing.assert_allclose(slow.sum(), (right - x) * (min(bottom, HEIGHT) - y), rtol=0.03)


def test_quick_pictures_are_of_the_active_variant_there_and_back(folder, views):
    """What was kept of the variant before is not taken for what the plugins are now."""
    if "llvm_ad_mono" not in mi.variants():
        pytest.skip("llvm_ad_mono is not built into this Mitsuba")
    variant = str(mi.variant())
    request = {"scene": str(folder / "scene.json"), "model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    color = last(views, {**request, "samples": 0})
    for name in ("llvm_ad_mono", variant):
        mi.set_variant(name)
        assert issubclass(headlight.Headlight, mi.SamplingIntegrator)  # mi.render takes no other
        assert issubclass(headlight.QuickIntegrator, mi.Integrator)
    for kept_or_new in (views, Views()):
        np.testing.assert_array_equal(last(kept_or_new, {**request, "samples": 0}), color)


@pytest.mark.parametrize("name", ["llvm_ad_mono", "llvm_ad_spectral"])
@pytest.mark.parametrize("samples", [0, 1])
def test_scenes_are_drawn_in_variants_of_rgb_and_others_say_so(folder, name, samples):
    """Models alone are drawn in those of luminance too."""
    if name not in mi.variants():
        pytest.skip(f"{name} is not built into this Mitsuba")
    variant, alone = str(mi.variant()), {"model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    color = last(Views(), alone)
    mi.set_variant(name)
    try:
        with pytest.raises(DataError) as caught:
            last(Views(), {"scene": str(folder / "scene.json"), "camera": camera_json(CAMERA), "samples": samples})
        if name == "llvm_ad_mono":
            np.testing.assert_allclose(last(Views(), alone), color, atol=1e-5)
    finally:
        mi.set_variant(variant)
    line, use = str(caught.value), "; use llvm_ad_rgb or cuda_ad_rgb"
    assert line.startswith(f"{folder / 'scene.json'}: ") and f" the variant {name}" in line and line.endswith(use)


def test_a_scene_without_a_sky_is_lit_while_it_moves(folder, views):
    request = {"scene": str(folder / "dark.json"), "model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    quick = last(views, {**request, "samples": 0})
    alone = last(views, {"model": str(folder / "model.ply"), "camera": camera_json(CAMERA)})
    row = np.s_[HEIGHT // 2, 6:18]  # of the wall
    wall = quick[row][alone[row][:, 3] == 0]
    assert len(wall) and wall[..., :3].min() > 0.5 and (wall[..., 3] == 1).all()
    covered = alone[..., 3] > 0.95
    np.testing.assert_allclose(quick[covered][:, :3], srgb_to_linear(alone[covered][:, :3]), atol=0.12)


def test_paths_are_added_until_somebody_asks_for_something_else(folder, views, monkeypatch):
    monkeypatch.setattr(views_module, "BAND_PIXELS", 5 * WIDTH)  # bands of 5 rows, the last from row 11
    request = read_view_request({"scene": str(folder / "scene.json"), "camera": camera_json(CAMERA), "samples": 6})
    steps = list(views.frames(request))
    assert [share for share, _ in steps] == pytest.approx([1 / 6, 3 / 6, 1])
    assert np.abs(steps[0][1] - steps[2][1]).max() > 0
    asked = iter([False] * 6 + [True])
    assert [share for share, _ in views.frames(request, lambda: next(asked))] == pytest.approx([1 / 6])


def test_bands_are_parts_of_one_picture(folder, views, monkeypatch):
    """Of one sample at the centre of each pixel, without a light."""
    request = {"scene": str(folder / "dark.json"), "model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    request |= {"samples": 1, "max_depth": 1}
    whole = last(views, request)
    monkeypatch.setattr(views_module, "BAND_PIXELS", 5 * WIDTH)
    assert whole[..., :3].max() > 0.1
    np.testing.assert_allclose(last(views, request), whole, atol=1e-4)


def test_a_whole_picture_is_denoised_when_its_samples_are_there(folder, views, monkeypatch):
    """And not band by band, or there would be seams; unless another one is wanted by then."""
    request = {"scene": str(folder / "scene.json"), "camera": camera_json(CAMERA), "samples": 4, "denoise": True}
    monkeypatch.setattr(views_module, "BAND_PIXELS", 5 * WIDTH)  # four bands
    *before, (share, clean) = views.frames(read_view_request(request))
    assert share == 1 and [round(part, 3) for part, _ in before] == [round(done / 7, 3) for done in (1, 4)]
    plain = before[-1][1]
    np.testing.assert_array_equal(clean[..., 3], plain[..., 3])
    assert np.abs(clean - plain)[..., :3].max() > 1e-3
    looks = []

    def interrupted():
        looks.append(True)
        return len(looks) > 8  # while it is denoised

    *_, (share, _) = views.frames(read_view_request(request), interrupted)
    assert share < 1


def told(lines):
    said = []
    serve(lines, said.append)
    return said


def test_a_stream_of_frames_is_files_without_a_format(folder):
    out = folder / "frame.rgba"
    request = {"out": str(out), "model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    (said,) = told(io.StringIO(json.dumps(request)))
    pixels = np.fromfile(said["done"], np.float32).reshape(HEIGHT, WIDTH, 4)
    np.testing.assert_array_equal(pixels, last(Views(), {name: request[name] for name in ("model", "camera")}))


def test_a_picture_is_left_when_another_line_comes(folder):
    """A line that stops gets no answer."""
    scene = {"out": str(folder / "left.rgba"), "scene": str(folder / "scene.json"), "camera": camera_json(CAMERA)}
    lines = [{**scene, "samples": 1000}, {"stop": True}, {**scene, "samples": 4}]
    read = threading.Event()

    def stream():
        yield from (f"{json.dumps(line)}\n" for line in lines)
        read.set()

    waiting = Lines(stream())
    assert read.wait(10)
    said = told(waiting)
    assert [next(iter(line)) for line in said] == ["left", "share", "done"]
    assert not waiting.another()


def test_a_model_that_has_changed_is_read_again(folder, views, tmp_path):
    path = tmp_path / "model.ply"
    write_ply(path, SPLATS)
    request = {"model": str(path), "camera": camera_json(CAMERA)}
    before = last(views, request)
    write_ply(path, SPLATS.select(np.arange(20)))
    assert np.abs(last(views, request) - before).max() > 0.01


def test_a_scene_whose_mesh_has_changed_is_read_again_and_no_other(views, tmp_path, monkeypatch):
    def write(size: float) -> None:
        cube: Any = mi.load_dict({"type": "cube", "to_world": mi.ScalarTransform4f().scale(size)})
        cube.write_ply(str(tmp_path / "m.ply"))

    def covered() -> float:
        camera = camera_json(Camera(affine(np.eye(3), (0, 0, 4)), 20, 20, 8, 6, 16, 12))
        request = {"scene": str(tmp_path / "s.json"), "camera": camera, "samples": 0, "transparent": True}
        return float(last(views, request)[..., 3].sum())

    scene = {"object_0": {"type": "ply", "filename": "m.ply"}, "sky": {"type": "constant"}}
    (tmp_path / "s.json").write_text(json.dumps(scene))
    write(0.5)
    small = covered()
    with monkeypatch.context() as patch:
        patch.setattr(views_module, "load_scene", None)  # it is kept
        assert covered() == small
    write(1.2)
    assert covered() > 2 * small
    (tmp_path / "m.ply").unlink()
    with pytest.raises(DataError, match="s.json: .*m.ply"):
        covered()


def test_a_kept_scene_learns_that_its_surfaces_cast_shadows(folder, views):
    request = {"model": str(folder / "model.ply"), "scene": str(folder / "scene.json"), "camera": camera_json(CAMERA)}
    request["samples"] = 2
    without, shaded = last(views, request), last(views, {**request, "mesh_shadows": True})
    np.testing.assert_allclose(shaded, last(Views(), {**request, "mesh_shadows": True}), atol=1e-5)
    assert np.abs(shaded - without).max() > 2e-3


@pytest.mark.parametrize(
    "wrong, problem",
    [
        ({"camera": None}, "camera"), ({"model": None}, "scene"), ({"share": 0}, "share"),
        ({"passes": ["depth"]}, "passes"), ({"clip": [2, 1]}, "clip"),
        ({"samples": -1}, "samples"), ({"model": "none.ply"}, "none.ply"),
        ({"background": [1, "a", 1]}, "three numbers"), ({"tilt": 1}, "tilt"),
    ],
)  # fmt: skip
def test_a_wrong_request_is_one_line(folder, wrong, problem):
    request = {"model": str(folder / "model.ply"), "camera": camera_json(CAMERA), **wrong}
    with pytest.raises(DataError, match=problem) as caught:
        list(Views().frames(read_view_request(request)))
    assert "\n" not in str(caught.value) and "; " in str(caught.value)


def test_a_linear_model_is_radiance_or_what_a_screen_shows_of_it(folder, views, tmp_path):
    path = tmp_path / "linear.ply"
    write_model(path, Model(brightened(SPLATS, 3.0), Drawing(linear=True, white=2.0)))
    request = {"model": str(path), "camera": camera_json(CAMERA)}
    splats, behind = read_model(path).splats, [0.5, 1.0, 2.0]
    drawn = DrawnAs(linear=True, white=2.0)
    picture = render_picture(upload(splats), CAMERA, RasterOptions(sh_degree=SPLATS.sh_degree), drawn=drawn)
    assert picture.radiance is not None and picture.radiance.max() > 1.2
    over = np.maximum(picture.radiance, 0) + (1 - picture.alpha[..., None]) * behind
    radiance = last(views, {**request, "linear": True, "background": behind})
    np.testing.assert_allclose(radiance[..., :3], over, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(last(views, {**request, "background": behind})[..., :3], displayed(over, 2.0), atol=1e-4)


def test_a_share_is_of_the_most_important_and_of_one_at_least_where_there_are_any(folder, tmp_path):
    shares, first = Shares(folder / "model.ply"), np.argsort(-importance(SPLATS), kind="stable")
    for share, count in ((1e-6, 1), (0.25, 10), (0.99, 40)):
        chosen = shares.chosen(share)
        expected = None if count == SPLATS.n_splats else sorted(first[:count])
        assert (chosen if chosen is None else chosen.tolist()) == expected
        assert shares.part(share)["means"].shape == (3 * count,)
    write_ply(tmp_path / "empty.ply", Splats.empty(0))
    assert Shares(tmp_path / "empty.ply").chosen(0.5) is None
