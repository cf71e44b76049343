"""``dogsplat info --features``: each thing is listed as needed just where it is, with what it costs in the kernels."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from cut_models import with_cuts, with_second_cuts
from launches import launches, loop
from mi_dogsplat import write_ply
from mi_dogsplat.cli import main
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.engine.geometry import Blocks
from mi_dogsplat.engine.kernel_costs import aov_operations, pair_operations, primitive_operations
from mi_dogsplat.engine.options import Settings
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.inspection.describe_features import describe_features
from mi_dogsplat.inspection.features import model_features, scene_features
from mi_dogsplat.scene.row_groups import OWN_AXES
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.presets import GIVEN
from shifted_models import with_shifts
from sloped_models import with_curvatures, with_slopes
from splat_scenes import dog_dict, make_camera, random_splats, rounded, scene_of, square_camera

OF_AXES = {"slopes", "curvatures", "cuts", "second cuts"}
MODEL = {"Gaussians", "DoG", "negative T"} | OF_AXES | {"shifts"} | {f"SH degree {d}" for d in (1, 2, 3)}
RENDER = {"background", "antialiasing", "depth", "other AOVs", "derivatives"}


def model(degree=1, dog_share=0.0) -> Splats:
    return rounded(random_splats(40, degree=degree, dog_share=dog_share))


def read(lines: list[str]) -> dict[str, tuple[str, str]]:
    """State and reason of each feature."""
    rows = [line for line in lines if line.startswith("  ")]
    return {row[:28].strip(): tuple(row[28:].split(": ", 1)) for row in rows}  # pyright: ignore[reportReturnType]


def states(features) -> dict[str, str]:
    return {f.name: f.state for f in features}


def needed(features) -> set[str]:
    return {f.name for f in features if f.state == "needed"}


# --- models ---


def test_a_plain_model_leaves_out_what_it_has_not(tmp_path):
    write_ply(tmp_path / "m.ply", model())
    lines = describe_features(tmp_path / "m.ply")
    assert lines[0] == f"{tmp_path / 'm.ply'}: what it needs and what is left out"
    assert f"  {'DoG':26}left out: 0 of 40 primitives" in lines
    found = read(lines)
    assert set(found) == MODEL | RENDER
    assert {name for name, (state, _) in found.items() if state == "needed"} == {"Gaussians", "SH degree 1"}
    assert found["Gaussians"][1].startswith("40 primitives; each 14 parameters, 56 bytes, ")
    assert found["SH degree 1"][1].startswith("each 9 parameters, 36 bytes, ")
    assert "operations are instructions" in lines[-1]


def test_the_parameters_add_up_to_those_of_the_model():
    sloped = with_curvatures(with_slopes(model(degree=3, dog_share=0.5), every=3), every=4)
    splats = with_shifts(with_second_cuts(with_cuts(sloped), every=5), every=7)
    each = {f.name: int(f.reason.split("each ")[1].split()[0]) for f in model_features([splats]) if "each" in f.reason}
    m = each.pop("DoG") * splats.n_dog
    m += each.pop("slopes") * splats.n_slopes + each.pop("cuts") * splats.n_cuts
    m += each.pop("second cuts") * splats.n_second_cuts + each.pop("curvatures") * splats.n_curvatures
    m += each.pop("shifts") * splats.n_shifts
    arrays = [getattr(splats, name) for name in vars(splats) if not name.endswith("_index")]
    assert sum(each.values()) * splats.n_splats + m == sum(array.size for array in arrays)


def test_dog_is_needed_by_the_primitives_that_are():
    splats = model(dog_share=0.5)
    splats.logit_opacities[:], splats.dog_logit_opacities[:] = 2, 2
    found = read([str(f) for f in model_features([splats])])
    assert found["DoG"][0] == "needed" and found["DoG"][1].startswith(f"{splats.n_dog} of 40 primitives; each 4 ")
    assert found["negative T"][0] == "needed" and "faded DoG" not in found
    assert found["branch to DoG"][1].startswith(f"{40 - splats.n_dog} plain primitives")
    assert "branch to DoG" not in read([str(f) for f in model_features([splats.only_dog()])])
    splats.dog_logit_opacities[:3] = -9
    assert read([str(f) for f in model_features([splats])])["faded DoG"] == (
        "paid, not needed", "3 pseudo-Gaussians below 1/255 everywhere"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "with_rows", "size", "zeros"),
    [
        ("slopes", with_slopes, "9 parameters, 40 bytes", "slopes"),
        ("cuts", with_cuts, "3 parameters, 16 bytes", "normals"),
        ("second cuts", with_second_cuts, "3 parameters, 16 bytes", "normals"),
        ("curvatures", with_curvatures, "6 parameters, 28 bytes", "curvatures"),
    ],
)
def test_slopes_and_cuts_are_needed_by_the_primitives_that_have_them(name, with_rows, size, zeros):
    splats = with_rows(model(dog_share=0.5), every=4)
    found = read([str(f) for f in model_features([splats, model()])])
    assert found[name][0] == "needed"
    assert found[name][1].startswith(f"10 of 80 primitives; each {size}, ")
    operations = [int(word) for word in found[name][1].replace(" +", "").split() if word.isdecimal()]
    assert all(number > 0 for number in operations) and "per pixel" in found[name][1]
    rest = found[f"{name} of others"]
    assert rest[0] == "paid, not needed" and rest[1].startswith(f"70 primitives without, drawn with {zeros} of zero")
    every = read([str(f) for f in model_features([with_rows(model(), every=1)])])
    assert every[name][0] == "needed" and f"{name} of others" not in every
    values = [name for group in OWN_AXES for name in group.names]
    zeros = dataclasses.replace(splats, **{value: 0 * getattr(splats, value) for value in values})
    unneeded = read([str(f) for f in model_features([zeros])])[f"{name} that are zero"]
    assert unneeded == ("paid, not needed", f"10, {10 * int(size.split()[2])} bytes; dogsplat clean takes them out")


def test_shifts_are_needed_by_the_primitives_that_have_them_and_cost_pixels_nothing():
    splats = with_shifts(model(dog_share=0.5), every=4)
    state, reason = read([str(f) for f in model_features([splats, model()])])["shifts"]
    assert state == "needed" and "per pixel" not in reason
    said = r"10 of 80 primitives; each 12 parameters, 52 bytes, (\d+) operations; and 4 bytes for its row in each of 80"
    cost = re.fullmatch(said, reason)
    assert cost and 30 < int(cost[1]) < 200
    splats.view_shifts[:3] = 0
    unneeded = read([str(f) for f in model_features([splats])])["shifts that are zero"]
    assert unneeded == ("paid, not needed", "3, 156 bytes; dogsplat clean takes them out")


def test_degrees_whose_coefficients_are_all_zero_are_paid_without_need():
    splats = model(degree=3)
    splats.sh_coeffs[:, 4:] = 0
    found = states(model_features([splats]))
    assert found["SH degree 1"] == "needed"
    assert found["SH degree 2"] == found["SH degree 3"] == "paid, not needed"


def test_a_degree_that_some_primitives_have_is_needed_by_these():
    splats = model(degree=3).with_sh_degrees(np.repeat([0, 1, 3], [10, 20, 10]))
    found = read([str(f) for f in model_features([splats])])
    assert found["SH degree 1"][1].startswith("30 of 40 primitives; each 9 parameters")
    assert found["SH degree 3"][0] == "needed" and found["SH degree 3"][1].startswith("10 of 40 primitives; ")
    splats.sh3_coeffs[:, 8:] = 0
    assert states(model_features([splats]))["SH degree 3"] == "paid, not needed"


def test_a_model_without_primitives_is_described_too(tmp_path):
    write_ply(tmp_path / "m.ply", Splats.empty(0))
    assert "left out: 0 of 0 primitives" in "\n".join(describe_features(tmp_path / "m.ply"))


# --- costs ---


def test_the_operations_per_pixel_are_those_of_the_compositor(monkeypatch):
    """An image's kernel has so many more for each primitive that it takes at once, and others besides."""
    options, blocks = RasterOptions(0), Blocks.of_backend()
    params, camera = upload(model(0)), DeviceCamera.upload(make_camera())

    def in_kernel(unroll: int) -> int:
        monkeypatch.setattr(Blocks, "of_backend", lambda: dataclasses.replace(blocks, unroll=unroll, adapts=False))
        return loop(launches(lambda: rasterize(params, camera, options).T.numpy())).operations

    forward, backward = pair_operations(Settings(3), False, mi.variant())
    two, four = in_kernel(2), in_kernel(4)
    per_primitive = forward * blocks.width * blocks.height
    assert four - two == pytest.approx(2 * per_primitive, rel=0.01) and 4 * per_primitive < four
    assert forward < backward


