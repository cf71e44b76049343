"""A folder that is given in place of a model: what it is, and what to give instead."""

from __future__ import annotations

import os
from pathlib import Path

from ..support.errors import DataError
from ..support.run_files import are_of_run

DATA = {"transforms.json", "transforms_train.json", "sparse", "colmap", "cameras.bin", "cameras.txt"}


def folder_given(folder: Path, models: list[Path], wanted: str) -> DataError:
    """What is said of a folder.

    Args:
        models: files of models in it.
        wanted: what is to be given, in words.
    """
    names = os.listdir(folder)
    if models:
        return DataError(folder, "this is a folder", f"give the model in it: {models[0]}")
    if are_of_run(names):
        problem = "is a run that has no model yet"
        return DataError(folder, problem, "let it end (dogsplat train --resume); dogsplat view shows its checkpoint")
    if not DATA.isdisjoint(names):
        problem = "is a data set, but a model is needed"
        return DataError(folder, problem, "give one that was trained on it, as RUN/point_cloud.ply")
    return DataError(folder, "this is a folder", f"give the path of {wanted}")
