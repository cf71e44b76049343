"""A stage of OpenUSD with a moving camera, and the way of that camera."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from pathlib import Path

from mi_dogsplat.film.camera_path import CameraPath
from mi_dogsplat.film.usd_path import usd_path
from pxr import Gf, Usd, UsdGeom


def shot(folder: Path) -> Usd.Stage:
    """A camera under a place that turns, moved and zoomed from time 1 to 25, its aperture off the middle."""
    stage = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(24)
    rig = UsdGeom.Xform.Define(stage, "/Rig")
    turn = rig.AddRotateYOp()
    turn.Set(10.0, 1)
    turn.Set(70.0, 25)
    camera = UsdGeom.Camera.Define(stage, "/Rig/Camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0.3, 0.5, 8))
    camera.AddRotateXYZOp().Set(Gf.Vec3f(-5, 3, 20))
    camera.CreateFocalLengthAttr().Set(30.0, 1)
    camera.GetFocalLengthAttr().Set(50.0, 25)
    camera.CreateHorizontalApertureAttr(32.0)
    camera.CreateVerticalApertureAttr(18.0)
    camera.CreateHorizontalApertureOffsetAttr(2.0)
    camera.CreateVerticalApertureOffsetAttr(-1.5)
    return stage


def saved(stage, model=None, name="", fov=None) -> CameraPath:
    stage.Save()
    return usd_path(stage.GetRootLayer().realPath + name, model, fov)