def test_each_choice_adds_operations():
    variant = mi.variant()
    plain = np.array(pair_operations(Settings(3), False, variant))
    dog = np.array(pair_operations(Settings(3), True, variant))
    depth = np.array(pair_operations(Settings(4), False, variant))
    assert (plain < depth).all() and (depth < dog).all()
    cut = [np.array(pair_operations(Settings(3, cuts=planes), True, variant)) for planes in (0, 1, 2)]
    assert (cut[0] < cut[1]).all() and (cut[1] < cut[2]).all()
    index, two = (aov_operations(names, False, variant) for names in (("index",), ("index", "count")))
    assert 0 < index < two < aov_operations(("index", "count"), True, variant)
    costs = [primitive_operations(RasterOptions(degree), False, variant) for degree in range(4)]
    assert costs == sorted(set(costs))
    assert primitive_operations(RasterOptions(0, antialiased=True), False, variant) > costs[0]
    assert primitive_operations(RasterOptions(0), True, variant) > costs[0]
    assert primitive_operations(RasterOptions(0), False, variant, True) > costs[0]
    assert (np.array(pair_operations(Settings(3, slopes=True), False, variant)) > plain).all()


# --- scenes ---

BARE: dict[str, Any] = {"srgb_primitives": False}


@pytest.mark.parametrize(
    ("choice", "feature"),
    [
        ({"srgb_primitives": True}, "sRGB conversion"),
        ({"antialiased": True}, "antialiasing"),
        ({"aovs": "depth"}, "depth"),
        ({"aovs": "normal"}, "normal"),
        ({"aovs": "index"}, "second walk"),
        ({"aovs": "median_depth,count,dog_share"}, "second walk"),
        ({"aovs": "alpha"}, "alpha"),
        ({"film": {"pixel_format": "rgba"}}, "alpha"),
        ({"extra": {"sky": {"type": "constant"}}}, "background"),
        ({"extra": {"more": dog_dict(model(0))}}, "several dog shapes"),
    ],
    ids=str,
)
def test_each_choice_of_a_scene_is_one_line(choice, feature):
    bare = needed(scene_features(scene_of(model(), square_camera(), **BARE)))
    assert bare == {"Gaussians", "SH degree 1"}
    assert needed(scene_features(scene_of(model(), square_camera(), **{**BARE, **choice}))) == bare | {feature}


