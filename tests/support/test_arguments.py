"""Functions that take paths, and settings, name the argument that is none."""

from __future__ import annotations

import re
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

import pytest
from mi_dogsplat import read_model, read_ply, write_ply
from mi_dogsplat.check.run import check
from mi_dogsplat.compare.compare import compare
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.editing.clean import clean_model
from mi_dogsplat.editing.simplify import simplify_model
from mi_dogsplat.export.write import export_model
from mi_dogsplat.film.make import make_film, make_scene_film
from mi_dogsplat.inspection.describe_features import describe_features
from mi_dogsplat.inspection.info import describe
from mi_dogsplat.masking.make import make_masks
from mi_dogsplat.meshing.make import make_mesh
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.render.render_files import render_model, render_scene
from mi_dogsplat.runs.evaluation import evaluate_model
from mi_dogsplat.runs.run import train
from mi_dogsplat.support.arguments import checks_arguments
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.viewer.server import serve

PUBLIC: list[Any] = [
    read_model, read_ply, write_ply, load_dataset, capture, train, check, evaluate_model, render_model, render_scene,
    make_film, make_scene_film, export_model, simplify_model, clean_model, make_mesh, make_masks, find_poses, serve,
    compare, describe, describe_features,
]  # fmt: skip


@checks_arguments
def copied(data: str | Path, out: Path, preview: str | Path | None = None, name: str = "") -> tuple:
    """What it is called with."""
    return data, out, preview, name


@pytest.mark.parametrize("function", PUBLIC, ids=lambda function: function.__name__)
@pytest.mark.parametrize("given", [5, b"model.ply", ["model.ply"]], ids=repr)
def test_what_is_no_path_is_one_line_that_names_the_argument(function, given):
    takes = signature(function).parameters.values()
    paths = [argument.name for argument in takes if "Path" in argument.annotation.split(" | ")]
    others = {argument.name: "nowhere" for argument in takes if argument.default is Parameter.empty}
    assert paths
    for name in paths:
        kind = type(given).__name__
        line = f"{function.__name__}: {name}: is of the class {kind}, not a path; give a string or a Path"
        with pytest.raises(DataError, match=f"^{re.escape(line)}$"):
            function(**others | {name: given})


@pytest.mark.parametrize(
    ("function", "name", "wanted"),
    [
        (render_model, "options", "a PictureOptions"), (evaluate_model, "options", "a PictureOptions"),
        (make_film, "config", "a FilmConfig"), (make_masks, "config", "a MasksConfig"),
        (export_model, "world", "a WorldConfig"), (export_model, "config", "an ExportConfig"),
    ],
)  # fmt: skip
def test_what_are_no_settings_is_one_line_that_names_the_argument(function, name, wanted):
    takes = signature(function).parameters.values()
    others = {argument.name: "nowhere" for argument in takes if argument.default is Parameter.empty}
    line = f"{function.__name__}: {name}: is of the class dict, not {wanted.split()[1]}; give {wanted}"
    with pytest.raises(DataError, match=f"^{line}$"):
        function(**others | {name: {"background": "white"}})


def test_none_is_a_path_where_the_argument_may_be_left_out():
    assert copied("data", Path("out"), None, name="view") == ("data", Path("out"), None, "view")
    nothing: Any = None
    with pytest.raises(DataError, match="^copied: out: is of the class NoneType, not a path; "):
        copied("data", nothing)


def test_what_is_missing_or_too_much_is_said_as_python_says_it():
    call: Any = copied
    with pytest.raises(TypeError, match=r"^copied\(\) missing 1 required positional argument: 'out'$"):
        call("data")
    with pytest.raises(TypeError, match=r"^copied\(\) got an unexpected keyword argument 'quality'$"):
        call("data", "out", quality=3)


def test_paths_in_lists_are_checked_as_well(tmp_path):
    runs: Any = [5]
    with pytest.raises(DataError, match="^check: runs: is of the class int, not a path; "):
        check(tmp_path / "checked", runs=runs)
    for data in ([5], [b"photos"]):
        given: Any = data
        with pytest.raises(DataError, match="^DATA: is of the class (int|bytes), not a path; "):
            compare(TrainConfig("", preset="3dgs"), given, tmp_path / "compared")
    for single in (5, Path("photos")):
        given = single
        with pytest.raises(DataError, match=f'^DATA: is "{single}"; give a list, even of only one$'):
            compare(TrainConfig("", preset="3dgs"), given, tmp_path / "compared")
