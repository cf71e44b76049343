"""The render settings of a stage of OpenUSD, and products of theirs: which camera a film has, and what it shows."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

import pytest
from camera_stages import saved, shot
from mi_dogsplat.support.errors import DataError
from pxr import Gf, Usd, UsdGeom, UsdRender


@pytest.fixture
def stage(tmp_path) -> Usd.Stage:
    return shot(tmp_path)


def test_of_several_cameras_that_of_the_render_settings_is_taken(stage):
    UsdGeom.Camera.Define(stage, "/Other").AddTranslateOp().Set(Gf.Vec3d(7, 8, 9))
    settings = UsdRender.Settings.Define(stage, "/Render")
    stage.SetMetadata("renderSettingsPrimPath", "/Render")
    settings.CreateCameraRel().SetTargets(["/Other"])
    assert saved(stage).at(0.0).c2w[:3, 3].tolist() == [7, 8, 9]
    assert saved(stage, name=":/Rig/Camera").what == "camera /Rig/Camera of shot.usda"
    settings.GetCameraRel().SetTargets(["/Nobody"])
    with pytest.raises(DataError, match="has several cameras"):
        saved(stage)


def rendered(stage, size) -> UsdRender.Settings:
    """Settings by which a stage is to be rendered in this size."""
    settings = UsdRender.Settings.Define(stage, "/Render")
    settings.CreateResolutionAttr(Gf.Vec2i(*size))
    stage.SetMetadata("renderSettingsPrimPath", "/Render")
    return settings


@pytest.mark.parametrize("policy, by_width", [
    (None, "square tall"), ("expandAperture", "square tall"), ("cropAperture", "wide"),
    ("adjustApertureWidth", ""), ("adjustApertureHeight", "square tall wide"),
])  # fmt: skip
@pytest.mark.parametrize("shape, size", [("square", (400, 400)), ("wide", (400, 100)), ("tall", (100, 400))])
def test_a_picture_shows_as_much_of_an_aperture_as_its_settings_say(stage, shape, size, policy, by_width):
    """Pixels of a unit of the aperture, 32 by 18: those of its width, or those of its height."""
    settings = rendered(stage, size)
    if policy:
        settings.CreateAspectRatioConformPolicyAttr(policy)
    camera = saved(stage).at(1.0).camera(*size)
    scale = size[0] / 32 if shape in by_width.split() else size[1] / 18
    assert (camera.fx, camera.fy) == pytest.approx((50 * scale, 50 * scale))
    middle = size[0] / 2 - 2 * scale, size[1] / 2 - 1.5 * scale
    assert (camera.cx, camera.cy) == pytest.approx(middle)


def test_pixels_that_are_not_square_make_a_picture_of_the_shown_proportions(stage):
    settings = rendered(stage, (400, 270))
    settings.CreatePixelAspectRatioAttr(2.0)
    assert saved(stage).size == (800, 270)
    settings.CreateAspectRatioConformPolicyAttr("adjustPixelAspectRatio")  # which puts its own in place of the given
    path = saved(stage)
    assert path.size == (480, 270)  # 32 by 18
    assert path.at(1.0).camera(480, 270).fx == pytest.approx(50 * 15)


def test_a_product_of_the_settings_comes_before_them_in_pictures_of_its_camera(stage):
    UsdGeom.Camera.Define(stage, "/Other")
    settings = rendered(stage, (640, 360))
    products = [UsdRender.Product.Define(stage, f"/Render/{name}") for name in ("Close", "Wide")]
    settings.CreateProductsRel().SetTargets(["/Render/Missing", *(product.GetPath() for product in products)])
    close, wide = products
    close.CreateCameraRel().SetTargets(["/Other"])
    close.CreateResolutionAttr(Gf.Vec2i(100, 50))
    wide.CreatePixelAspectRatioAttr(2.0)
    assert saved(stage).size == (100, 50)  # of the camera of the first one
    assert saved(stage, name=":/Rig/Camera").size == (1280, 360)  # resolution of the settings, pixels of its own
    settings.CreateCameraRel().SetTargets(["/Other"])
    assert saved(stage, name=":/Rig/Camera").size == (640, 360)  # which no product shows
    wide.CreateCameraRel().SetTargets(["/Rig/Camera"])
    wide.CreateAspectRatioConformPolicyAttr("adjustPixelAspectRatio")
    assert saved(stage, name=":/Rig/Camera").size == (640, 360)


@pytest.mark.parametrize("aspect", [0.0, -1.0, float("nan"), float("inf")])
def test_pixels_of_no_width_are_square(stage, aspect):
    rendered(stage, (400, 270)).CreatePixelAspectRatioAttr(aspect)
    assert saved(stage).size == (400, 270)


def test_the_library_is_silent_about_settings_that_are_nowhere(stage, capfd):
    stage.SetMetadata("renderSettingsPrimPath", "no path")
    assert saved(stage).at(0.5).focal > 0
    assert capfd.readouterr() == ("", "")
