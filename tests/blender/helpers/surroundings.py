"""A small scene without splats, made of what the checks of the conversion need, and its picture by an engine."""

from __future__ import annotations

import bpy
import numpy as np

WIDTH, HEIGHT = 48, 32
GREY = (0.5, 0.5, 0.5, 1)


def material(kind: str, **values) -> bpy.types.Material:
    """Of one shader; names of sockets have ``_`` for a space."""
    made = bpy.data.materials.new(kind)
    if made.node_tree is None:
        made.use_nodes = True  # before Blender 5
    tree = made.node_tree
    tree.nodes.clear()
    output, shader = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new(kind)
    for name, value in values.items():
        shader.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return made


def link(tree: bpy.types.NodeTree, kind: str, output: str, target: bpy.types.NodeSocket) -> bpy.types.Node:
    """A new node whose output goes to a socket."""
    node = tree.nodes.new(kind)
    tree.links.new(node.outputs[output], target)
    return node


def body(made: bpy.types.Object, of: bpy.types.Material) -> bpy.types.Object:
    """An object of a material."""
    made.data.materials.append(of)
    return made


def plane(size: float, **placed) -> bpy.types.Object:
    """A square."""
    bpy.ops.mesh.primitive_plane_add(size=size, **placed)
    return bpy.context.object


def sphere(radius: float, **placed) -> bpy.types.Object:
    """A smooth ball."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, segments=32, ring_count=16, **placed)
    bpy.context.object.data.shade_smooth()
    return bpy.context.object


def light(scene: bpy.types.Scene, kind: str, location=(0, 0, 2), rotation=(0, 0, 0), **values) -> bpy.types.Object:
    """A lamp."""
    data = bpy.data.lights.new(kind, kind)
    for name, value in values.items():
        setattr(data, name, value)
    made = bpy.data.objects.new(kind, data)
    scene.collection.objects.link(made)
    made.location, made.rotation_euler = location, rotation
    return made


def camera(scene: bpy.types.Scene, location, rotation=(0, 0, 0)) -> bpy.types.Object:
    """The active one, and a small picture of few samples."""
    made = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(made)
    made.location, made.rotation_euler = location, rotation
    scene.camera = made
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.view_settings.view_transform = "Standard"
    scene.dogsplat.samples = 32
    cycles = scene.cycles
    cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = 32, False, False
    cycles.blur_glossy = cycles.sample_clamp_indirect = 0
    return made


def image(name: str, function, is_float: bool = False) -> bpy.types.Image:
    """``function`` of x and y in 0..1 from the lower left gives three channels, or four, the last of which is alpha."""
    y, x = (np.mgrid[:32, :32] + 0.5) / 32
    values = np.stack(function(x, y), -1)
    made = bpy.data.images.new(name, 32, 32, alpha=values.shape[-1] == 4, float_buffer=is_float)
    pixels = np.ones((32, 32, 4), np.float32)
    pixels[..., : values.shape[-1]] = values
    made.pixels.foreach_set(pixels.ravel())
    return made


def background(scene: bpy.types.Scene, color=(0.5, 0.5, 0.5, 1)) -> bpy.types.Node:
    """The node Background of a new world.

    Where its light comes from Cycles looks up in a map of 64 x 32 pixels, more than the images here have; left to
    itself it would make one of millions before each picture, in 1.8 s.
    """
    scene.world = bpy.data.worlds.new("World")
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 64
    if scene.world.node_tree is None:
        scene.world.use_nodes = True  # before Blender 5
    node = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    node.inputs["Color"].default_value = color
    return node


def blocks(values: np.ndarray) -> np.ndarray:
    """Means of blocks of 4 x 4, in which noise is less."""
    return values.reshape(HEIGHT // 4, 4, WIDTH // 4, 4, -1).mean((1, 3))
