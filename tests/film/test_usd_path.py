"""Cameras of OpenUSD as camera paths: they see what the library's own camera sees, wherever the model stands."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

import os

import foreign_model
import numpy as np
import pytest
import tiny_data
from camera_stages import saved, shot
from command_line import assert_one_line, run
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.film.film_config import FilmConfig
from mi_dogsplat.film.make import make_film
from mi_dogsplat.film.usd_path import is_usd_path, usd_path
from mi_dogsplat.formats.upright import upright
from mi_dogsplat.support.errors import DataError
from pxr import Gf, Usd, UsdGeom, UsdRender
from rendered_files import read_png

MODEL = foreign_model.model()
SIZE = (1280, 720)
TILTED = "0.36,-0.8,0.48"


@pytest.fixture
def stage(tmp_path) -> Usd.Stage:
    return shot(tmp_path)


def by_the_library(stage, time, world, name="/Rig/Camera") -> np.ndarray:
    """Pixels [N, 2] of points [N, 3] of a stage, by the view and projection of its own frustum."""
    camera = UsdGeom.Camera(stage.GetPrimAtPath(name)).GetCamera(time)
    matrix = np.array(camera.frustum.ComputeViewMatrix() * camera.frustum.ComputeProjectionMatrix())  # for rows
    clip = np.concatenate([world, np.ones((len(world), 1))], axis=1) @ matrix
    x, y = (clip[:, :2] / clip[:, 3:]).T
    return np.stack([(x + 1) / 2 * SIZE[0], (1 - y) / 2 * SIZE[1]], axis=1)


def by_us(path, share, means) -> np.ndarray:
    camera = path.at(share).camera(*SIZE)
    points = means @ camera.w2c[:3, :3].T + camera.w2c[:3, 3]
    assert (points[:, 2] > 0).all()
    return points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_points_are_where_the_camera_of_the_library_sees_them(stage, share):
    path = saved(stage)
    rng = np.random.default_rng(1)
    world = rng.uniform(-1, 1, (30, 3))  # of a scene: the coordinates of the stage
    expected = by_the_library(stage, 1 + share * 24, world)
    assert np.ptp(expected, axis=0).min() > 100
    np.testing.assert_allclose(by_us(path, share, world), expected, atol=1e-3)


@pytest.mark.parametrize("drawing", [Drawing(), Drawing(up="z", scale=0.7), Drawing(up=TILTED, scale=1.5)])
@pytest.mark.parametrize(("axis", "metres"), [("Y", 1.0), ("Z", 0.5)])
def test_a_model_stands_in_the_stage_upright_and_in_metres(stage, drawing, axis, metres):
    UsdGeom.SetStageUpAxis(stage, axis)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    model = Model(MODEL, drawing)
    x, y, z = upright(model)[0].splats.means.T.astype(np.float64) / metres  # right, down, forward, in the stage's units
    world = np.stack([x, -y, -z] if axis == "Y" else [x, z, -y], axis=1)
    world, means = world / 3, MODEL.means / 3  # all in front of it
    np.testing.assert_allclose(by_us(saved(stage, model), 0.5, means), by_the_library(stage, 13, world), atol=0.01)


@pytest.mark.parametrize("form", ["the file", "the stage", "the model before it was refined", "another model"])
def test_a_model_that_the_stage_shows_is_filmed_where_it_is_there(stage, tmp_path, form):
    said = Model(MODEL, Drawing(up="z", scale=0.4))
    write_model(tmp_path / "a.usdc", said)
    place = UsdGeom.Xform.Define(stage, "/Set/Room")
    place.GetPrim().GetReferences().AddReference("./a.usdc")
    place.AddTranslateOp().Set(Gf.Vec3d(0.3, -0.2, 1))
    place.AddRotateZOp().Set(30.0)
    stage.Save()
    prim = stage.GetPrimAtPath("/Set/Room/Splats")
    to_world = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))  # for rows
    held = np.array(prim.GetAttribute("positions").Get())
    world = (np.concatenate([held, np.ones((len(held), 1))], axis=1) @ to_world)[:, :3]
    model = {
        "the file": said,
        "the stage": read_model(tmp_path / "shot.usda"),  # whose numbers are those of the world
        "the model before it was refined": Model(_shaken(MODEL, 1e-3), said.drawing),
        "another model": Model(_shaken(MODEL, 1.0), said.drawing),
    }[form]
    found = by_us(saved(stage, model), 0.5, model.splats.means)
    expected = by_the_library(stage, 13, world)
    if form == "another model":  # is no more than upright and in metres
        assert np.abs(found - expected).max() > 50
    else:
        np.testing.assert_allclose(found, expected, atol=2 if "refined" in form else 0.01)


def _shaken(splats, size):
    rng = np.random.default_rng(3)
    columns = {name: getattr(splats, name) for name in ("log_scales", "quats", "logit_opacities", "sh_coeffs")}
    return type(splats)(means=splats.means + size * rng.normal(size=splats.means.shape), **columns)


def test_a_film_takes_the_time_and_the_size_of_the_stage(stage):
    path = saved(stage)
    assert path.seconds == 1.0 and path.size == (1280, 720) and not path.closed  # of its samples, and its aperture
    assert path.what == "camera /Rig/Camera of shot.usda"
    n, steps = path.frames(None, 24)
    assert n == 25 and (path.moments(n, steps)[:, 0] * 24 + 1).tolist() == pytest.approx(np.arange(1, 26))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(49)
    UsdRender.Settings.Define(stage, "/Render").CreateResolutionAttr(Gf.Vec2i(640, 270))
    stage.SetMetadata("renderSettingsPrimPath", "/Render")
    path = saved(stage)
    assert path.seconds == 2.0 and path.size == (640, 270)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera"))
    camera.GetVerticalApertureAttr().Set(64.0)  # twice as high as wide
    stage.RemovePrim("/Render")
    assert saved(stage).size == (640, 1280)


def test_a_film_has_the_rate_of_the_stage_where_it_is_whole(stage):
    assert saved(stage).fps == 24  # of its time codes
    stage.SetFramesPerSecond(25)
    assert saved(stage).fps == 25
    for rate in (23.976, 0, 1000):
        stage.SetFramesPerSecond(rate)
        assert saved(stage).fps is None


def test_what_stands_still_has_no_time_of_its_own(stage):
    for name in ("/Rig/Camera.focalLength", "/Rig.xformOp:rotateY"):
        stage.GetAttributeAtPath(name).Clear()
    path = saved(stage)
    assert path.seconds is None
    np.testing.assert_array_equal(path.at(0.0).c2w, path.at(1.0).c2w)


def test_another_field_of_view_may_be_asked_for(stage):
    assert saved(stage).at(0.0).focal == pytest.approx(30 / 18)
    assert saved(stage, fov=90.0).at(1.0).focal == pytest.approx(0.5)


def test_scaled_and_mirrored_cameras_keep_their_place_and_see_no_mirror_image(stage):
    plain = saved(stage).at(0.5).c2w
    scale = UsdGeom.Xformable(stage.GetPrimAtPath("/Rig/Camera")).AddScaleOp()
    for sides in ((3, 3, 3), (-2, 2, 2)):
        scale.Set(Gf.Vec3f(*sides))
        np.testing.assert_allclose(saved(stage).at(0.5).c2w, plain, atol=1e-6)


def test_one_of_several_cameras_is_named(stage):
    UsdGeom.Camera.Define(stage, "/Other").AddTranslateOp().Set(Gf.Vec3d(7, 8, 9))
    several = r"shot.usda: has several cameras: /Rig/Camera, /Other; name one: --path .*shot.usda:/Rig/Camera"
    with pytest.raises(DataError, match=several):
        saved(stage)
    assert saved(stage, name=":/Other").at(0.0).c2w[:3, 3].tolist() == [7, 8, 9]
    with pytest.raises(DataError, match="shot.usda: has no camera /Rig; name one of its own: /Rig/Camera, /Other"):
        saved(stage, name=":/Rig")


@pytest.mark.parametrize("sides", [(-1, 1, 1), (1, 2, 1)])
def test_a_model_that_a_stage_mirrors_or_stretches_is_filmed_as_the_stage(stage, tmp_path, sides):
    write_model(tmp_path / "a.usdc", Model(MODEL))
    place = UsdGeom.Xform.Define(stage, "/Set")
    place.GetPrim().GetReferences().AddReference("./a.usdc")
    place.AddScaleOp().Set(Gf.Vec3f(*sides))
    with pytest.raises(DataError, match="shot.usda: stretches or mirrors the model; film .*film .*shot.usda --path"):
        saved(stage, Model(MODEL))
    model = read_model(tmp_path / "shot.usda")
    world = MODEL.means * [1, -1, -1] * sides
    np.testing.assert_allclose(
        by_us(saved(stage, model), 0.5, model.splats.means), by_the_library(stage, 13, world), atol=0.01
    )


def test_between_the_matrices_of_a_turning_model_the_camera_sees_it_turned_half_way(stage, tmp_path):
    """There the library has the mean of two matrices, which shrinks the model across its axis."""
    write_model(tmp_path / "a.usdc", Model(MODEL))
    place = UsdGeom.Xform.Define(stage, "/Set")
    place.GetPrim().GetReferences().AddReference("./a.usdc")
    matrix = place.AddTransformOp()
    turns = [Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(0, 1, 0), degrees)) for degrees in (0, 20, 10)]
    matrix.Set(turns[0], 1)
    matrix.Set(turns[1], 25)
    between = saved(stage, Model(MODEL)).at(0.5).c2w
    matrix.GetAttr().Clear()
    matrix.Set(turns[2])
    expected = saved(stage, Model(MODEL)).at(0.5).c2w
    np.testing.assert_allclose(between[:3, :3], expected[:3, :3], atol=1e-6)
    np.testing.assert_allclose(between[:3, 3], expected[:3, 3], rtol=0.02)


def test_a_model_on_a_turntable_turns_before_the_camera(stage, tmp_path):
    write_model(tmp_path / "a.usdc", Model(MODEL))
    place = UsdGeom.Xform.Define(stage, "/Set")
    place.GetPrim().GetReferences().AddReference("./a.usdc")
    turn = place.AddRotateYOp()
    turn.Set(0.0, 1)
    turn.Set(180.0, 25)
    path = saved(stage, Model(MODEL))
    for share in (0.0, 0.3):
        time = 1 + share * 24
        world = MODEL.means * [1, -1, -1] @ np.array(place.GetLocalTransformation(time))[:3, :3]  # for rows
        np.testing.assert_allclose(by_us(path, share, MODEL.means), by_the_library(stage, time, world), atol=0.01)


def test_a_stage_that_hardly_moves_its_model_does_not_move_it_twice(stage, tmp_path):
    write_model(tmp_path / "a.usdc", Model(MODEL))
    place = UsdGeom.Xform.Define(stage, "/Set")
    place.GetPrim().GetReferences().AddReference("./a.usdc")
    place.AddTranslateOp().Set(Gf.Vec3d(0.01, 0, 0))
    stage.Save()
    world = MODEL.means * [1, -1, -1] + [0.01, 0, 0]
    for model in (Model(MODEL), read_model(tmp_path / "shot.usda")):
        found = by_us(saved(stage, model), 0.5, model.splats.means)
        np.testing.assert_allclose(found, by_the_library(stage, 13, world), atol=0.01)


@pytest.mark.parametrize("range_", [(5, 5), (30, 2), (float("nan"), 9), (1, float("inf"))])
def test_a_range_of_one_frame_or_none_says_nothing(stage, range_):
    stage.SetStartTimeCode(range_[0])
    stage.SetEndTimeCode(range_[1])
    path, world = saved(stage), MODEL.means / 9
    assert path.seconds == 1.0
    np.testing.assert_allclose(by_us(path, 0.5, world), by_the_library(stage, 13, world), atol=0.01)


def test_what_is_above_a_reset_does_not_move_the_camera(stage):
    UsdGeom.Xformable(stage.GetPrimAtPath("/Rig")).AddTranslateOp().Set(Gf.Vec3d(1), 1001)
    UsdGeom.Xformable(stage.GetPrimAtPath("/Rig/Camera")).SetResetXformStack(True)
    assert saved(stage).seconds == 1.0  # of its focal length


def test_what_breaks_while_a_film_is_made_is_one_line(stage, capfd):
    path = saved(stage)
    UsdGeom.Xformable(stage.GetPrimAtPath("/Rig/Camera")).GetXformOpOrderAttr().Set(["nonsense"])
    with pytest.raises(DataError, match="shot.usda: cannot be read as OpenUSD"):
        path.at(0.5)
    assert capfd.readouterr() == ("", "")


def test_a_stage_that_is_written_anew_while_a_film_is_made_is_followed_as_it_was(stage, tmp_path):
    """The library maps binary files into memory, and some programs write theirs in place."""
    write_model(tmp_path / "model.ply", tiny_data.truth())
    stage.Save()
    shot = tmp_path / "shot.usdc"
    stage.Export(str(shot))

    def overwrite(done: int, n: int, what: str) -> None:
        with shot.open("r+b") as file:
            file.write(bytes(shot.stat().st_size))

    for kind, progress in (("usda", lambda done, n, what: None), ("usdc", overwrite)):
        config = FilmConfig(path=str(tmp_path / f"shot.{kind}"), fps=2, size=(48, 27))
        make_film(tmp_path / "model.ply", tmp_path / kind, config=config, progress=progress)
    for number in range(3):
        calm, disturbed = (read_png(tmp_path / kind / f"{number:04d}.png") for kind in ("usda", "usdc"))
        np.testing.assert_array_equal(disturbed, calm)


def test_a_camera_whose_layer_is_missing_says_so(tmp_path, capfd):
    layer = Usd.Stage.CreateNew(str(tmp_path / "set.usda"))
    layer.GetRootLayer().subLayerPaths.append("./camera.usda")
    capfd.readouterr()  # the library complains of the last line
    with pytest.raises(
        DataError, match="set.usda: has no camera .what cannot be found or read: .*camera.usda.*; export"
    ):
        saved(layer)


def _orthographic(camera):
    camera.CreateProjectionAttr("orthographic")


def _spherical(camera):
    camera.CreateProjectionAttr("spherical")


def _off(camera):
    camera.GetHorizontalApertureOffsetAttr().Set(float("nan"))


def _without_rate(camera):
    camera.GetPrim().GetStage().SetTimeCodesPerSecond(0)


def _without_lens(camera):
    camera.GetFocalLengthAttr().Set(0.0, 25)


def _flat(camera):
    camera.AddScaleOp().Set(Gf.Vec3f(1, 0, 1))


def _gone(camera):
    camera.GetPrim().SetActive(False)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_orthographic, "the camera /Rig/Camera is orthographic; name one with a perspective"),
        (_spherical, "the camera /Rig/Camera is spherical; name one with a perspective"),
        (_without_lens, "the camera /Rig/Camera has no lens; give it"),
        (_off, "the camera /Rig/Camera has no lens; give it"),
        (_without_rate, "its timeCodesPerSecond is 0; give it"),
        (_flat, "the camera /Rig/Camera is flat; give it"),
        (_gone, "has no camera; export"),
    ],
)
def test_what_is_no_camera_of_a_film_is_one_line(stage, change, said):
    change(UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera")))
    with pytest.raises(DataError, match=f"shot.usda: {said}"):
        saved(stage)


def test_files_that_are_no_stages_are_one_line(tmp_path):
    (tmp_path / "a.usd").write_text("no more than text")
    with pytest.raises(DataError, match="a.usd: cannot be read as OpenUSD"):
        usd_path(str(tmp_path / "a.usd"), None, None)
    with pytest.raises(DataError, match="b.usd: cannot be read .No such file"):
        usd_path(str(tmp_path / "b.usd"), None, None)
    os.mkfifo(tmp_path / "pipe.usd")
    with pytest.raises(DataError, match="pipe.usd: is not a regular file; give"):
        usd_path(str(tmp_path / "pipe.usd"), None, None)
    assert [is_usd_path(name) for name in ("a.usd", "A.USDZ:/Cam", "a.usd:Cam", "a.json", "orbit", ".usd")] == [
        True, True, False, False, False, False,
    ]  # fmt: skip
    assert FilmConfig(path="shot.usdc:/Cam").path == "shot.usdc:/Cam"
    with pytest.raises(DataError, match="use auto, orbit, cameras, a .json of key frames, or a .usd"):
        FilmConfig(path="shot.abc")


def test_a_film_by_the_command_line(capsys, stage, tmp_path):
    """The camera circles the model, which stands at the origin; each frame shows it."""
    write_model(tmp_path / "model.ply", tiny_data.truth())
    stage.Save()
    argv = ("film", tmp_path / "model.ply", "-o", tmp_path / "frames", "--fps", "2", "--size", "48", "27")
    status, printed, error = run(capsys, *argv, "--path", tmp_path / "shot.usda")
    assert status == 0, error
    assert len(list((tmp_path / "frames").glob("*.png"))) == 3 and "camera /Rig/Camera of shot.usda" in printed + error
    assert_one_line(run(capsys, *argv, "--path", f"{tmp_path / 'shot.usda'}:/No"), "shot.usda", "no camera /No")
