"""What the add-on has a copy of, as it runs without the package: both give the same numbers.

Its ``__init__.py`` needs Blender; its files of numbers need the language of its messages alone, and are imported
past it.
"""

import ast
import importlib
import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from cut_models import kept_shares
from dataset_folders import transforms_folder
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import view_name
from mi_dogsplat.datasets.refined import write_refined
from mi_dogsplat.scene.drawing import Drawing, comments_of, drawing_of
from mi_dogsplat.scene.linear_map import sh_projection
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.scene.sh_basis import sh_basis_table
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.srgb import linear_to_srgb, srgb_to_linear
from mi_dogsplat.training.presets import RECIPES
from own_axes_models import CURVED, EACH_KIND, KINDS, SLOPED, for_each_kind
from places import points_in
from sloped_models import curvature_brightness, slope_colors, with_curvatures, with_slopes
from splat_scenes import axis_rotation, random_splats, rounded

ADDON = Path(__file__).parents[2] / "blender_addon"
ROTATION = axis_rotation([1, -2, 0.7], 2.1)[0]
SHEAR = np.array([[1.2, 0.5, 0], [0, 0.7, -0.3], [0.1, 0, 2.0]])
MAPS = {"turn": 1.7 * ROTATION, "mirror": -0.4 * ROTATION, "shear": SHEAR, "stretch": np.diag([1.0, 1.2, 3.0])}


@pytest.fixture(scope="module")
def addon():
    """``addon("files.sh")`` is that module."""
    package = ModuleType("blender_addon")
    package.__path__ = [str(ADDON)]
    language: Any = ModuleType("bpy.app.translations")  # all that files know of Blender: here English
    language.pgettext_iface = language.pgettext_rpt = lambda text, context=None: text
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "blender_addon", package)
        for module in (ModuleType("bpy"), ModuleType("bpy.app"), language):
            patch.setitem(sys.modules, module.__name__, module)
        yield lambda name: importlib.import_module(f"blender_addon.{name}")
        for name in [name for name in sys.modules if name.startswith("blender_addon.")]:
            del sys.modules[name]


def as_model(addon, splats):
    """The same primitives as the add-on has them: a row of each kind for each, quaternions w, x, y, z."""
    n, dog = splats.n_splats, splats.dog_index
    is_dog, logits, scales = np.zeros(n, bool), np.zeros(n, np.float32), np.zeros((n, 3), np.float32)
    is_dog[dog], logits[dog], scales[dog] = True, splats.dog_logit_opacities, splats.dog_log_scales
    values = splats.means, splats.log_scales, splats.quats[:, [3, 0, 1, 2]], splats.logit_opacities, splats.sh_coeffs
    rows: dict[str, np.ndarray] = {}
    for kind in KINDS:
        index, (has, name) = kind.index(splats), of_addon(kind)
        first, *rest = kind.shape
        rows |= {has: np.zeros(n, bool), name: np.zeros((n, first * bool(len(index)), *rest), np.float32)}
        if len(index):
            rows[has][index], rows[name][index] = True, kind.values(splats)
    return addon("files.model").Model(*values, is_dog, logits, scales, **rows)


def of_addon(kind) -> tuple[str, str]:
    """Names of the two arrays of a kind in a model of the add-on."""
    return f"has_{kind.word}", kind.name


def with_kernels_of(splats, model):
    """Primitives with kernels, slopes, curvatures and cuts as the add-on has them."""
    changed = {"means": model.means, "log_scales": model.log_scales, "quats": model.quats[:, [1, 2, 3, 0]]}
    for kind in KINDS:
        which, values = (getattr(model, name) for name in of_addon(kind))
        if which.any():
            changed |= {kind.group.index: np.flatnonzero(which), kind.name: values[which]}
    return replace(splats, **changed)


@pytest.mark.parametrize("name", MAPS)
def test_a_transform_makes_the_same_of_a_model(addon, name):
    """Similarities, and maps that are none (``linear_map.py`` of both)."""
    matrix, splats = np.eye(4), rounded(random_splats(40, seed=7))
    matrix[:3, :3], matrix[:3, 3] = MAPS[name], (0.4, -0.3, 0.2)
    expected = transformed(splats, matrix)
    got = addon("files.transform").transformed(as_model(addon, splats), matrix)
    wanted = as_model(addon, expected)
    for field in ("means", "log_scales", "sh_coeffs", "dog_logit_opacities"):
        np.testing.assert_allclose(getattr(got, field), getattr(wanted, field), rtol=1e-5, atol=2e-6, err_msg=field)
    dog = wanted.is_dog
    np.testing.assert_allclose(got.dog_log_scales[dog], wanted.dog_log_scales[dog], rtol=1e-5, atol=2e-6)
    both = (model.quats / np.linalg.norm(model.quats, axis=1, keepdims=True) for model in (got, wanted))
    np.testing.assert_allclose(np.abs(np.einsum("nk,nk->n", *both)), 1, atol=1e-5)  # q and -q are one rotation


