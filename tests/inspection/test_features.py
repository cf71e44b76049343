"""``dogsplat info --features``: each thing is listed as needed just where it is, with what it costs in the kernels."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from cut_models import with_cuts, with_second_cuts
from described import stated
from launches import launches, loop
from mi_dogsplat import write_ply
from mi_dogsplat.cli import main
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks
from mi_dogsplat.engine.kernel_costs import aov_operations, pair_operations, primitive_operations
from mi_dogsplat.engine.options import Settings
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.inspection.describe_features import describe_features
from mi_dogsplat.inspection.features import model_features, scene_features, splat_scene
from mi_dogsplat.scene.row_groups import DOG, OWN_AXES, SLOPES
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from shifted_models import with_shifts
from sloped_models import with_curvatures, with_slopes
from splat_scenes import dog_dict, make_camera, random_splats, rounded, scene_of, square_camera

OF_AXES = {"slopes", "curvatures", "cuts", "second cuts"}
MODEL = {"Gaussians", "DoG", "negative T"} | OF_AXES | {"shifts"} | {f"SH degree {d}" for d in (1, 2, 3)}
RENDER = {"background", "antialiasing", "depth", "other AOVs", "derivatives"}


def model(degree=1, dog_share=0.0) -> Splats:
    return rounded(random_splats(40, degree=degree, dog_share=dog_share))


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
    found = stated(lines)
    assert set(found) == MODEL | RENDER
    assert {name for name, (state, _) in found.items() if state == "needed"} == {"Gaussians", "SH degree 1"}
    assert found["Gaussians"][1].startswith("40 primitives; each 14 parameters, 56 bytes, ")
    assert found["SH degree 1"][1].startswith("each 9 parameters, 36 bytes, ")
    assert "operations are instructions" in lines[-1]


@pytest.mark.slow
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
    found = stated([str(f) for f in model_features([splats])])
    assert found["DoG"][0] == "needed" and found["DoG"][1].startswith(f"{splats.n_dog} of 40 primitives; each 4 ")
    assert found["negative T"][0] == "needed" and "faded DoG" not in found
    assert found["branch to DoG"][1].startswith(f"{40 - splats.n_dog} plain primitives")
    assert "branch to DoG" not in stated([str(f) for f in model_features([splats.only_dog()])])
    splats.dog_logit_opacities[:3] = -9
    assert stated([str(f) for f in model_features([splats])])["faded DoG"] == (
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
    found = stated([str(f) for f in model_features([splats, model()])])
    assert found[name][0] == "needed"
    assert found[name][1].startswith(f"10 of 80 primitives; each {size}, ")
    operations = [int(word) for word in found[name][1].replace(" +", "").split() if word.isdecimal()]
    assert all(number > 0 for number in operations) and "per pixel" in found[name][1]
    rest = found[f"{name} of others"]
    assert rest[0] == "paid, not needed" and rest[1].startswith(f"70 primitives without, drawn with {zeros} of zero")
    every = stated([str(f) for f in model_features([with_rows(model(), every=1)])])
    assert every[name][0] == "needed" and f"{name} of others" not in every
    values = [name for group in OWN_AXES for name in group.names]
    zeros = dataclasses.replace(splats, **{value: 0 * getattr(splats, value) for value in values})
    unneeded = stated([str(f) for f in model_features([zeros])])[f"{name} that are zero"]
    assert unneeded == ("paid, not needed", f"10, {10 * int(size.split()[2])} bytes; dogsplat clean takes them out")


def test_shifts_are_needed_by_the_primitives_that_have_them_and_cost_pixels_nothing():
    splats = with_shifts(model(dog_share=0.5), every=4)
    state, reason = stated([str(f) for f in model_features([splats, model()])])["shifts"]
    assert state == "needed" and "per pixel" not in reason
    said = r"10 of 80 primitives; each 12 parameters, 52 bytes, (\d+) operations; and 4 bytes for its row in each of 80"
    cost = re.fullmatch(said, reason)
    assert cost and 30 < int(cost[1]) < 200
    alone = stated([str(f) for f in model_features([splats.select(np.array([0]))])])["shifts"]
    assert alone[1].startswith("1 of 1 primitive; ")
    splats.view_shifts[:3] = 0
    unneeded = stated([str(f) for f in model_features([splats])])["shifts that are zero"]
    assert unneeded == ("paid, not needed", "3, 156 bytes; dogsplat clean takes them out")


def test_degrees_whose_coefficients_are_all_zero_are_paid_without_need():
    splats = model(degree=3)
    splats.sh_coeffs[:, 4:] = 0
    found = states(model_features([splats]))
    assert found["SH degree 1"] == "needed"
    assert found["SH degree 2"] == found["SH degree 3"] == "paid, not needed"


def test_a_degree_that_some_primitives_have_is_needed_by_these():
    splats = model(degree=3).with_sh_degrees(np.repeat([0, 1, 3], [10, 20, 10]))
    found = stated([str(f) for f in model_features([splats])])
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


@pytest.mark.slow
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
    costs = [primitive_operations(RasterOptions(degree), variant) for degree in range(4)]
    assert costs == sorted(set(costs))
    assert primitive_operations(RasterOptions(0, antialiased=True), variant) > costs[0]
    assert all(primitive_operations(RasterOptions(0), variant, group) > costs[0] for group in (DOG, SLOPES))
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
    assert MODEL < set(stated(describe_features(splats)))
    path_traced = '<shape type="dog"><string name="filename" value="m.ply"/></shape><shape type="sphere"/>'
    state, reason = stated(describe_features(scene_file(tmp_path, "dogpath", path_traced)))["surfaces"]
    assert state == "needed" and reason.startswith("1 other shape;") and "light paths" in reason
    surfaces = scene_file(tmp_path, "path", '<shape type="sphere"/><emitter type="constant"/>')
    assert "alpha masks" in stated(describe_features(surfaces))
    for integrator, ours in (("dogpath", True), ("path", False)):
        assert (splat_scene(scene_file(tmp_path, integrator, path_traced)) is not None) == ours


# --- the command, and what is wrong ---


def test_the_command_prints_the_list(tmp_path, capsys):
    write_ply(tmp_path / "m.ply", model())
    assert main(["info", "--features", str(tmp_path / "m.ply")]) == 0
    assert capsys.readouterr().out.splitlines() == describe_features(tmp_path / "m.ply")


def test_what_cannot_be_listed_is_one_line(tmp_path):
    (tmp_path / "s.xml").write_text("<scene")
    (tmp_path / "notes.txt").write_text("hello")
    for path, words in (
        (tmp_path / "s.xml", "Mitsuba cannot load it"),
        (tmp_path / "notes.txt", "a run folder, or a data set"),
        (tmp_path / "missing.ply", "no such file"),
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
    found = stated(describe_features(tmp_path / "m.ply"))
    assert found["invisible primitives"] == ("paid, not needed", "7, 1.06 kB; dogsplat clean takes them out")
    assert found["DoG without effect"] == ("paid, not needed", "3, 60 bytes; dogsplat clean takes them out")
    state, reason = found["SH degree 2"]
    assert state == "needed" and "zero in 10 primitives, 600 bytes: dogsplat clean --mixed-sh" in reason
    assert "zero" not in found["SH degree 1"][1]
    splats.sh_coeffs[10:18, 4:] = 1
    write_ply(tmp_path / "m.ply", splats)
    state, reason = stated(describe_features(tmp_path / "m.ply"))["SH degree 2"]
    assert state == "needed" and "zero in 2 primitives, 120 bytes, less than SH degrees of their own take" in reason


def test_a_mixed_model_uses_the_degrees_of_its_groups():
    degrees = np.arange(40) % 3
    features = {f.name: f for f in model_features([model(degree=2).with_sh_degrees(degrees)])}
    assert [features[f"SH degree {d}"].state for d in (1, 2, 3)] == ["needed", "needed", "left out"]
    assert "zero" not in features["SH degree 1"].reason
