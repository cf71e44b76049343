"""OpenUSD: the schema as its library has it, stages of other programs, what moves and what is hidden."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

import zipfile

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.formats import limits, usd, usd_read
from mi_dogsplat.formats.packing import RUB, turned
from mi_dogsplat.formats.read import read_source, size_of
from mi_dogsplat.formats.upright import upright
from mi_dogsplat.scene.orientation import up_vector
from mi_dogsplat.scene.quaternions import unit_quaternions
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.errors import DataError
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation, UsdVol, Vt
from usd_stages import MODEL, PRIM, ROWS, a_stage, assert_same, read_saved, referencing, written


@pytest.fixture
def file(tmp_path):
    return written(tmp_path)


@pytest.fixture
def stage(file):
    return Usd.Stage.Open(str(file))


# --- what is written ---


def test_the_library_finds_its_schema_and_nothing_against_it(file):
    stage = Usd.Stage.Open(str(file))
    splats = UsdVol.ParticleField3DGaussianSplat(stage.GetPrimAtPath(PRIM))
    ours = turned(MODEL, RUB)
    np.testing.assert_array_equal(splats.GetPositionsAttr().Get(), ours.means)
    np.testing.assert_allclose(splats.GetScalesAttr().Get(), np.exp(ours.log_scales), rtol=1e-6)
    np.testing.assert_allclose(splats.GetOpacitiesAttr().Get(), ours.opacities, rtol=1e-6)
    assert splats.GetRadianceSphericalHarmonicsDegreeAttr().Get() == 2
    coefficients = np.array(splats.GetRadianceSphericalHarmonicsCoefficientsAttr().Get())
    np.testing.assert_array_equal(coefficients.reshape(-1, 9, 3), ours.sh_coeffs)
    first = splats.GetOrientationsAttr().Get()[0]
    np.testing.assert_allclose([*first.GetImaginary(), first.GetReal()], unit_quaternions(ours.quats)[0], atol=1e-6)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = [error.GetMessage() for error in UsdValidation.ValidationContext(validators).Validate(stage)]
    assert len(validators) > 10 and found == []


def test_its_box_holds_all_primitives_and_is_no_larger(file):
    stage = Usd.Stage.Open(str(file))
    low, high = np.array(stage.GetPrimAtPath(PRIM).GetAttribute("extent").Get())
    ours = turned(MODEL, RUB)
    rng = np.random.default_rng(0)
    around = rng.normal(size=(20_000, 3))
    around *= 3 / np.linalg.norm(around, axis=1, keepdims=True)  # three standard deviations from the centre
    points = []
    for k in range(ours.n_splats):
        real_first = unit_quaternions(ours.quats)[k][[3, 0, 1, 2]].tolist()
        turn = Gf.Matrix3d(Gf.Quatd(*real_first))  # of the library, for rows
        points.append(ours.means[k] + around * np.exp(ours.log_scales[k]) @ np.array(turn))
    points = np.concatenate(points)
    assert (points.min(axis=0) >= low - 1e-5).all() and (points.max(axis=0) <= high + 1e-5).all()
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [low, high], atol=0.02)


@pytest.mark.parametrize(("up", "scale"), [("z", 0.3), ("0.36,-0.8,0.48", None), (None, 2.0), ("-y", 1.5)])
def test_a_model_is_upright_and_in_metres_and_comes_back_as_it_was(tmp_path, up, scale):
    drawing = Drawing(near_clip=0.1, up=up, scale=scale)
    write_model(tmp_path / "a.usdc", Model(MODEL, drawing))
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    place = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath(PRIM)))[:3, :3].T
    np.testing.assert_allclose(place @ np.diag(RUB[0]) @ up_vector(up or "-y"), (scale or 1) * np.eye(3)[1], atol=1e-9)
    again = read_model(tmp_path / "a.usdc")
    assert again.drawing.said() == drawing.said() | {"linear": False}
    np.testing.assert_array_equal(again.splats.means, MODEL.means)
    np.testing.assert_array_equal(again.splats.sh_coeffs, MODEL.sh_coeffs)


def test_equal_models_are_equal_files_whenever_they_are_written(tmp_path, monkeypatch):
    for suffix in (".usda", ".usdc", ".usdz"):
        contents = []
        for k, zone in enumerate(("UTC", "Asia/Tokyo")):
            monkeypatch.setenv("TZ", zone)
            write_model(tmp_path / f"{k}{suffix}", Model(MODEL))
            contents.append((tmp_path / f"{k}{suffix}").read_bytes())
        assert contents[0] == contents[1]
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".usda"] * 2 + [".usdc"] * 2 + [".usdz"] * 2


def test_a_package_is_one_as_its_specification_has_it(tmp_path):
    write_model(tmp_path / "a.usdz", Model(MODEL))
    with zipfile.ZipFile(tmp_path / "a.usdz") as package:
        (entry,) = package.infolist()
        assert entry.compress_type == zipfile.ZIP_STORED and entry.filename == "model.usdc"
        data = (tmp_path / "a.usdz").read_bytes()
        assert data.index(b"PXR-USDC") % 64 == 0


# --- what other programs write ---


def test_the_numbers_of_nvidias_converter_are_those_of_a_stage_with_y_up():
    read = read_model(foreign_model.FOLDER / "model.usda")
    assert_same(read.splats, turned(MODEL, RUB))  # it copies a PLY as it is, and says that y is up in it
    assert read.drawing == Drawing() and read.left_out == ()


def test_a_stage_that_references_a_file_has_it_where_it_puts_it(tmp_path, file):
    stage = a_stage(tmp_path / "set.usda")
    referencing(stage, "/Set/Room", file).AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    read = read_saved(stage)
    np.testing.assert_allclose(read.splats.means, MODEL.means + [1, -2, -3], atol=1e-5)
    assert read.drawing.said() == {"linear": False}


def test_what_a_moved_model_said_of_its_place_is_over(tmp_path):
    said = Model(MODEL, Drawing(near_clip=0.1, up="z", scale=2.0))
    write_model(tmp_path / "a.usdc", said)
    stage = a_stage(tmp_path / "set.usda")
    referencing(stage, "/Set", tmp_path / "a.usdc").AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    read = read_saved(stage)
    assert (read.drawing.up, read.drawing.scale, read.drawing.near_clip) == ("-y", 1.0, pytest.approx(0.2))
    np.testing.assert_allclose(read.splats.means, upright(said)[0].splats.means + [1, -2, -3], atol=1e-4)


def test_a_turn_leaves_lengths_as_they_were(tmp_path):
    write_model(tmp_path / "a.usdc", Model(MODEL, Drawing(near_clip=0.2)))
    stage = a_stage(tmp_path / "set.usda")
    turn = referencing(stage, "/Set", tmp_path / "a.usdc").AddRotateXYZOp()
    for angle in range(1, 20):  # the determinants of some are 1 exactly
        turn.Set(Gf.Vec3f(7 * angle, 3 * angle, 17 * angle))
        assert read_saved(stage).drawing.near_clip == 0.2


def test_a_library_that_does_not_know_the_schema_has_the_same_places(tmp_path, monkeypatch):
    """As that of Blender, which is older."""
    found = []
    for kind in (usd.TYPE, "ParticleFieldOfTheFuture"):
        monkeypatch.setattr(usd, "TYPE", kind)
        monkeypatch.setattr(usd_read, "TYPE", kind)
        write_model(tmp_path / f"{kind}.usda", Model(MODEL, Drawing(up="z", scale=0.3)))
        stage = a_stage(tmp_path / f"set_{kind}.usda")
        referencing(stage, "/Set", tmp_path / f"{kind}.usda").AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
        found.append(read_saved(stage))
    assert_same(found[1].splats, found[0].splats)
    assert found[1].drawing == found[0].drawing


@pytest.mark.parametrize("layered", [False, True])
def test_z_is_up_and_a_unit_is_a_centimetre_where_a_stage_says_so(tmp_path, file, layered):
    if layered:
        stage = a_stage(tmp_path / "set.usda", "Z", 0.01)
        referencing(stage, "/Set", file)
    else:
        stage = Usd.Stage.Open(str(file))
        UsdGeom.SetStageUpAxis(stage, "Z")
        UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    read = read_saved(stage)
    x, y, z = turned(MODEL, RUB).means.T  # of the prim
    np.testing.assert_allclose(read.splats.means, np.stack([x, -z, y], axis=1), atol=1e-5)  # right, down, forward
    quarter = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    assert_same(read.splats, transformed(turned(MODEL, RUB), quarter), atol=1e-4)
    assert read.drawing.said() == {"linear": False, "scale": 0.01}


def test_instances_and_several_prims_make_one_model(tmp_path, file):
    stage = a_stage(tmp_path / "set.usda")
    for k in range(3):
        place = referencing(stage, f"/Set/Room{k}", file)
        place.GetPrim().SetInstanceable(True)
        place.AddTranslateOp().Set(Gf.Vec3d(10 * k, 0, 0))
    read = read_saved(stage).splats
    expected = np.concatenate([MODEL.means + [10 * k, 0, 0] for k in range(3)])
    np.testing.assert_allclose(read.means, expected, atol=1e-5)


def test_models_that_are_repeated_claim_all_of_their_memory(tmp_path, file, monkeypatch):
    stage = a_stage(tmp_path / "set.usda")
    for k in range(4):
        referencing(stage, f"/Set/Room{k}", file)
    stage.Save()
    one = sum(getattr(MODEL, name).nbytes for name in (*ROWS, "quats"))
    monkeypatch.setattr(limits, "RATIO", 0)
    monkeypatch.setattr(limits, "FREE", 4 * one)
    assert read_model(tmp_path / "set.usda").splats.n_splats == 4 * MODEL.n_splats
    monkeypatch.setattr(limits, "FREE", 4 * one - 1)
    with pytest.raises(DataError, match="repeat more primitives"):
        read_model(tmp_path / "set.usda")


def test_a_layer_of_a_model_is_not_written_over_by_what_is_made_of_it(tmp_path, file):
    stage = a_stage(tmp_path / "set.usda")
    referencing(stage, "/Set", file)
    stage.Save()
    with pytest.raises(DataError, match="a.usda: is the model itself, or a part of it, which would be lost; name"):
        read_source(tmp_path / "set.usda", file, "clean")


def test_the_bytes_of_a_model_are_those_of_all_its_layers(tmp_path, file):
    stage = a_stage(tmp_path / "set.usda")
    referencing(stage, "/Set", file)
    stage.Save()
    both = file.stat().st_size + (tmp_path / "set.usda").stat().st_size
    assert size_of(tmp_path / "set.usda") == both
    write_model(tmp_path / "a.usdz", Model(MODEL))
    assert size_of(tmp_path / "a.usdz") == (tmp_path / "a.usdz").stat().st_size


def test_halves_are_read_and_floats_come_before_them(stage):
    prim, kinds = stage.GetPrimAtPath(PRIM), Sdf.ValueTypeNames
    halves = {"scalesh": kinds.Half3Array, "opacitiesh": kinds.HalfArray, "orientationsh": kinds.QuathArray}
    for name, kind in halves.items():
        whole = np.array(prim.GetAttribute(name[:-1]).Get())
        array = {"orientationsh": Vt.QuathArray, "opacitiesh": Vt.HalfArray}.get(name, Vt.Vec3hArray)
        prim.CreateAttribute(name, kind).Set(array.FromNumpy(whole.astype(np.float16)))
        prim.RemoveProperty(name[:-1])
    prim.CreateAttribute("positionsh", kinds.Point3hArray).Set(Vt.Vec3hArray([Gf.Vec3h(9)] * 12))
    read = read_saved(stage).splats
    np.testing.assert_array_equal(read.means, MODEL.means)
    np.testing.assert_allclose(read.log_scales, MODEL.log_scales, rtol=0, atol=2e-3)
    np.testing.assert_allclose(read.opacities, MODEL.opacities, rtol=1e-3)
    assert (abs((unit_quaternions(read.quats) * unit_quaternions(MODEL.quats)).sum(axis=1)) > 1 - 1e-5).all()


def test_what_a_prim_does_not_say_is_what_the_schema_takes(stage):
    prim = stage.GetPrimAtPath(PRIM)
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetName() != "positions":
            prim.RemoveProperty(attribute.GetName())
    read = read_saved(stage)
    assert read.splats.sh_degree == 0 and (read.splats.sh_coeffs == 0).all()  # which is grey
    assert (read.splats.log_scales == 0).all() and (read.splats.opacities > 0.9999).all()
    assert (unit_quaternions(read.splats.quats)[:, 3] == 1).all()
    assert read.left_out == () and read.drawing == Drawing()


def test_what_is_too_long_is_cut_off_and_what_is_too_short_is_left_out_and_said(stage):
    prim = stage.GetPrimAtPath(PRIM)
    scales = prim.GetAttribute("scales")
    scales.Set([*scales.Get(), Gf.Vec3f(7)])
    prim.GetAttribute("opacities").Set([0.5] * 11)
    prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(3)
    read = read_saved(stage)
    np.testing.assert_allclose(read.splats.log_scales, MODEL.log_scales, rtol=0, atol=1e-5)
    assert (read.splats.opacities > 0.9999).all() and read.splats.sh_degree == 0
    few = "radiance:sphericalHarmonicsCoefficients", "opacities"
    assert read.left_out == tuple(f"its {name}, which are too few" for name in few)


def test_scales_have_no_sides_and_degrees_above_three_are_left_out(stage):
    prim = stage.GetPrimAtPath(PRIM)
    scales = prim.GetAttribute("scales")
    scales.Set([Gf.Vec3f(-a, b, c) for a, b, c in scales.Get()])
    ours = turned(MODEL, RUB).sh_coeffs
    more = np.concatenate([ours, np.ones((12, 16, 3), np.float32)], axis=1)
    prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(4)
    prim.GetAttribute("radiance:sphericalHarmonicsCoefficients").Set(Vt.Vec3fArray.FromNumpy(more.reshape(-1, 3)))
    read = read_saved(stage)
    np.testing.assert_allclose(read.splats.log_scales, MODEL.log_scales, rtol=0, atol=1e-5)
    assert read.splats.sh_degree == 3
    np.testing.assert_array_equal(read.splats.sh_coeffs[:, :9], MODEL.sh_coeffs)
    assert read.left_out == ("its spherical harmonics above degree 3",)


def test_a_colour_space_says_whether_colours_are_linear(stage):
    prim = stage.GetPrimAtPath(PRIM)
    coefficients = prim.GetAttribute("radiance:sphericalHarmonicsCoefficients")
    for space, linear in (("lin_rec709_scene", True), ("srgb_rec709_scene", False), ("lin_ap1_scene", None)):
        coefficients.SetColorSpace(space)
        assert read_saved(stage).drawing.linear is linear


def test_linear_and_display_referred_prims_are_no_one_model(tmp_path, file):
    write_model(tmp_path / "b.usdc", Model(MODEL, Drawing(linear=True)))
    stage = a_stage(tmp_path / "set.usda")
    referencing(stage, "/Set/A", file)
    referencing(stage, "/Set/B", tmp_path / "b.usdc")
    with pytest.raises(DataError, match="set.usda: mixes linear and display-referred primitives; export"):
        read_saved(stage)


def test_what_no_picture_shows_is_left_out_and_said(tmp_path, file, capfd):
    stage = a_stage(tmp_path / "set.usda")
    for name in ("Shown", "Hidden", "Guide", "Off"):
        referencing(stage, f"/Set/{name}", file)
    UsdGeom.Imageable(stage.GetPrimAtPath("/Set/Hidden")).MakeInvisible()
    UsdGeom.Imageable(stage.GetPrimAtPath("/Set/Guide")).CreatePurposeAttr("guide")
    stage.GetPrimAtPath("/Set/Off").SetActive(False)
    instancer = UsdGeom.PointInstancer.Define(stage, "/Set/Many")
    referencing(stage, "/Set/Many/Prototype", file)
    instancer.CreatePrototypesRel().AddTarget("/Set/Many/Prototype")
    referencing(stage, "/Set/Gone", tmp_path / "gone.usda")
    capfd.readouterr()  # the library complains of the last line
    read = read_saved(stage)
    assert read.splats.n_splats == MODEL.n_splats
    *lines, gone = read.left_out
    assert lines == ["2 prims not shown", "Gaussians of 1 point instancer"]
    assert gone.startswith("what cannot be found or read: ") and "gone.usda" in gone
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("what", ["place", "numbers"])
def test_of_what_moves_the_first_moment_is_taken(stage, what):
    if what == "place":
        moved = UsdGeom.Xformable(stage.GetPrimAtPath("/Model")).AddTranslateOp()
        moved.Set(Gf.Vec3d(5, 0, 0), 10)
        moved.Set(Gf.Vec3d(1, 0, 0), 4)
    else:
        positions = stage.GetPrimAtPath(PRIM).GetAttribute("positions")
        held = np.array(positions.Get())
        positions.Set(Vt.Vec3fArray.FromNumpy(held + np.array([1, 0, 0], np.float32)), 4)
        positions.Set(Vt.Vec3fArray.FromNumpy(held + np.array([5, 0, 0], np.float32)), 10)
    read = read_saved(stage)
    np.testing.assert_allclose(read.splats.means, MODEL.means + [1, 0, 0], atol=1e-5)
    assert read.left_out == ("what changes with time: the first moment is used",)


def test_gaussians_of_an_instancer_may_lie_elsewhere(tmp_path, file):
    stage = a_stage(tmp_path / "set.usda")
    referencing(stage, "/Set", file)
    stage.CreateClassPrim("/Prototype").GetReferences().AddReference(str(file))
    UsdGeom.PointInstancer.Define(stage, "/Many").CreatePrototypesRel().AddTarget("/Prototype")
    UsdGeom.PointInstancer.Define(stage, "/None").CreatePrototypesRel().AddTarget("/Gone")
    read = read_saved(stage)
    assert read.splats.n_splats == MODEL.n_splats and read.left_out == ("Gaussians of 1 point instancer",)


def test_what_is_shown_at_times_is_what_is_shown_at_first_and_said(tmp_path, file):
    stage = a_stage(tmp_path / "set.usda")
    for name, first, then in (("A", "inherited", "invisible"), ("B", "invisible", "inherited")):
        shown = UsdGeom.Imageable(referencing(stage, f"/Set/{name}", file)).CreateVisibilityAttr()
        shown.Set(first, 1)
        shown.Set(then, 5)
    changes = "what changes with time: the first moment is used"
    read = read_saved(stage)
    assert read.splats.n_splats == MODEL.n_splats and read.left_out == ("1 prim not shown", changes)
    stage.GetPrimAtPath("/Set/A").SetActive(False)
    with pytest.raises(DataError, match=changes):
        read_saved(stage)


def test_a_degree_may_be_sampled_as_all_else_is(stage):
    prim = stage.GetPrimAtPath(PRIM)
    for attribute in prim.GetAuthoredAttributes():
        value = attribute.Get()
        attribute.Clear()
        attribute.Set(value, 1001)
    assert_same(read_saved(stage).splats, MODEL)