def test_negative_transmittance_is_needed_unless_a_scene_forbids_it():
    for allowed in (True, False):
        features = scene_features(scene_of(model(dog_share=0.5), square_camera(), negative_transmittance=allowed))
        assert ("negative T" in needed(features)) == allowed


def test_a_shape_of_lower_sh_degree_is_padded():
    features = scene_features(scene_of(model(2), square_camera(), extra={"more": dog_dict(model(1))}))
    reason = next(f.reason for f in features if f.name == "several dog shapes")
    assert "40 of them padded to SH degree 2" in reason and f"{4 * (11 + 27)} bytes" in reason


def scene_file(folder: Path, integrator: str, shape: str) -> Path:
    path = folder / "s.xml"
    path.write_text(
        f'<scene version="3.0.0"><integrator type="{integrator}"/>{shape}<sensor type="perspective">'
        '<film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film></sensor>'
        "</scene>"
    )
    return path


def test_a_scene_of_dog_shapes_is_told_from_one_that_is_a_data_set(tmp_path):
    write_ply(tmp_path / "m.ply", model())
    splats = scene_file(tmp_path, "dogsplat", '<shape type="dog"><string name="filename" value="m.ply"/></shape>')
    assert MODEL < set(read(describe_features(splats)))
    path_traced = '<shape type="dog"><string name="filename" value="m.ply"/></shape><shape type="sphere"/>'
    state, reason = read(describe_features(scene_file(tmp_path, "dogpath", path_traced)))["surfaces"]
    assert state == "needed" and reason.startswith("1 other shapes") and "light paths" in reason
    surfaces = scene_file(tmp_path, "path", '<shape type="sphere"/><emitter type="constant"/>')
    assert "alpha masks" in read(describe_features(surfaces))


# --- data sets and runs ---


