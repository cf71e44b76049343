"""A model and photographs of linear radiance are compared in one exposure, whatever each of them says is white."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tiny_data
from hdr_data import bright_truth, write_hdr_data
from mi_dogsplat import Drawing, Model, write_model, write_ply
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.editing.clean import clean_model
from mi_dogsplat.export.export_config import ExportConfig
from mi_dogsplat.export.losses import losses, views_of
from mi_dogsplat.export.refine import by_data
from mi_dogsplat.export.write import export_model
from mi_dogsplat.measure.evaluate import mean_metrics
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.runs.evaluation import evaluate_model
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import displayed
from mi_dogsplat.viewer.renderer import Renderer
from mi_dogsplat.viewer.view_state import ERROR, MODEL, PHOTOGRAPH, Pose, Settings
from scipy.spatial.transform import Rotation
from tiny_data import HEIGHT, WIDTH


@pytest.fixture(scope="module", params=[False, True], ids=["opaque", "on white"])
def data(request, tmp_path_factory) -> Path:
    return write_hdr_data(tmp_path_factory.mktemp("exposure") / "data", alpha=request.param)


@pytest.fixture(scope="module")
def dataset(data) -> Dataset:
    return load_dataset(data)


@pytest.fixture(scope="module")
def drawn(dataset) -> DrawnAs:
    """Of the exact model, with a white that is not that of the images."""
    assert dataset.white is not None
    return DrawnAs(near_clip=0.05, linear=True, white=4 * dataset.white)


def test_an_exact_model_loses_nothing_in_an_export(dataset, drawn):
    views = views_of(bright_truth(), dataset, 2, PictureOptions(), drawn)
    (loss,) = losses({"as it is": bright_truth()}, views)
    assert (loss.of_photographs or 0) > 70  # half floats


def test_its_goal_is_what_it_shows(dataset, drawn):
    goal = by_data(bright_truth(), dataset, 2, PictureOptions(), drawn)
    shown = by_data(bright_truth(), replace(dataset, train=[replace(v, white=None) for v in dataset.train]), 2,
                    PictureOptions(background="white" if dataset.has_alpha else "black"), drawn)  # fmt: skip
    for radiance, rendered in zip(goal.pictures, shown.pictures, strict=True):
        np.testing.assert_allclose(radiance, rendered, rtol=2e-3, atol=1e-3 * drawn.white)


def test_eval_measures_no_error_on_white_either(data, drawn, tmp_path):
    write_ply(tmp_path / "model.ply", bright_truth())
    options = PictureOptions(near_clip=0.05, linear=True, white=drawn.white)
    for view in evaluate_model(tmp_path / "model.ply", data, options=options).values():
        assert view["psnr"] > 70 and view["psnr_mu"] > 70


def test_eval_exposes_images_and_model_by_the_white_that_it_is_given(data, dataset, tmp_path):
    write_ply(tmp_path / "brighter.ply", brightened(bright_truth(), 1.1))

    def measured(white: float | None) -> float:
        options = PictureOptions(near_clip=0.05, linear=True, white=white)
        return mean_metrics(evaluate_model(tmp_path / "brighter.ply", data, options=options))["psnr"]

    def expected(white: float) -> float:
        return float(np.mean([psnr(*(shown(view, factor, white) for factor in (1.1, 1.0))) for view in dataset.test]))

    def shown(view: View, factor: float, white: float) -> np.ndarray:
        behind = white * (1 - view.image[..., 3:]) if dataset.has_alpha else 0.0
        return displayed(factor * view.image[..., :3] + behind, white)

    assert dataset.white is not None
    bright = 3 * dataset.white
    assert expected(bright) > expected(dataset.white) + 2
    assert measured(None) == pytest.approx(expected(dataset.white), abs=0.01)
    assert measured(bright) == pytest.approx(expected(bright), abs=0.01)


def test_a_white_of_colours_that_are_no_radiance_is_refused_and_gets_into_no_file(tmp_path):
    data, model, out = tiny_data.write_tiny_data(tmp_path / "data"), tmp_path / "model.ply", tmp_path / "out.ply"
    write_ply(model, tiny_data.truth())
    options = PictureOptions(white=3.0)
    for refused in (
        lambda: evaluate_model(model, data, options=options),
        lambda: clean_model(model, out, options=options),
        lambda: export_model(model, out, ExportConfig(refine=0), options=options),
    ):
        with pytest.raises(DataError, match="--white: is for linear radiance, but the model has sRGB colours"):
            refused()
    assert not out.exists()


@pytest.mark.parametrize(("name", "version"), [("a.splat", 3), ("a.spz", 4), ("a.spz", 3)])
def test_the_loss_of_a_file_does_not_depend_on_the_unit_of_radiance(tmp_path, name, version):
    """The file is in units of white, whether it says so or not."""
    found = []
    for white in (1.0, 4.0):
        write_model(tmp_path / "m.ply", Model(brightened(tiny_data.truth(), white), Drawing(linear=True, white=white)))
        exported = export_model(tmp_path / "m.ply", tmp_path / name, ExportConfig(views=2, spz_version=version))
        assert exported.losses[-1].stage == "read from the file"
        found.append(exported.losses[-1].of_model)
    assert found[1] == pytest.approx(found[0], abs=0.1) and found[0] > 25  # dB


def test_the_viewer_shows_the_photograph_as_it_shows_the_model(dataset, drawn):
    view = dataset.train[0]
    x, y, z, w = Rotation.from_matrix(view.camera.c2w[:3, :3]).as_quat()
    fov = 2 * float(np.arctan(HEIGHT / 2 / view.camera.fy))
    pose = Pose((w, x, y, z), tuple(view.camera.position), fov, WIDTH / HEIGHT)
    renderer = Renderer(bright_truth(), drawn, dataset.views)
    how: Any = {"height": HEIGHT, "background": 1.0 if dataset.has_alpha else 0.0}
    model, photograph = (renderer.draw(pose, Settings(show, **how)).image.astype(int) for show in (MODEL, PHOTOGRAPH))
    assert np.abs(model - photograph).max() <= 1 and model.max() > 100
    assert float(renderer.draw(pose, Settings(ERROR, **how)).about.split()[-1]) < 1e-3
