"""What the add-on has a copy of, as it runs without the package: both give the same numbers.

``test_addon_rows.py`` has what only some primitives have.
"""

import ast
import json
from pathlib import Path

import numpy as np
import ply_files
import pytest
from addon_models import MAPS, SHEAR, as_model
from dataset_folders import HEIGHT, WIDTH, transforms_folder
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import view_name
from mi_dogsplat.datasets.refined import write_refined
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.drawing import Drawing, comments_of, drawing_of
from mi_dogsplat.scene.linear_map import sh_projection
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.sh_basis import sh_basis_table
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.srgb import linear_to_srgb, srgb_to_linear
from mi_dogsplat.training.presets import RECIPES
from sloped_models import with_curvatures, with_slopes
from splat_scenes import random_splats, rounded

ADDON = Path(__file__).parents[2] / "blender_addon"


@pytest.mark.parametrize("name", MAPS)
def test_a_transform_makes_the_same_of_a_model(addon, name):
    """Similarities, and maps that are none (``linear_map.py`` of both)."""
    matrix, splats = affine(MAPS[name], (0.4, -0.3, 0.2)), rounded(random_splats(40, seed=7))
    expected = transformed(splats, matrix)
    got = addon("files.transform").transformed(as_model(addon, splats), matrix)
    wanted = as_model(addon, expected)
    for field in ("means", "log_scales", "sh_coeffs", "dog_logit_opacities"):
        np.testing.assert_allclose(getattr(got, field), getattr(wanted, field), rtol=1e-5, atol=2e-6, err_msg=field)
    dog = wanted.is_dog
    np.testing.assert_allclose(got.dog_log_scales[dog], wanted.dog_log_scales[dog], rtol=1e-5, atol=2e-6)
    both = (model.quats / np.linalg.norm(model.quats, axis=1, keepdims=True) for model in (got, wanted))
    np.testing.assert_allclose(np.abs(np.einsum("nk,nk->n", *both)), 1, atol=1e-5)  # q and -q are one rotation


def test_the_3d_filter_of_mip_splatting_makes_the_same_of_a_model(addon, tmp_path):
    splats = ply_files.random_splats(dog_index=())
    widths = np.array([0, 1e-3, 0.1, 0.5, 1, 3, 1e-30], np.float32)
    columns = ply_files.vertex_columns(splats) | {"filter_3D": widths}
    path = ply_files.write(tmp_path, ply_files.to_bytes({"vertex": columns}))
    got, wanted = addon("files.ply").read_ply(path), read_ply(path)
    for field in ("log_scales", "logit_opacities"):
        np.testing.assert_allclose(getattr(got, field), getattr(wanted, field), rtol=1e-6, err_msg=field)
        assert not np.array_equal(getattr(got, field), getattr(splats, field)), field


@pytest.mark.parametrize("code", ["uchar", "ushort", "float"])
def test_colours_in_place_of_coefficients_make_the_same_of_a_model(addon, tmp_path, code):
    splats = ply_files.random_splats(sh_degree=0, dog_index=())
    full = {"uchar": 255, "ushort": 65535, "float": 1}[code]
    levels = np.linspace(0, full, 21).reshape(7, 3)
    columns = ply_files.vertex_columns(splats) | dict(zip(("red", "green", "blue"), levels.T, strict=True))
    columns = {name: values for name, values in columns.items() if not name.startswith("f_dc")}
    types = dict.fromkeys(("red", "green", "blue"), code)
    path = ply_files.write(tmp_path, ply_files.to_bytes({"vertex": columns}, types=types))
    got, wanted = addon("files.ply").read_ply(path), read_ply(path)
    np.testing.assert_allclose(got.sh_coeffs, wanted.sh_coeffs, atol=1e-6)


