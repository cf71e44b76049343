"""Passes of the render engine, as an OpenEXR file of Blender's has them."""

import json
import subprocess

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from model_files import load
from package_command import COMMAND, SECONDS
from references import REFERENCES, place_camera, reference
from surroundings import plane

from blender_addon import render_engine as engine
from blender_addon.engine.cryptomatte import float_of, murmur3
from blender_addon.engine.passes import OBJECT_INDEX, SETTINGS


def passes_of(scene, folder):
    """The same as ``layers_of`` without the name of the only layer."""
    seen, header = layers_of(scene, folder)
    return {name.split(".", 1)[-1]: values for name, values in seen.items()}, header


def layers_of(scene, folder):
    """({layer.channel: [H, W]}, header) of an OpenEXR file of Blender's with all passes, read by the other Python."""
    scene.render.engine = engine.ENGINE
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # Blender 5
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.render.filepath = str(folder / "passes.exr")
    bpy.ops.render.render(write_still=True)
    script = (
        "import json, sys, numpy as np, OpenEXR\n"
        "parts = OpenEXR.File(sys.argv[1], separate_channels=True).parts\n"
        "header = {k: v for p in parts for k, v in p.header.items() if isinstance(v, str)}\n"
        "np.savez(sys.argv[2], header=json.dumps(header), "
        "**{name: c.pixels for p in parts for name, c in p.channels.items()})"
    )
    command = [COMMAND[0], "-c", script, str(folder / "passes.exr"), str(folder / "passes.npz")]
    subprocess.run(command, check=True, timeout=SECONDS)
    seen = dict(np.load(folder / "passes.npz"))
    return seen, json.loads(str(seen.pop("header")))


def test_passes_of_splats_alone(scene, by_command, tmp_path):
    """Depth and alpha are those of the integrator."""
    place_camera(scene, "square")  # Blender 5.0 writes no such file of pixels that are not square
    load(REFERENCES / "square.ply")
    scene.view_layers[0].use_pass_z = True
    scene.render.film_transparent = True
    seen, _ = passes_of(scene, tmp_path)
    alpha = reference("square")["alpha"]
    assert np.allclose(seen["Combined.A"], alpha, atol=1e-5)
    assert np.allclose(seen["Alpha.A"], alpha, atol=1e-5)
    hit = alpha > 0.1
    assert hit.any() and np.allclose(seen["Depth.Z"][hit], reference("square")["depth"][hit], rtol=1e-3)
    assert not any(name.startswith(("Normal", OBJECT_INDEX, "Crypto")) for name in seen)


def test_the_compositor_is_offered_each_once(scene):
    """Its own Alpha is that of Combined, and links to it stay where passes come and go."""
    scene.render.engine = engine.ENGINE
    if hasattr(scene, "compositing_node_group"):  # Blender 5
        scene.compositing_node_group = bpy.data.node_groups.new("Compositor", "CompositorNodeTree")
        tree = scene.compositing_node_group
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
    source = tree.nodes.new("CompositorNodeRLayers")

    def offered():
        return [socket.name for socket in source.outputs if socket.enabled]

    assert offered() == ["Image", "Alpha"]
    target = tree.nodes.new("CompositorNodeBlur")
    tree.links.new(source.outputs["Alpha"], target.inputs[0])
    for name in SETTINGS.values():
        setattr(scene.view_layers[0], name, True)
    bpy.context.view_layer.update()
    assert offered() == ["Image", "Alpha", "Depth", "Normal", OBJECT_INDEX, "CryptoObject00", "CryptoObject01"]
    assert [link.from_socket.name for link in tree.links] == ["Alpha"]


def test_passes_of_a_scene(scene, by_command, tmp_path):
    """Splats in front of a wall that fills the picture."""
    place_camera(scene, "square")
    splats = load(REFERENCES / "square.ply")
    wall = plane(200)
    wall.matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, -20))
    splats.pass_index, wall.pass_index = 3, 5
    layer = scene.view_layers[0]
    for name in SETTINGS.values():
        setattr(layer, name, True)
    scene.dogsplat.samples = 1
    seen, header = passes_of(scene, tmp_path)
    assert set(np.unique(seen[f"{OBJECT_INDEX}.X"])) == {3, 5}
    alone = seen[f"{OBJECT_INDEX}.X"] == 5
    far = alone & (reference("square")["alpha"] == 0)
    assert np.allclose(seen["Depth.Z"][far], 20, rtol=1e-4)
    normal = np.stack([seen[f"Normal.{axis}"] for axis in "XYZ"], -1)[far]
    assert np.allclose(normal, scene.camera.matrix_world.col[2][:3], atol=1e-3)
    ids = {name: float_of(name) for name in (splats.name, wall.name)}
    first, coverage = seen["CryptoObject00.R"], seen["CryptoObject00.G"]
    assert {float(number) for number in np.unique(first)} == set(ids.values())
    assert np.allclose(coverage + seen["CryptoObject00.A"], 1, atol=1e-3)
    assert (first[far] == np.float32(ids[wall.name])).all() and np.allclose(coverage[far], 1, atol=0.01)
    (key,) = [name for name in header if name.endswith("/manifest")]
    written = {name: np.uint32(int(bits, 16)).view(np.float32) for name, bits in json.loads(header[key]).items()}
    assert written == ids and header[key.replace("manifest", "name")] == f"{layer.name}.CryptoObject"


def test_each_view_layer_has_its_own_picture_and_passes(scene, by_command, tmp_path):
    """The first one is without one of two models."""
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    collection = bpy.data.collections.new("second alone")
    scene.collection.children.link(collection)
    other = load(REFERENCES / "square.ply")
    collection.objects.link(other)
    scene.collection.objects.unlink(other)
    first, second = scene.view_layers[0], scene.view_layers.new("second")
    first.name, first.use_pass_z = "first", True
    first.layer_collection.children[0].exclude = second.use_pass_object_index = True
    scene.render.film_transparent = True
    seen, _ = layers_of(scene, tmp_path)
    alpha = reference("square")["alpha"]
    assert np.allclose(seen["first.Combined.A"], alpha, atol=1e-5)
    assert seen["second.Combined.A"].mean() > alpha.mean() + 0.05
    assert "first.Depth.Z" in seen and not any(name.startswith("second.Depth") for name in seen)
    assert not any(name.startswith(f"first.{OBJECT_INDEX}") for name in seen)


@pytest.mark.parametrize("text, expected", [("", 0), ("hello", 0x248BFA47), ("hello, world", 0x149BBB7F)])
def test_murmur3_is_that_of_its_author(text, expected):
    """Values of the reference implementation, seed 0."""
    assert murmur3(text.encode()) == expected
