"""Objects that the camera looks through, and holdouts: splats and surfaces, alone and in a scene."""

import json
from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.requests.shares import importance
from mi_dogsplat.requests.view_request import read_view_request
from mi_dogsplat.requests.views import Views
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import srgb_to_linear
from scene_requests import answered, camera_json, matrix
from splat_scenes import C0, random_splats, rounded, square_camera

WIDTH, HEIGHT = 24, 16
FOCAL = 22.0
SPLATS = rounded(random_splats(40, seed=1))
CAMERA = square_camera(WIDTH, HEIGHT, FOCAL)
COUNTS = [15, 25]
FIRST, SECOND = np.arange(15), np.arange(15, 40)
SKY, GLOW = 0.25, 0.5
LEFT, RIGHT = np.s_[:, : WIDTH // 2 - 1], np.s_[:, WIDTH // 2 + 1 :]


def at(depth, x=0.0, size=100.0, facing=1):
    """A square across the optical axis that looks at the camera, or away from it."""
    placed = np.linalg.inv(CAMERA.w2c)
    placed[:3, 3] += depth * placed[:3, 2] + x * placed[:3, 0]
    return matrix(placed @ np.diag([size, size * facing, -facing, 1]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A wall that glows behind all splats (object 2), in front of its left half a black one (object 3), under a sky."""
    folder = tmp_path_factory.mktemp("masks")
    write_ply(folder / "model.ply", SPLATS)
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0, 0, 0]}}
    c2w = np.linalg.inv(CAMERA.w2c) @ np.diag([-1.0, -1, 1, 1])
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    fov = np.degrees(2 * np.arctan(WIDTH / 2 / FOCAL))
    shapes = {
        "object_2_wall": {"type": "rectangle", "to_world": at(30), "bsdf": black,
                          "emitter": {"type": "area", "radiance": GLOW}},
        "object_3_wall": {"type": "rectangle", "to_world": at(29, -100), "bsdf": black},
        "sky": {"type": "constant", "radiance": SKY},
    }  # fmt: skip
    (folder / "seen.json").write_text(json.dumps(shapes))
    sensor = {"type": "perspective", "fov": fov, "to_world": matrix(c2w), "film": film}
    (folder / "scene.json").write_text(json.dumps({"sensor": sensor, **shapes}))
    return folder


def viewed(request):
    (*_, (_, picture)) = Views().frames(read_view_request(request))
    return picture


def alone(folder, **how):
    return answered({"model": str(folder / "model.ply"), "camera": camera_json(CAMERA), "counts": COUNTS, **how})


def scene(folder, model=True, **how):
    request = {"scene": str(folder / "scene.json"), "samples": 2, **how}
    return answered(request | ({"model": str(folder / "model.ply"), "counts": COUNTS} if model else {}))


def drawn(splats):
    return render_picture(upload(splats), CAMERA, RasterOptions(sh_degree=splats.sh_degree))


def blended(splats):
    """[H, W, 3] the colours of ``drawn``, not clamped."""
    options, linear = RasterOptions(sh_degree=splats.sh_degree), DrawnAs(linear=True)
    radiance = render_picture(upload(splats), CAMERA, options, drawn=linear).radiance
    assert radiance is not None
    return radiance


def painted(colors):
    """The model with colours of its own, [N, 3], the same from everywhere."""
    return replace(SPLATS, sh_coeffs=((colors - 0.5) / C0)[:, None])


def shares(numbers):
    """[H, W] what these primitives cover beside the others: a picture in which they are white and the others black.

    Not clamped: of DoG primitives it may be negative.
    """
    colors = np.zeros((SPLATS.n_splats, 3))
    colors[numbers] = 1
    return blended(painted(colors))[..., 0]


def held_out(numbers):
    """The model, in which these primitives are black."""
    coeffs = SPLATS.sh_coeffs.copy()
    coeffs[numbers] = 0
    coeffs[numbers, 0] = -0.5 / C0
    return replace(SPLATS, sh_coeffs=coeffs)


def test_a_holdout_among_splats_leaves_its_share_of_the_picture_empty(folder):
    hole, expected = shares(FIRST), drawn(held_out(FIRST))
    assert hole.max() > 0.5 and (expected.alpha - hole).max() > 0.5
    picture = alone(folder, holdout=[0], passes=["depth", "object", "matte"])
    np.testing.assert_allclose(picture["color"], expected.color, atol=1e-5)
    np.testing.assert_allclose(picture["hole"], hole, atol=1e-5)
    np.testing.assert_allclose(picture["alpha"], expected.alpha - hole, atol=1e-5)
    assert np.isinf(picture["depth"][hole > 0.5]).all() and (picture["object"][hole > 0.5] == -1).all()
    assert set(np.unique(picture["object"])) == {-1, 1} and not (picture["matte"][..., 0] == 0).any()
    matte, others = picture["matte"][..., 0, :], (picture["object"] == 1) & (picture["alpha"] > 0.01)
    np.testing.assert_allclose(matte[others][:, 1], picture["alpha"][others], rtol=1e-5)
    everything = alone(folder)
    np.testing.assert_allclose(everything["alpha"], expected.alpha, atol=1e-6)
    assert "hole" not in everything and np.abs(everything["color"] - picture["color"]).max() > 0.1


def test_what_is_indirect_only_is_as_if_it_were_not_there_where_there_are_splats_alone(folder):
    expected = drawn(SPLATS.select(SECOND))
    picture = alone(folder, indirect_only=[0])
    np.testing.assert_allclose(picture["color"], expected.color, atol=1e-5)
    np.testing.assert_allclose(picture["alpha"], expected.alpha, atol=1e-5)
    assert np.abs(alone(folder)["color"] - picture["color"]).max() > 0.1


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_viewports_of_splats_alone_have_the_same_masks(folder, share):
    """Of their most important primitives too, over a background."""
    request = {"model": str(folder / "model.ply"), "camera": camera_json(CAMERA), "counts": COUNTS, "share": share}
    behind = [0.2, 0.4, 0.6]
    picture = viewed({**request, "holdout": [1], "indirect_only": [0], "background": behind})
    chosen = np.sort(np.argsort(-importance(SPLATS))[: round(share * SPLATS.n_splats)])
    dropped = held_out(SECOND).select(np.intersect1d(chosen, SECOND))  # all that is left is black
    alpha = drawn(dropped).alpha[..., None]
    np.testing.assert_allclose(picture[..., :3], (1 - alpha) * behind, atol=1e-5)
    np.testing.assert_allclose(picture[..., 3:], 1 - alpha, atol=1e-5)
    assert alpha.max() > 0.5
    linear = viewed({**request, "holdout": [1], "indirect_only": [0], "background": behind, "linear": True})
    np.testing.assert_allclose(linear[..., :3], np.maximum(1 - alpha, 0) * srgb_to_linear(behind), atol=1e-5)


@pytest.mark.parametrize("transparent", [False, True])
@pytest.mark.parametrize("samples", [0, 2])
def test_a_surface_that_is_a_holdout_is_a_hole(folder, transparent, samples):
    """The black wall, beside the one that glows."""
    how = {"transparent": transparent, "holdout": [3]}
    view = {"scene": str(folder / "seen.json"), "camera": camera_json(CAMERA), "samples": samples}
    picture = viewed({**view, **how})
    assert (picture[LEFT] == 0).all()
    everything = viewed({**view, "transparent": transparent})
    np.testing.assert_array_equal(picture[RIGHT], everything[RIGHT])
    np.testing.assert_allclose(everything[LEFT][..., 3], 1)
    assert everything[RIGHT][..., :3].min() > 0.4


@pytest.fixture(scope="module")
def with_a_lamp(folder):
    """The same scene with a lamp in front of the middle of both walls, and room for the sky to their right."""
    shapes = json.loads((folder / "scene.json").read_text())
    lamp = {"type": "rectangle", "to_world": at(10, size=2), "bsdf": {"type": "null"}}
    shapes["light_0"] = lamp | {"emitter": {"type": "area", "radiance": 9.0}}
    shapes["object_2_wall"]["to_world"] = at(30, -96)
    (folder / "lamp_before.json").write_text(json.dumps(shapes))
    return folder / "lamp_before.json"


@pytest.mark.parametrize("model", [False, True])
@pytest.mark.parametrize("hidden", [["hide_lamps"], ["transparent"], ["hide_lamps", "transparent"]])
def test_the_camera_sees_objects_that_shine_where_lamps_are_hidden(folder, with_a_lamp, hidden, model):
    """Over the sky, or over nothing. In viewports too, by paths, and at once with a lamp at the camera."""
    shows_sky = "transparent" not in hidden
    request = {"scene": str(with_a_lamp), **dict.fromkeys(hidden, True), "samples": 4}
    if model:
        request |= {"model": str(folder / "empty.ply"), "counts": [0]}
        write_ply(folder / "empty.ply", SPLATS.select(np.zeros(0, int)))
    picture = answered(request)
    scene_alone = {name: value for name, value in json.loads(with_a_lamp.read_text()).items() if name != "sensor"}
    (folder / "lamp_viewed.json").write_text(json.dumps(scene_alone))
    request |= {"scene": str(folder / "lamp_viewed.json"), "camera": camera_json(CAMERA)}
    seen = [np.dstack([picture["color"], picture["alpha"]]), *(viewed(request | {"samples": n}) for n in (4, 0))]
    wall, sky = np.s_[:, WIDTH // 2 + 1 : WIDTH // 2 + 2], np.s_[:, WIDTH - 3 :]
    for pixels in seen:
        np.testing.assert_allclose(pixels[wall][..., 3], 1)
        np.testing.assert_allclose(pixels[wall][..., :3], GLOW, rtol=1e-4 if pixels is not seen[-1] else 1)
        np.testing.assert_allclose(pixels[sky][..., :3], SKY if shows_sky else 0, atol=1e-4)
        np.testing.assert_allclose(pixels[sky][..., 3], shows_sky)
    assert answered({"scene": str(with_a_lamp), "samples": 4})["color"][HEIGHT // 2, WIDTH // 2 + 1].max() > 8


def test_a_holdout_that_shines_is_a_hole_where_lamps_are_hidden(folder):
    how = {"hide_lamps": True, "model": False}
    np.testing.assert_allclose(scene(folder, **how)["color"][RIGHT], GLOW, rtol=1e-4)
    picture = scene(folder, **how, holdout=[2])
    assert not picture["color"][RIGHT].any() and not picture["alpha"][RIGHT].any()


def test_passes_tell_nothing_of_a_surface_that_is_a_holdout(folder):
    passes = ["depth", "normal", "object", "matte"]
    picture = scene(folder, model=False, holdout=[3], passes=passes)
    assert np.isinf(picture["depth"][LEFT]).all() and not picture["normal"][LEFT].any()
    assert (picture["object"][LEFT] == -1).all() and (picture["matte"][LEFT][..., 0] == -1).all()
    np.testing.assert_allclose(picture["depth"][RIGHT], 30, rtol=1e-4)
    assert (picture["object"][RIGHT] == 2).all()


def test_the_camera_looks_through_a_surface_that_is_indirect_only(folder):
    picture = scene(folder, model=False, indirect_only=[3], passes=["depth", "object"])
    np.testing.assert_allclose(picture["color"], GLOW, rtol=1e-4)
    np.testing.assert_allclose(picture["depth"], 30, rtol=1e-4)
    assert (picture["object"] == 2).all() and (picture["alpha"] == 1).all()
    assert scene(folder, model=False)["color"][LEFT].max() < 0.01


def test_a_holdout_among_splats_in_a_scene_hides_the_surfaces_behind_it(folder):
    """Splats of sRGB values are blended as such, and those of holdouts are no part of the mean colour."""
    picture = scene(folder, indirect_only=[3], holdout=[0], samples=1, passes=["object", "matte"])
    of_others, hole, color = shares(SECOND)[..., None], shares(FIRST)[..., None], blended(held_out(FIRST))
    T = 1 - of_others - hole
    some = np.abs(of_others) > 1e-3
    mean = np.clip(np.divide(color, of_others, where=some, out=np.zeros_like(color)), 0, np.maximum(1, color))
    expected = of_others * srgb_to_linear(mean) + srgb_to_linear(color - of_others * mean) + T * GLOW
    sure = np.broadcast_to(some & ((T > 0.1) | (T < 1e-4)), color.shape)  # what of a path is seen is random elsewhere
    np.testing.assert_allclose(picture["color"][sure], expected[sure], atol=2e-3)
    np.testing.assert_allclose(picture["alpha"], 1 - hole[..., 0], atol=1e-4)
    some = (hole[..., 0] > 0.1) & (of_others[..., 0] > hole[..., 0] + 0.1)  # others are what covers most
    of_objects = picture["matte"][some][..., 1].sum(-1)
    assert some.sum() > 5 and of_objects.mean() == pytest.approx(1 - hole[some].mean(), abs=0.05)
    assert sure.mean() > 0.3 and (picture["object"][hole[..., 0] > 0.5] == -1).all()


def test_what_is_masked_is_there_for_light(folder):
    """A square between the camera and a white wall shines at the wall alone."""
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1, 1, 1]}}
    lamp = {"type": "rectangle", "to_world": at(25, 0, 2, -1), "bsdf": white}
    shapes = {
        "sensor": json.loads((folder / "scene.json").read_text())["sensor"],
        "object_2_wall": {"type": "rectangle", "to_world": at(30), "bsdf": white},
        "object_4_lamp": lamp | {"emitter": {"type": "area", "radiance": 20.0}},
    }
    (folder / "lamp.json").write_text(json.dumps(shapes))
    request = {"scene": str(folder / "lamp.json"), "samples": 16, "max_depth": 2}
    middle = np.s_[HEIGHT // 2 - 1 : HEIGHT // 2 + 1, WIDTH // 2 - 1 : WIDTH // 2 + 1]
    assert answered(request)["color"][middle].max() < 1e-3
    through, hole = answered(request | {"indirect_only": [4]}), answered(request | {"holdout": [4]})
    assert through["color"][middle].min() > 1
    assert not hole["color"][middle].any() and not hole["alpha"][middle].any()
    edge = np.s_[:, 0]
    assert hole["color"][edge].min() > 0.01
    np.testing.assert_allclose(hole["color"][edge].mean(), answered(request)["color"][edge].mean(), rtol=0.2)


def test_numbers_of_no_object_change_nothing(folder):
    everything, picture = scene(folder), scene(folder, holdout=[10**15], indirect_only=[7])
    np.testing.assert_allclose(picture["color"], everything["color"], atol=1e-6)
    assert (picture["alpha"] == 1).all()


def test_objects_that_are_not_those_of_the_model_are_one_line(folder):
    with pytest.raises(DataError, match='"counts" adds up to 3, the model has 40 primitives; give the number of'):
        alone(folder, counts=[1, 2], holdout=[0])