@EACH_KIND
@pytest.mark.parametrize("name", MAPS)
def test_a_moved_primitive_shows_the_same_at_the_same_places(addon, name, kind):
    """By what places show, as axes may be named in another order."""
    matrix, splats = np.eye(4), kind.having(random_splats(40, seed=7), every=3)
    added = {SLOPED.word: slope_colors, CURVED.word: curvature_brightness}
    shown = added.get(kind.word) or partial(kept_shares, plane=kind.group)
    matrix[:3, :3], matrix[:3, 3] = MAPS[name], (0.4, -0.3, 0.2)
    moved = addon("files.transform").transformed(as_model(addon, splats), matrix)
    points = points_in(splats, kind.index(splats))
    expected = shown(splats, points)
    assert expected.std() > 0.2
    got = shown(with_kernels_of(splats, moved), points @ matrix[:3, :3].T + matrix[:3, 3])
    np.testing.assert_allclose(got, expected, atol=2e-4)
    has, name = of_addon(kind)
    assert getattr(moved, has).sum() == 14
    plain = addon("files.transform").transformed(as_model(addon, splats.without_slopes().without_cuts()), matrix)
    assert getattr(plain, name).shape[:2] == (40, 0)


@pytest.mark.parametrize("every", [1, 3, 100])
@EACH_KIND
def test_a_file_comes_back_byte_for_byte(addon, tmp_path, every, kind):
    splats, ply = kind.having(random_splats(40, seed=7), every, first=2), addon("files.ply")
    kind.values(splats)[0] = 0  # a row is a row
    write_ply(tmp_path / "a.ply", splats)
    model = ply.read_ply(tmp_path / "a.ply")
    wanted = as_model(addon, splats)
    for field in (name for each in KINDS for name in of_addon(each)):
        np.testing.assert_array_equal(getattr(model, field), getattr(wanted, field), err_msg=field)
    require_same_file(ply, tmp_path, model, splats)
    chosen = np.arange(39, 0, -2)
    require_same_file(ply, tmp_path, model.select(chosen), splats.select(chosen))


def test_a_file_with_all_kinds_comes_back_byte_for_byte(addon, tmp_path):
    splats, ply = random_splats(40, seed=7), addon("files.ply")
    for kind, every in zip(KINDS, (3, 4, 2, 5), strict=True):
        splats = kind.having(splats, every)
    write_ply(tmp_path / "a.ply", splats)
    model = ply.read_ply(tmp_path / "a.ply")
    assert (model.has_slopes & model.has_cuts).sum() == 7 and (model.has_cuts & model.has_second_cuts).sum() == 4
    assert (model.has_slopes & model.has_curvatures).sum() == 4
    require_same_file(ply, tmp_path, model, splats)


def require_same_file(ply, folder, model, splats):
    """The add-on writes what the package does."""
    ply.write_ply(folder / "addon.ply", model)
    write_ply(folder / "package.ply", splats)
    assert (folder / "addon.ply").read_bytes() == (folder / "package.ply").read_bytes()


@EACH_KIND
def test_a_model_without_rows_joins_one_that_has_some(addon, kind):
    some, none = kind.having(random_splats(9, seed=1), every=2), rounded(random_splats(5, seed=2))
    join, index, names = addon("files.model").concatenate, kind.index(some), of_addon(kind)
    for models, at in (((none, some), index + 5), ((some, none), index)):
        joined = join([as_model(addon, splats) for splats in models])
        has, values = (getattr(joined, name) for name in names)
        np.testing.assert_array_equal(np.flatnonzero(has), at)
        np.testing.assert_array_equal(values[at], kind.values(some))
        assert not values[~has].any()
    assert getattr(join([as_model(addon, none)] * 2), kind.name).shape[:2] == (10, 0)


@for_each_kind("column", slopes="slope_8", curvatures="curvature_5", cuts="cut_2")
def test_rows_that_are_wrong_in_a_file_are_one_line(addon, tmp_path, kind, column):
    splats = kind.having(random_splats(9, seed=1), every=2)
    write_ply(tmp_path / "a.ply", splats)
    whole = (tmp_path / "a.ply").read_bytes()
    row = 4 + 4 * int(np.prod(kind.shape))  # bytes
    twice = whole[:-row] + whole[-2 * row : 4 - 2 * row] + whole[4 - row :]
    unknown = whole.replace(column.encode(), b"x" * len(column))
    infinite = whole[:-4] + np.float32(np.inf).tobytes()
    for content, words in ((twice, f'element "{kind.word}" does not name different'),
                           (unknown, f'element "{kind.word}" has no property "{column}"; copy or export'),
                           (infinite, f'"{column}" in row 4 of the element "{kind.word}" is not')):  # fmt: skip
        (tmp_path / "b.ply").write_bytes(content)
        with pytest.raises(ValueError) as error:
            addon("files.ply").read_ply(tmp_path / "b.ply")
        assert words in str(error.value) and "\n" not in str(error.value)
    model = as_model(addon, splats)
    getattr(model, kind.name)[2, 1] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        addon("files.ply").write_ply(tmp_path / "c.ply", model)


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


def test_the_add_on_offers_the_presets_of_the_package():
    """Its list needs Blender to be imported, so it is read as text."""
    tree = ast.parse((ADDON / "training" / "settings.py").read_text(encoding="utf-8"))
    (items,) = (node.value for node in tree.body
                if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "PRESETS")  # fmt: skip
    assert [name for name, _, _ in ast.literal_eval(items)] == list(RECIPES)


@pytest.mark.parametrize("file", ["images/a/b.JPG", "images_4/r_1.png", "./r_0.5", "r_0.25.png", "c\\d.e.jpg", "", "/"])
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
