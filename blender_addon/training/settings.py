"""What the panel "Train Splats" is told, kept with the scene."""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from ..translations import OWN
from .deleted import is_there

RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5) else set()  # a path may begin with //
BANDS = {"AROUND": (0.0, 90.0), "INSIDE": (-35.0, 35.0)}  # elevations in degrees, unless they are set by hand
SUBJECTS = (
    ("SELECTED", "Selected Objects", "What is selected when the cameras are made"),
    ("SCENE", "Whole Scene", "Everything that renders show"),
    ("REGION", "Region", "What is in the box of an object, such as an empty; nothing is hidden"),
)
RIGS = (
    ("AROUND", "Around", "On a sphere, all looking at its middle, as in dogsplat capture"),
    ("INSIDE", "Inside", "Spread over the room, looking into all directions: for interiors"),
)
PRESETS = (
    ("ours", "Ours", "The recipe of this package: the model is pruned, and becomes DoG"),
    ("ours_slopes", "Ours with Slopes", "Ours, with colors that vary over their splats"),
    ("ours_cuts", "Ours with Slopes and Cuts", "Ours, with such colors, and with splats that planes cut off"),
    ("ours_preconditioned", "Ours, Preconditioned", "With slopes, cuts, and steps that move the numbers of a splat "
    "together"),
    ("ours_second_cuts", "Ours with Second Cuts", "As preconditioned, and a second plane may cut off each splat"),
    ("ours_curvatures", "Ours with Curvatures", "As with second cuts, and a brightness that curves over each splat"),
    ("ours_shifts", "Ours with Shifts", "As with curvatures, and places of splats that depend on the view"),
    ("ours_early", "Ours, Early", "As with shifts, and a shorter growth in larger steps: quicker"),
    ("paper", "Paper", "The published method, as it is printed"),
    ("released", "Released", "The published method, as in its code"),
    ("3dgs", "3DGS", "Plain 3D Gaussian splatting: nothing is pruned, nothing is DoG"),
)


def _take_band(self: DogSplatTrainingSettings, context: bpy.types.Context) -> None:
    self.elevations = BANDS[self.rig]


class DogSplatSubject(bpy.types.PropertyGroup):
    """One of the objects that a rig was made for."""

    object: PointerProperty(type=bpy.types.Object)


class DogSplatTrainingSettings(bpy.types.PropertyGroup):
    """Of a scene, for the panel "Train Splats"."""

    subject: EnumProperty(name="Subject", items=SUBJECTS, default="SELECTED", translation_context=OWN)
    region: PointerProperty(
        name="Region", type=bpy.types.Object,
        description="An empty, which marks its cube, or any object that has a size",
    )
    rig: EnumProperty(name="Cameras", items=RIGS, default="AROUND", update=_take_band, translation_context=OWN)
    views: IntProperty(
        name="Views",
        default=48,
        min=1,
        soft_max=400,
        description="Number of training views. A sixth as many more are rendered to measure the model",
    )
    elevations: FloatVectorProperty(
        name="Elevations",
        size=2,
        default=BANDS["AROUND"],
        min=-90.0,
        max=90.0,
        description="Lowest and highest, in degrees: 0 to 90 is a dome, -90 to 90 a sphere",
    )
    zoom: FloatProperty(
        name="Zoom",
        default=1.0,
        min=0.01,
        soft_max=4.0,
        description="At 1 the subject's sphere just fits, at 2 it is twice as large",
    )
    size: IntVectorProperty(
        name="Size", size=2, default=(400, 400), min=8, soft_max=2000,
        description="Width and height of the views, in pixels",
    )
    alone: BoolProperty(
        name="Subject Alone",
        default=True,
        description="Cameras do not see other objects; their shadows and light stay",
    )
    transparent: BoolProperty(
        name="Transparent",
        default=True,
        description="The views have a transparent background, so that the model has only the subject. If off, the "
        "world is trained, too",
    )
    linear: BoolProperty(
        name="Linear (HDR)",
        default=False,
        description="OpenEXR of linear radiance instead of PNG: highlights are not clipped at white",
    )
    folder: StringProperty(
        name="Folder",
        subtype="DIR_PATH",
        options=RELATIVE,
        default="//dogsplat_training/{blend_name}/{scene_name}",
        description="Folder of the data set (data) and of the training (run). The names of file and scene are filled "
        "in",
    )
    preset: EnumProperty(name="Preset", items=PRESETS, default="ours", translation_context=OWN)
    steps: IntProperty(
        name="Steps", default=7000, min=10, soft_max=30_000,
        description="Training steps; the whole schedule is scaled to them",
    )
    target: StringProperty(
        name="Target", default="10%",
        description="Size after pruning: a share (10%), a count of primitives (20000), or a size of the file (2MB)",
    )
    max_primitives: IntProperty(
        name="At Most", default=60_000, min=0,
        description="Largest number of primitives during training; 0: no limit, which takes long",
    )
    hide_originals: BoolProperty(
        name="Hide Originals", default=True,
        description="Hide the original objects in viewports and renders, because the model takes their place",
    )
    cameras: PointerProperty(type=bpy.types.Collection)  # of the rig
    subjects: CollectionProperty(type=DogSplatSubject)  # of the rig
    result: PointerProperty(type=bpy.types.Object)  # of the latest training

    def objects(self) -> list[bpy.types.Object]:
        """Those that the rig was made for, as far as they are still there, and in the scene of these settings."""
        return [entry.object for entry in self.subjects if is_there(entry.object, self.id_data)]
