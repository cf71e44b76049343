"""Files of meshes, read back by Mitsuba, by the library of OpenUSD, by the reader of glTF and by hand."""

# pyright: reportAttributeAccessIssue=false
# (the library of OpenUSD has no types)

import io
import os

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.cli.commands.mesh import NAMES as NAMES_IN_HELP
from mi_dogsplat.formats.gltf_container import Container, matrix_of
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.usd_files import NAMES
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.meshing.mesh import Mesh, Texture
from mi_dogsplat.meshing.mesh_files import WRITERS, writer_of
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import linear_to_srgb
from PIL import Image
from pxr import Ar, Usd, UsdGeom, UsdShade, UsdValidation
from splat_scenes import make_splats, rounded

VERTICES = np.array([[0, 0, 0], [1.5, 0, 0], [0, 2.25, 0], [0, 0, -1e-3]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
COLORS = np.array([[1, 0, 0], [0, 0.5, 1], [0.2, 0.4, 0.6], [0, 0, 0]])


OF_MITSUBA = (".ply", ".obj")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", OF_MITSUBA)
@pytest.mark.parametrize("colors", [COLORS, None])
def test_mitsuba_reads_what_was_written(suffix, colors, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    writer_of(path)(path, Mesh(VERTICES, FACES, colors), Drawing())
    mesh = mi.load_dict({"type": suffix[1:], "filename": str(path)})
    assert isinstance(mesh, mi.Mesh)
    params = mi.traverse(mesh)
    positions = np.array(params["vertex_positions"]).reshape(-1, 3)
    faces = np.array(params["faces"]).reshape(-1, 3)
    np.testing.assert_allclose(positions[faces], VERTICES[FACES], rtol=1e-6)
    if suffix == ".ply" and colors is not None:
        np.testing.assert_array_equal(np.array(params["vertex_color"]).reshape(-1, 3), np.rint(255 * COLORS))


def test_an_obj_has_colours_behind_its_positions(tmp_path):
    path = tmp_path / "mesh.OBJ"
    writer_of(path)(path, Mesh(VERTICES, FACES, COLORS), Drawing())
    lines = path.read_text().splitlines()
    assert lines[1] == "v 1.5 0 0 0 0.5 1" and lines[4] == "f 1 3 2" and len(lines) == 8


def test_another_name_is_one_line(tmp_path):
    with pytest.raises(DataError, match=r"mesh.stl: no known mesh format; name a file that ends in .ply, .obj, .glb"):
        writer_of(tmp_path / "mesh.stl")


def test_the_help_of_the_command_names_all_formats():
    """By itself, as it is shown without what writes them."""
    assert set(NAMES_IN_HELP) == set(WRITERS)


@pytest.mark.parametrize("suffix", OF_MITSUBA)
def test_positions_are_as_exact_as_float32_has_them(suffix, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    vertices = np.array([[1e6, 1e6 + 0.0625, -(1e6 + 0.125)], [5e5 + 1 / 32, 0, 0], [0, 0.1, 1 / 3]], np.float32)
    writer_of(path)(path, Mesh(vertices, np.array([[0, 1, 2]])), Drawing())
    params = mi.traverse(mi.load_dict({"type": suffix[1:], "filename": str(path)}))
    positions = np.array(params["vertex_positions"]).reshape(-1, 3)[np.array(params["faces"])]
    np.testing.assert_array_equal(positions, vertices)


def read_gltf(path) -> tuple[Container, dict, dict[str, np.ndarray], np.ndarray]:
    """(file, its one primitive, attributes, positions [N, 3] in its scene)."""
    file = Container.open(path)
    (node,), (mesh,) = file.content["nodes"], file.content["meshes"]
    (primitive,) = mesh["primitives"]
    found = {name: file.accessor(number) for name, number in primitive["attributes"].items()}
    points = np.concatenate([found["POSITION"], np.ones((len(found["POSITION"]), 1))], axis=1) @ matrix_of(node).T
    return file, primitive, found, points[:, :3]


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".GLB"])
@pytest.mark.parametrize("colors", [COLORS, None])
def test_gltf_has_it_upright_and_in_metres(suffix, colors, tmp_path):
    """As OpenUSD, below, and where the glTF of the model is. No light of the scene falls on its colours."""
    path, drawing = tmp_path / f"mesh{suffix}", Drawing(up="z", scale=2.0)
    writer_of(path)(path, Mesh(VERTICES, FACES, colors), drawing)
    file, primitive, found, points = read_gltf(path)
    write_model(tmp_path / "splats.glb", Model(rounded(make_splats(VERTICES, 0.1, 0.5, np.eye(4)[:, :3])), drawing))
    np.testing.assert_allclose(points, read_gltf(tmp_path / "splats.glb")[3], atol=1e-6)
    x, y, z = VERTICES.T
    np.testing.assert_allclose(points, 2 * np.stack([-x, z, y], axis=1), atol=1e-6)  # z is ahead in glTF
    (material,) = file.content["materials"]
    assert file.accessor(primitive["indices"]).reshape(-1, 3).tolist() == FACES.tolist()
    assert primitive.get("mode", 4) == 4 and material["doubleSided"]  # triangles
    assert [*material["extensions"]] == file.content["extensionsUsed"] == ["KHR_materials_unlit"]
    bounds = file.content["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_array_equal([bounds["min"], bounds["max"]], [f(found["POSITION"], 0) for f in (np.min, np.max)])
    assert ("COLOR_0" in found) == (colors is not None)
    if colors is not None:
        np.testing.assert_allclose(linear_to_srgb(found["COLOR_0"]), COLORS, atol=1e-6)


UV = np.array([[0.125, 0.25], [0.875, 0.25], [0.125, 0.75], [0.5, 0.5]])
QUARTERS = np.kron([[[0.8, 0.2, 0.2], [0.2, 0.8, 0.2]], [[0.2, 0.2, 0.8], [0.8, 0.8, 0.2]]], np.ones((32, 32, 1)))
PAINTED = Mesh(VERTICES, FACES, texture=Texture(UV, QUARTERS))


def test_mitsuba_shows_the_texture_of_an_obj_where_it_lies(tmp_path):
    """Mitsuba does not read the .mtl: a scene names the picture itself."""
    path = tmp_path / "a mesh.obj"
    writer_of(path, texture=True)(path, PAINTED, Drawing())
    picture = tmp_path / "a mesh_texture.jpg"
    said = (tmp_path / "a mesh.mtl").read_text().splitlines()
    assert f"map_Kd {picture.name}" in said and f"newmtl {path.read_text().split('usemtl ')[1].split()[0]}" in said
    assert path.read_text().startswith("mtllib a mesh.mtl\n")
    mesh = mi.load_dict({"type": "obj", "filename": str(path)})
    how = {"raw": True, "filter_type": "nearest", "accel": False}  # the stand-in for CUDA has no textures of its own
    texture = mi.load_dict({"type": "bitmap", "filename": str(picture), **how})
    params, found = mi.traverse(mesh), dr.zeros(mi.SurfaceInteraction3f, 4)
    positions = np.array(params["vertex_positions"]).reshape(-1, 3)
    found.uv = mi.Point2f(np.array(params["vertex_texcoords"]).reshape(-1, 2).T)
    shown = np.array(texture.eval(found)).T
    for position, color in zip(positions, shown, strict=True):
        u, v = UV[abs(VERTICES - position).sum(axis=1).argmin()]
        np.testing.assert_allclose(color, QUARTERS[int(64 * v), int(64 * u)], atol=0.02)


def test_a_texture_is_found_whatever_its_name(tmp_path):
    name = os.fsdecode(b"caf\xe9")  # no UTF-8
    path = tmp_path / f"{name}.obj"
    writer_of(path, texture=True)(path, PAINTED, Drawing())
    assert path.read_bytes().startswith(b"mtllib caf\xe9.mtl\n")
    assert (tmp_path / f"{name}.mtl").read_bytes().endswith(b"map_Kd caf\xe9_texture.jpg\n")
    assert (tmp_path / f"{name}_texture.jpg").is_file()


@pytest.mark.parametrize(
    ("suffix", "beside"), [(".obj", ".mtl"), (".obj", "_texture.jpg"), (".usd", "_usd_texture.jpg")]
)
def test_a_texture_takes_the_place_of_nothing_but_an_earlier_one(suffix, beside, tmp_path):
    path, other = tmp_path / f"mesh{suffix}", tmp_path / f"mesh{beside}"
    for _ in range(2):
        writer_of(path, texture=True)(path, PAINTED, Drawing())
    other.write_bytes(b"# by hand\n")
    with pytest.raises(DataError, match=f"mesh{beside}: is there, is no texture of an earlier mesh, and would be lost"):
        writer_of(path, texture=True)
    writer_of(path)(path, Mesh(VERTICES, FACES), Drawing())  # nothing is written beside it
    writer_of(tmp_path / "mesh.usdz", texture=True)
    assert other.read_bytes() == b"# by hand\n"


def test_meshes_of_one_name_in_several_formats_keep_their_textures(tmp_path):
    other = Mesh(VERTICES, FACES, texture=Texture(UV, 1 - QUARTERS))
    for suffix, mesh in ((".obj", PAINTED), (".usda", other), (".usdc", PAINTED)):
        before = {file: file.read_bytes() for file in tmp_path.iterdir()}
        path = tmp_path / f"mesh{suffix}"
        writer_of(path, texture=True)(path, mesh, Drawing())
        assert {file: file.read_bytes() for file in before} == before


@pytest.mark.parametrize("suffix", [".obj", ".usda"])
def test_without_the_mesh_nothing_of_its_texture_is_left(suffix, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    path.mkdir()
    with pytest.raises(DataError, match=f"mesh{suffix}"):
        writer_of(path, texture=True)(path, PAINTED, Drawing())
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_gltf_holds_its_texture(suffix, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    writer_of(path, texture=True)(path, PAINTED, Drawing())
    file, _, found, _ = read_gltf(path)
    np.testing.assert_allclose(found["TEXCOORD_0"], UV, atol=1e-7)  # glTF, too, counts down from the top
    assert "COLOR_0" not in found and [entry.name for entry in tmp_path.iterdir()] == [path.name]
    content = file.content
    shown = content["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    image = content["images"][content["textures"][shown["index"]]["source"]]
    picture = Image.open(io.BytesIO(file.view(image["bufferView"])))
    assert picture.format == "JPEG" and image["mimeType"] == "image/jpeg"
    np.testing.assert_allclose(np.asarray(picture) / 255, QUARTERS, atol=0.02)
    assert all(view["byteOffset"] % 4 == 0 for view in content["bufferViews"])


@pytest.mark.parametrize("suffix", NAMES)
def test_openusd_shows_its_texture_without_light(suffix, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    writer_of(path, texture=True)(path, PAINTED, Drawing())
    picture_name = f"mesh_{suffix[1:]}_texture.jpg"
    beside = [] if suffix == ".usdz" else [picture_name]
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted([path.name, *beside])
    stage = Usd.Stage.Open(str(path))
    (prim,) = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    uv = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
    np.testing.assert_allclose(np.array(uv.Get()), np.stack([UV[:, 0], 1 - UV[:, 1]], axis=1), atol=1e-7)
    assert uv.GetInterpolation() == "vertex" and not UsdGeom.Mesh(prim).GetDisplayColorPrimvar().HasValue()
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    surface, _, _ = material.ComputeSurfaceSource()
    texture = UsdShade.Shader(surface.GetInput("emissiveColor").GetConnectedSources()[0][0].source)
    assert texture.GetIdAttr().Get() == "UsdUVTexture"
    named = texture.GetInput("file").Get()
    assert named.path == f"./{picture_name}"
    with Image.open(io.BytesIO(Ar.GetResolver().OpenAsset(Ar.ResolvedPath(named.resolvedPath)).GetBuffer())) as picture:
        np.testing.assert_allclose(np.asarray(picture) / 255, QUARTERS, atol=0.02)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert [error.GetMessage() for error in UsdValidation.ValidationContext(validators).Validate(stage)] == []


def test_ply_has_no_texture(tmp_path):
    said = r"mesh.ply: has no place for a texture; name a file that ends in .obj, .glb"
    with pytest.raises(DataError, match=said):
        writer_of(tmp_path / "mesh.ply", texture=True)


@pytest.mark.parametrize("suffix", NAMES)
@pytest.mark.parametrize("colors", [COLORS, None])
def test_openusd_has_it_upright_and_in_metres(suffix, colors, tmp_path):
    """The model has z up, and a unit of two metres."""
    path = tmp_path / f"mesh{suffix}"
    writer_of(path)(path, Mesh(VERTICES, FACES, colors), Drawing(up="z", scale=2.0))
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    (prim,) = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    mesh, rows = UsdGeom.Mesh(prim), np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    points = np.concatenate([np.array(mesh.GetPointsAttr().Get()), np.ones((4, 1))], axis=1) @ rows
    x, y, z = VERTICES.T
    np.testing.assert_allclose(points[:, :3], 2 * np.stack([x, z, -y], axis=1), atol=1e-6)
    assert np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3).tolist() == FACES.tolist()
    assert list(mesh.GetFaceVertexCountsAttr().Get()) == [3] * 4
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none" and mesh.GetOrientationAttr().Get() == "rightHanded"
    shown = mesh.GetDisplayColorPrimvar()
    if colors is None:
        assert not shown.HasValue()
    else:
        np.testing.assert_allclose(linear_to_srgb(np.array(shown.Get())), COLORS, atol=1e-6)
        assert shown.GetInterpolation() == "vertex"
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert [error.GetMessage() for error in UsdValidation.ValidationContext(validators).Validate(stage)] == []
