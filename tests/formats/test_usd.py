"""OpenUSD: the schema as its library has it, stages of other programs, what moves, is hidden, or is damaged."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

import os
import resource
import struct
import zipfile

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.formats import limits, usd, usd_author, usd_read
from mi_dogsplat.formats.packing import RUB, turned, unit_quats
from mi_dogsplat.formats.read import read_source, size_of
from mi_dogsplat.formats.upright import upright
from mi_dogsplat.scene.orientation import up_vector
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.errors import DataError
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation, UsdVol, Vt
from scipy.spatial.transform import Rotation

MODEL = foreign_model.model()
PRIM = "/Model/Splats"
ROWS = ("means", "log_scales", "logit_opacities", "sh_coeffs")


def assert_same(read, expected, atol=1e-5):
    for name in ROWS:
        np.testing.assert_allclose(getattr(read, name), getattr(expected, name), rtol=0, atol=atol)
    np.testing.assert_allclose(covariances(read), covariances(expected), rtol=1e-4, atol=1e-5)


def covariances(splats) -> np.ndarray:
    """[N, 3, 3]: axes of one Gaussian may point to either side."""
    axes = Rotation.from_quat(splats.quats).as_matrix() * np.exp(splats.log_scales.astype(np.float64))[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "a.usda"
    write_model(path, Model(MODEL))
    return path


@pytest.fixture
def stage(file):
    return Usd.Stage.Open(str(file))


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
    np.testing.assert_allclose([*first.GetImaginary(), first.GetReal()], unit_quats(ours)[0], atol=1e-6)
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
        turn = Gf.Matrix3d(Gf.Quatd(*unit_quats(ours)[k][[3, 0, 1, 2]].tolist()))  # of the library, for rows
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
    assert (abs((unit_quats(read) * unit_quats(MODEL)).sum(axis=1)) > 1 - 1e-5).all()


def test_what_a_prim_does_not_say_is_what_the_schema_takes(stage):
    prim = stage.GetPrimAtPath(PRIM)
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetName() != "positions":
            prim.RemoveProperty(attribute.GetName())
    read = read_saved(stage)
    assert read.splats.sh_degree == 0 and (read.splats.sh_coeffs == 0).all()  # which is grey
    assert (read.splats.log_scales == 0).all() and (read.splats.opacities > 0.9999).all()
    assert (unit_quats(read.splats)[:, 3] == 1).all()
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
    with pytest.raises(DataError, match="set.usda: holds linear and display-referred primitives; export"):
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
    assert read.left_out == ("what changes with time: the first moment is taken",)


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
    changes = "what changes with time: the first moment is taken"
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


# --- what cannot be read or written ---


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('upAxis = "Y"', 'upAxis = "X"', "its upAxis is X, neither Y nor Z"),
        ("metersPerUnit = 1", "metersPerUnit = 0", "its metersPerUnit is 0, not above zero and finite"),
        (
            "point3f[] positions = [",
            "float[] positions = [1, 2]\nfloat3[] other = [",
            "positions has no rows of 3 numbers",
        ),
    ],
)
def test_what_makes_no_sense_is_one_line(file, old, new, said):
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(DataError, match=f"a.usda: .*{said}"):
        read_model(file)


def test_a_stage_without_gaussians_says_what_it_lacks_and_why(tmp_path, file):
    stage = a_stage(tmp_path / "set.usda")
    UsdGeom.Sphere.Define(stage, "/Ball")
    with pytest.raises(DataError, match="set.usda: holds no prim ParticleField3DGaussianSplat that is shown; export"):
        read_saved(stage)
    place = referencing(stage, "/Set", file)
    place.MakeInvisible()
    with pytest.raises(DataError, match=r"that is shown \(1 prim not shown\); export"):
        read_saved(stage)


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_files_that_end_early_are_one_line(tmp_path, suffix, capfd):
    path = tmp_path / f"a{suffix}"
    write_model(path, Model(MODEL))
    data = path.read_bytes()
    for size in (12, 100, len(data) // 2, len(data) - 20):
        path.write_bytes(data[:size])
        with pytest.raises(DataError, match=f"a{suffix}: (cannot be read|is no).*the file is damaged"):
            read_model(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("place", [b"Splats", b"positions", b"upAxis"])
def test_text_that_is_none_is_one_line(tmp_path, file, place):
    file.write_bytes(file.read_bytes().replace(place, b"\xff\xfe" + place))
    with pytest.raises(DataError, match="a.usda: .*the file is damaged"):
        read_model(file)


def crate_of(path) -> tuple[bytearray, dict[str, int]]:
    """The bytes of a binary file, and where its sections begin."""
    data = bytearray(path.read_bytes())
    (table,) = struct.unpack_from("<q", data, 16)
    (n,) = struct.unpack_from("<Q", data, table)
    rows = [struct.unpack_from("<16sqq", data, table + 8 + 32 * k) for k in range(n)]
    return data, {name.rstrip(b"\0").decode(): start for name, start, _ in rows} | {"TABLE": table}


@pytest.mark.parametrize("suffix", [".usdc", ".usdz"])
@pytest.mark.parametrize("section", ["TOKENS", "FIELDS", "FIELDSETS", "PATHS", "SPECS"])
def test_counts_out_of_proportion_are_refused_before_the_library_believes_them(tmp_path, section, suffix):
    """One byte of these took the library minutes and gigabytes."""
    write_model(tmp_path / "a.usdc", Model(MODEL))
    write_model(tmp_path / f"b{suffix}", Model(MODEL))
    data, starts = crate_of(tmp_path / "a.usdc")
    raw = bytearray((tmp_path / f"b{suffix}").read_bytes())
    first = raw.index(data[:24])  # of the binary file in the package
    raw[first + starts[section] + 3] = 0xFF  # the fourth byte of the count: 4 thousand million
    (tmp_path / f"b{suffix}").write_bytes(raw)
    with pytest.raises(DataError, match="claim to unpack to .*the file is damaged"):
        read_model(tmp_path / f"b{suffix}")


def test_lists_and_sections_that_end_outside_of_the_file_are_refused(tmp_path):
    write_model(tmp_path / "a.usdc", Model(MODEL))
    data, starts = crate_of(tmp_path / "a.usdc")
    for at, said in (
        (starts["SPECS"] + 8, "a list of its section SPECS is longer than that"),
        (starts["TABLE"] + 8 + 16, "its section TOKENS is at bytes"),
        (16, "it names byte"),
        (starts["TABLE"], "sections"),
    ):
        broken = bytearray(data)
        broken[at : at + 8] = (1 << 40).to_bytes(8, "little")
        (tmp_path / "b.usdc").write_bytes(broken)
        with pytest.raises(DataError, match=f"b.usdc: is no binary OpenUSD .*{said}"):
            read_model(tmp_path / "b.usdc")


def test_a_package_whose_files_are_compressed_is_refused(tmp_path):
    write_model(tmp_path / "a.usdc", Model(MODEL))
    with zipfile.ZipFile(tmp_path / "a.usdz", "w", zipfile.ZIP_DEFLATED) as package:
        package.write(tmp_path / "a.usdc", "a.usdc")
    with pytest.raises(DataError, match="a.usdz: is no package of OpenUSD .*compressed"):
        read_model(tmp_path / "a.usdz")


def test_a_name_that_says_something_else_is_no_obstacle(tmp_path, capfd):
    for suffix in (".usda", ".usdc", ".usdz"):
        write_model(tmp_path / f"a{suffix}", Model(MODEL))
        for name in ("b.usda", "b.usdc", "b.usdz", "b.glb"):
            (tmp_path / name).write_bytes((tmp_path / f"a{suffix}").read_bytes())
            assert_same(read_model(tmp_path / name).splats, MODEL)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["ä b.usda", "a[1].usdc", "a.b@c.usdz", "%04d:SDF_FORMAT_ARGS:x=1.usdc"])
def test_names_are_only_names(tmp_path, name):
    write_model(tmp_path / name, Model(MODEL))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert_same(read_model(tmp_path / name).splats, MODEL)


def test_names_of_folders_are_only_names(tmp_path, monkeypatch):
    folder = tmp_path / "a.usdz[b]:SDF_FORMAT_ARGS:x=1"
    folder.mkdir()
    monkeypatch.chdir(folder)
    write_model("a.usdc", Model(MODEL))
    assert_same(read_model("a.usdc").splats, MODEL)


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_a_file_that_is_written_anew_is_read_anew_while_others_have_it_open(tmp_path, suffix):
    """The library keeps layers by their names; a notebook keeps the stage of an error."""
    stages = []
    for k in (1, 2):
        write_model(tmp_path / f"a{suffix}", Model(MODEL.select(np.arange(k))))
        os.utime(tmp_path / f"a{suffix}", (k, k))  # file systems tell times apart that differ by some ms
        assert read_model(tmp_path / f"a{suffix}").splats.n_splats == k
        stages.append(Usd.Stage.Open(str(tmp_path / f"a{suffix}")))


def test_a_stage_that_its_user_has_not_saved_keeps_what_is_new(stage):
    stage.DefinePrim("/New")
    assert read_model(stage.GetRootLayer().realPath).splats.n_splats == MODEL.n_splats
    assert stage.GetPrimAtPath("/New")


def test_a_file_is_not_beside_itself_where_its_folder_is_a_link(tmp_path, file):
    (tmp_path / "link").symlink_to(tmp_path)
    assert size_of(tmp_path / "link" / "a.usda") == file.stat().st_size


def test_without_the_library_nothing_is_written_and_one_line_says_what_to_install(tmp_path, file, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pxr", None)
    needed = r"OpenUSD needs the package usd-core; pip install 'mi_dogsplat\[usd\]'"
    with pytest.raises(DataError, match=f"b.usdz: {needed}"):
        write_model(tmp_path / "b.usdz", Model(MODEL))
    with pytest.raises(DataError, match=f"a.usda: {needed}"):
        read_model(file)
    assert [path.name for path in tmp_path.iterdir()] == ["a.usda"]


def test_a_folder_that_is_missing_or_full_keeps_what_was_there(tmp_path, file, monkeypatch):
    with pytest.raises(DataError, match="no/a.usdc: cannot be written"):
        write_model(tmp_path / "no" / "a.usdc", Model(MODEL))
    held = file.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(usd_author.shutil, "move", full)
    with pytest.raises(DataError, match="a.usda: .*No space left"):
        write_model(file, Model(MODEL.select(np.arange(3))))
    assert file.read_bytes() == held and [path.name for path in tmp_path.iterdir()] == ["a.usda"]


@pytest.mark.parametrize(("suffix", "more"), [(".usda", 0), (".usdc", -50), (".usdz", -50), (".usdz", 50)])
def test_what_the_library_cannot_write_is_one_line(tmp_path, capfd, suffix, more):
    """As where a disk is full; at the end the package, and not what lies in it."""
    write_model(tmp_path / "a.usdc", Model(MODEL))
    most = (tmp_path / "a.usdc").stat().st_size + more
    limits_before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, limits_before[1]))
    try:
        with pytest.raises(DataError, match=f"b{suffix}: cannot be written .*(too large|not complete)"):
            write_model(tmp_path / f"b{suffix}", Model(MODEL))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits_before)
    assert [path.name for path in tmp_path.iterdir()] == ["a.usdc"] and capfd.readouterr() == ("", "")
