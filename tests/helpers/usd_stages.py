"""Stages of OpenUSD for tests: written, referenced, saved, and compared."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from pathlib import Path

import foreign_model
import numpy as np
from mi_dogsplat import Model, read_model, write_model
from pxr import Usd, UsdGeom
from scipy.spatial.transform import Rotation

MODEL = foreign_model.model()
PRIM = "/Model/Splats"
ROWS = ("means", "log_scales", "logit_opacities", "sh_coeffs")


def written(folder: Path) -> Path:
    """A text with the model."""
    write_model(folder / "a.usda", Model(MODEL))
    return folder / "a.usda"


def read_saved(stage) -> Model:
    stage.Save()
    return read_model(stage.GetRootLayer().realPath)


def a_stage(path, up="Y", metres=1.0) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    return stage


def referencing(stage, path, file) -> UsdGeom.Xform:
    place = UsdGeom.Xform.Define(stage, path)
    place.GetPrim().GetReferences().AddReference(str(file))
    return place


def assert_same(read, expected, atol=1e-5):
    for name in ROWS:
        np.testing.assert_allclose(getattr(read, name), getattr(expected, name), rtol=0, atol=atol)
    np.testing.assert_allclose(covariances(read), covariances(expected), rtol=1e-4, atol=1e-5)


def covariances(splats) -> np.ndarray:
    """[N, 3, 3]: axes of one Gaussian may point to either side."""
    axes = Rotation.from_quat(splats.quats).as_matrix() * np.exp(splats.log_scales.astype(np.float64))[:, None]
    return axes @ axes.transpose(0, 2, 1)
