"""What our engine is told in the render properties."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty

ENGINE = "DOGSPLAT"
COLORS = EnumProperty(name="Colors", default="LINEAR", items=(
    ("LINEAR", "Linear", "Scene-linear radiance: the exact picture under the view transform Standard"),
    ("DISPLAY", "Display", "sRGB values: the exact picture under the view transform Raw"),
))  # fmt: skip


class DogSplatRenderSettings(bpy.types.PropertyGroup):
    """Of a scene, for the engine *DoG Splat (Mitsuba)*."""

    send: EnumProperty(name="Render", default="SCENE", items=(
        ("SCENE", "Whole Scene", "Splats together with meshes, lights, world and materials, path traced"),
        ("SPLATS", "Splats Only", "The exact picture of the splats over the color of the world"),
    ))  # fmt: skip
    samples: IntProperty(
        name="Samples", default=64, min=1, soft_max=4096, description="Paths per pixel of a whole scene"
    )
    bounces: IntProperty(
        name="Bounces", default=8, min=0, soft_max=64,
        description="How often light bounces in a whole scene",
    )
    denoise: BoolProperty(
        name="Denoise", default=False,
        description="Remove the noise of a whole scene when all samples are done; splats in front stay sharp",
    )  # fmt: skip
    mesh_shadows: BoolProperty(
        name="Shadows on Splats", default=False,
        description="Meshes darken the splats that they hide from the lights of the scene: an approximation",
    )  # fmt: skip