@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("points", [False, True])
def test_a_data_set_needs_what_its_images_and_points_ask_for(tmp_path, alpha, points):
    found = read(describe_features(tiny_data.write_tiny_data(tmp_path, n=3, alpha=alpha, points=points)))
    expected = {"alpha masks": alpha, "background": alpha, "random start": not points, "test renders": True}
    expected["several image sizes"] = False
    assert {name: state for name, (state, _) in found.items()} == {
        name: "needed" if is_needed else "left out" for name, is_needed in expected.items()
    }


def write_run(folder: Path, with_model=True, **config) -> Path:
    (folder / "config.json").write_text(json.dumps({"data": "photos", "preset": "ours", "model": None, **config}))
    if with_model:
        write_ply(folder / "point_cloud.ply", model())
    return folder


def test_a_run_needs_what_its_model_and_its_recipe_ask_for(tmp_path):
    found = read(describe_features(write_run(tmp_path, background="black", sh_degree=1)))
    assert found["SH degree 1"][0] == found["training DoG"][0] == found["pruning"][0] == "needed"
    assert found["training DoG"][1] == "from 60% of the run on, left out before"
    assert found["background"] == ("left out", "black") and found["antialiasing"][0] == "left out"


@pytest.mark.parametrize(("model", "part"), [(None, "62%"), ("m.ply", "23%")])
def test_preconditioned_steps_come_after_training_dog_in_a_run_from_a_model_too(tmp_path, model, part):
    write_run(tmp_path, False, background="black", preset="ours_preconditioned", model=model)
    assert read(describe_features(tmp_path))["preconditioned steps"][1] == f"from {part} of the run on, left out before"


def test_a_file_that_holds_no_dog_needs_no_training_of_them(tmp_path):
    write_run(tmp_path, False, background="black", format="sog")
    assert read(describe_features(tmp_path))["training DoG"] == ("left out", "not in the recipe")


def test_preconditioned_steps_of_a_setting_are_told_of_methods_of_a_comparison_too(tmp_path):
    write_run(tmp_path, False, preset="paper", background="black", preconditioned=True)
    assert read(describe_features(tmp_path))["preconditioned steps"][1] == "from 85% of the run on, left out before"
    recipe = dataclasses.asdict(METHODS["v3"].recipe)
    (tmp_path / "recipe.json").write_text(json.dumps({"label": "V3", "recipe": recipe}))
    assert read(describe_features(tmp_path))["preconditioned steps"][0] == "needed"


def test_a_run_of_a_comparison_needs_what_the_recipe_of_its_method_asks_for(tmp_path):
    write_run(tmp_path, False, preset="paper", background="black", sh_degree=1)
    recipe = dataclasses.asdict(METHODS["v3"].recipe)
    (tmp_path / "recipe.json").write_text(json.dumps({"label": "V3", "recipe": recipe}))
    found = read(describe_features(tmp_path))
    assert (found["pruning"][0], found["training DoG"][0]) == ("needed", "left out")


@pytest.mark.parametrize("known", [(), ("slopes",), ("slopes", "cuts")])
def test_a_recipe_of_an_earlier_version_knows_nothing_of_rows_that_came_later(tmp_path, known):
    write_run(tmp_path, False, preset="paper", background="black")
    recipe = dataclasses.asdict(METHODS["ours_cuts"].recipe)
    recipe = {name: rule for name, rule in recipe.items() if name not in GIVEN or name in known}
    (tmp_path / "recipe.json").write_text(json.dumps({"label": "cuts", "recipe": recipe}))
    found = read(describe_features(tmp_path))
    for name in GIVEN:
        said = found[f"training {name.replace('_', ' ')}"]
        assert said[0] == ("needed" if name in known else "left out")
        assert said[1] == ("from 60% of the run on, left out before" if name in known else "not in the recipe")


@pytest.mark.parametrize(
    ("changed", "wrong"),
    [
        ({"reference_steps": 0}, "reference_steps"),
        ({"sh_every": "often"}, "sh_every"),
        ({"densification": {"start": 500}}, "densification"),
        ({"pruning": 3}, "pruning"),
        ({"dog": {"start": None}}, "dog"),
        ({"second_cuts": {"start": "soon"}}, "second_cuts"),
        ({"preconditioning": []}, "preconditioning"),
        (None, "recipe"),
    ],
)
def test_a_damaged_recipe_is_one_line(tmp_path, changed, wrong):
    write_run(tmp_path, False, preset="paper", background="black")
    recipe = 5 if changed is None else dataclasses.asdict(METHODS["paper"].recipe) | changed
    (tmp_path / "recipe.json").write_text(json.dumps({"label": "V3", "recipe": recipe}))
    with pytest.raises(DataError, match=rf'recipe\.json: "{wrong}" is not what .* writes; restore or delete it'):
        describe_features(tmp_path)