def test_slopes_of_srgb_values_become_those_of_radiance_to_first_order(addon):
    """Oracle: the curve at the colours of places near the centre of each primitive."""
    splats = with_slopes(random_splats(30, seed=7, degree=0), every=1)
    model = as_model(addon, splats)
    linear, decoded = addon("files.light").made_linear(model), addon("files.srgb").decoded
    color = 0.5 + 0.28209479177387814 * splats.sh_coeffs[:, 0].astype(float)
    for axis in range(3):
        step = 1e-4
        ends = [decoded(color + sign * step * splats.color_slopes[:, axis]) for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(linear.color_slopes[:, axis], slope, rtol=1e-3, atol=1e-5)


def test_curvatures_of_srgb_values_become_those_of_radiance_to_first_order(addon):
    """Oracle: the curve at a brightness of all channels, whose mean is what one brightness can show of it."""
    splats = with_curvatures(random_splats(30, seed=7, degree=0), every=1)
    linear, decoded = addon("files.light").made_linear(as_model(addon, splats)), addon("files.srgb").decoded
    color, step = 0.5 + 0.28209479177387814 * splats.sh_coeffs[:, 0].astype(float), 1e-4
    for i, brighter in enumerate(splats.brightness_curvatures.T[..., None] * step):
        expected = (decoded(color + brighter) - decoded(color - brighter)).mean(axis=1) / (2 * step)
        np.testing.assert_allclose(linear.brightness_curvatures[:, i], expected, rtol=1e-3, atol=1e-5)
    assert addon("files.light").made_linear(as_model(addon, splats.without_slopes())).brightness_curvatures.size == 0


@pytest.mark.parametrize("degree", range(4))
def test_spherical_harmonics_and_their_projection_are_the_same(addon, degree):
    directions = np.random.default_rng(3).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    basis = addon("files.sh").sh_basis(directions, degree)
    np.testing.assert_allclose(basis, sh_basis_table(directions, degree), atol=1e-14)
    projection = addon("files.linear_map").sh_projection(SHEAR, degree)
    np.testing.assert_allclose(projection, sh_projection(SHEAR, degree), atol=1e-13)


def test_the_srgb_curve_is_the_same(addon):
    srgb, values = addon("files.srgb"), np.linspace(0, 3, 3001)
    np.testing.assert_allclose(srgb.encoded(values), linear_to_srgb(values), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(srgb.decoded(values), srgb_to_linear(values), rtol=1e-5, atol=1e-7)
    step = 1e-6
    slope = (srgb.decoded(values + step) - srgb.decoded(values - step)) / (2 * step)
    np.testing.assert_allclose(srgb.decoded_slope(values), slope, rtol=1e-3)


def test_opacities_of_zero_and_one_are_read_as_the_same(addon, tmp_path):
    """Logits of ±∞ in the file."""
    splats = ply_files.random_splats(dog_index=range(7))
    splats.logit_opacities[:2] = splats.dog_logit_opacities[:2] = np.inf, -np.inf
    columns = ply_files.vertex_columns(splats) | ply_files.dog_columns(splats)
    path = ply_files.write(tmp_path, ply_files.to_bytes({"vertex": columns}))
    read, expected = addon("files.ply").read_ply(path), read_ply(path)
    np.testing.assert_array_equal(read.logit_opacities, expected.logit_opacities)
    np.testing.assert_array_equal(read.dog_logit_opacities, expected.dog_logit_opacities)


def test_the_add_on_offers_the_presets_of_the_package():
    """Its list needs Blender to be imported, so it is read as text."""
    tree = ast.parse((ADDON / "training" / "settings.py").read_text(encoding="utf-8"))
    (items,) = (node.value for node in tree.body
                if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "PRESETS")  # fmt: skip
    assert [name for name, _, _ in ast.literal_eval(items)] == list(RECIPES)


@pytest.mark.parametrize(
    "file", ["images/a/b.JPG", "images_4/r_1.png", "images_left/0.png", "./r_0.5", "r_0.25.png", "c\\d.e.jpg", "", "/"]
)
def test_cameras_have_the_names_of_views(addon, file):
    assert addon("cameras.camera").camera_name(file) == view_name(file)


def test_a_run_has_the_cameras_that_it_has_refined(addon, tmp_path):
    given = load_dataset(transforms_folder(tmp_path / "data", folder="images/left"))
    moved = {view.name: view.camera.w2c.copy() for view in given.train}
    for w2c in moved.values():
        w2c[:3, 3] += 0.1, -0.2, 0.3
    write_refined(tmp_path / "run" / "refined", given, tmp_path / "data", moved)
    (tmp_path / "run" / "config.json").write_text(json.dumps({"data": "data"}))
    found = {camera.name: camera.w2c for camera in addon("cameras.read").read_cameras(tmp_path / "run", None)[0]}
    expected = {view.name: view.camera.w2c for view in load_dataset(tmp_path / "run" / "refined").views}
    assert found.keys() == expected.keys() and all(np.allclose(found[name], w2c) for name, w2c in expected.items())
    assert len(moved) == 2 and all(np.allclose(found[name], w2c) for name, w2c in moved.items())


def test_cameras_of_transforms_are_those_of_the_package(addon, tmp_path):
    content = json.loads((transforms_folder(tmp_path, fl_x=30, fl_y=31) / "transforms.json").read_text())
    content["frames"][1]["camera_angle_x"] = 0.7
    content["frames"][2]["fl_x"] = 40
    transforms_folder(tmp_path, frames=content["frames"], fl_x=30, fl_y=31, normal_mts_args=[])
    cameras, *_ = addon("cameras.read").read_cameras(tmp_path, lambda path: (WIDTH, HEIGHT))
    found = {camera.name: camera for camera in cameras}
    for view in load_dataset(tmp_path).views:
        camera = found[view.name]
        assert (camera.fx, camera.fy) == (view.camera.fx, view.camera.fy)
        np.testing.assert_allclose(camera.w2c, view.camera.w2c, atol=1e-12)


@pytest.mark.parametrize(
    "drawing",
    [
        Drawing(),
        Drawing(True, 0.05, False, "-y", 2.0),
        Drawing(False, 1 / 3, True, "0.02,-0.95,0.31", 0.1, 2.5),
        Drawing(linear=True, up="z", white=1e-7),
    ],
)
def test_comments_are_those_of_the_package(addon, drawing):
    """Whoever writes them, the other one finds what was said, to the last bit."""
    comments = comments_of(drawing)
    said = addon("files.said").said_in(comments)
    assert said.comments == comments and drawing_of(said.comments) == drawing
