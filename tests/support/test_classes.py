"""Functions that commands call say what they are given in place of settings."""

from typing import Any

import pytest
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.editing.clean import clean_model
from mi_dogsplat.editing.simplify import simplify_model
from mi_dogsplat.export.write import export_model
from mi_dogsplat.meshing.make import make_mesh
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.runs.run import train

MADE: dict[str, Any] = {"ExportConfig": export_model, "SimplifyConfig": simplify_model, "CleanConfig": clean_model,
                        "MeshConfig": make_mesh, "CaptureConfig": capture, "PosesConfig": find_poses}  # fmt: skip


@pytest.mark.parametrize("wanted", MADE)
def test_settings_of_another_class_are_called_so(wanted):
    with pytest.raises(ValueError, match=f"is of the class dict, not {wanted}; give an? {wanted}"):
        MADE[wanted]("model.ply", "made", {})


def test_a_training_of_a_folder_in_place_of_settings_says_what_it_takes(tmp_path):
    made: Any = train
    with pytest.raises(ValueError, match='not TrainConfig; give a TrainConfig, as TrainConfig."photos"'):
        made("photos", tmp_path / "run")
    assert not (tmp_path / "run").exists()