def test_a_format_that_the_preset_of_a_run_cannot_have_is_one_line(tmp_path):
    write_run(tmp_path, False, background="black", preset="ours_cuts", format="sog")
    with pytest.raises(DataError, match=r"config\.json.*restore or delete it"):
        describe_features(tmp_path)


@pytest.mark.parametrize(
    ("config", "feature", "state"),
    [
        ({"preset": "3dgs"}, "pruning", "left out"),
        ({"preset": "3dgs"}, "training DoG", "left out"),
        ({"preset": "ours_slopes"}, "training slopes", "needed"),
        ({"preset": "ours_cuts"}, "training cuts", "needed"),
        ({"preset": "ours_second_cuts"}, "training second cuts", "needed"),
        ({"preset": "ours_curvatures"}, "training curvatures", "needed"),
        ({"preset": "ours_preconditioned"}, "preconditioned steps", "needed"),
        ({"preconditioned": True}, "preconditioned steps", "needed"),
        ({"model": "m.ply"}, "densification", "left out"),
        ({"sh_degree": 0}, "SH degree in turn", "left out"),
        ({"background": "white"}, "background", "needed"),
        ({"antialiased": True}, "antialiasing", "needed"),
    ],
)
def test_each_setting_of_a_run_changes_its_line(tmp_path, config, feature, state):
    defaults = {"background": "black", "antialiased": False, "sh_degree": 3}
    write_run(tmp_path, False, **defaults)
    assert read(describe_features(tmp_path))[feature][0] != state
    write_run(tmp_path, False, **{**defaults, **config})
    found = read(describe_features(tmp_path))
    assert found[feature][0] == state and "Gaussians" not in found


# --- the command, and what is wrong ---


def test_the_command_prints_the_list(tmp_path, capsys):
    write_ply(tmp_path / "m.ply", model())
    assert main(["info", "--features", str(tmp_path / "m.ply")]) == 0
    assert capsys.readouterr().out.splitlines() == describe_features(tmp_path / "m.ply")


def test_what_cannot_be_listed_is_one_line(tmp_path):
    (tmp_path / "s.xml").write_text("<scene")
    (tmp_path / "notes.txt").write_text("hello")
    write_run(tmp_path, preset="best")
    for path, words in (
        (tmp_path / "s.xml", "Mitsuba cannot load it"),
        (tmp_path / "notes.txt", "a run folder, or a data set"),
        (tmp_path / "missing.ply", "no such file"),
        (tmp_path, 'preset "best" is unknown'),
    ):
        with pytest.raises(DataError, match=words) as caught:
            describe_features(path)
        assert "\n" not in str(caught.value)


def test_what_no_picture_shows_is_named_with_its_number_and_bytes(tmp_path):
    splats = model(degree=2, dog_share=0.5)
    splats.logit_opacities[:] = 1
    splats.logit_opacities[:7] = -9
    splats.dog_logit_opacities[-3:] = -40
    splats.sh_coeffs[10:20, 4:] = 0
    write_ply(tmp_path / "m.ply", splats)
    found = read(describe_features(tmp_path / "m.ply"))
    assert found["invisible primitives"] == ("paid, not needed", "7, 1.06 kB; dogsplat clean takes them out")
    assert found["DoG without effect"] == ("paid, not needed", "3, 60 bytes; dogsplat clean takes them out")
    state, reason = found["SH degree 2"]
    assert state == "needed" and "zero in 10 primitives, 600 bytes: dogsplat clean --mixed-sh" in reason
    assert "zero" not in found["SH degree 1"][1]
    splats.sh_coeffs[10:18, 4:] = 1
    write_ply(tmp_path / "m.ply", splats)
    state, reason = read(describe_features(tmp_path / "m.ply"))["SH degree 2"]
    assert state == "needed" and "zero in 2 primitives, 120 bytes, less than SH degrees of their own take" in reason


def test_a_mixed_model_uses_the_degrees_of_its_groups():
    degrees = np.arange(40) % 3
    features = {f.name: f for f in model_features([model(degree=2).with_sh_degrees(degrees)])}
    assert [features[f"SH degree {d}"].state for d in (1, 2, 3)] == ["needed", "needed", "left out"]
    assert "zero" not in features["SH degree 1"].reason
