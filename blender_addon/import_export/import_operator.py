"""File > Import > DoG Splat: models as objects that are visible at once."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_tip as tip_
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper, poll_file_object_drop
from mathutils import Matrix

from ..files.errors import FileError, readable, told
from ..files.model import GROUPS, Model, importance, sigmoid
from ..files.read import EXTENSIONS, read_model
from ..files.said import Said
from ..native.bake import baked
from ..native.convert import native_object, replace_object
from ..nodes.modifier import add_modifier, set_input
from ..nodes.tree import NEAR_CLIP
from ..objects.attributes import write_attributes
from ..objects.conventions import DOG_COUNT, UP_AXES, conversion, metres_of_unit, remember, remember_said
from ..objects.feature import is_available
from ..objects.working_space import remember_space
from ..package.renderers import converted
from ..preferences import command_of
from ..translations import OWN

SHOWN_AS = (
    ("AUTOMATIC", "Automatic", "Quads in renders, ellipsoids in the viewport"),
    ("QUADS", "Quads", "Exact for the active camera, wrong from anywhere else"),
    ("ELLIPSOIDS", "Ellipsoids", "Instances that look right from everywhere"),
    ("POINTS", "Points", "A point cloud: opaque and fast"),
)
UP_DESCRIPTION = "Which axis of the file points up. If it is not set here, the file decides"
CONVENTION = "3DGS PLY: raw values, quaternions w x y z, positions in coordinates of the file"


def ways_to_show() -> tuple[tuple[str, str, str], ...]:
    """What this Blender can show a model as, when the add-on is enabled."""
    if not is_available():
        return SHOWN_AS
    tip = tip_("Drawn by Blender itself in real time, as plain Gaussians: the package bakes DoG into them")
    return (*SHOWN_AS, ("NATIVE", iface_("Native"), tip))


class DOGSPLAT_OT_import(bpy.types.Operator, ImportHelper):
    """Import models of 3D Gaussians and Differences of Gaussians: PLY and SPZ, with the package glTF and others, too"""

    bl_idname = "import_scene.dogsplat"
    bl_label = "Import DoG Splat"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filename_ext = ".ply"
    filter_glob: StringProperty(default=";".join(f"*{end}" for end in EXTENSIONS), options={"HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})

    up_axis: EnumProperty(name="Up Axis", items=UP_AXES, default="Z", description=UP_DESCRIPTION)
    scale: FloatProperty(
        name="Scale",
        default=1.0,
        min=1e-6,
        soft_max=100.0,
        description="If it is not set here, the file decides",
        translation_context=OWN,
    )
    place: BoolProperty(
        name="Upright, in Metres",
        default=True,
        description="Rotate and scale as the file says. If off, only as set here",
    )
    sh_degree: IntProperty(
        name="SH Degree",
        default=3,
        min=0,
        max=3,
        description="Highest degree of view-dependent color that is loaded",
    )
    min_opacity: FloatProperty(
        name="Minimum Opacity", default=0.0, min=0.0, max=1.0, description="Splats with a lower opacity are not loaded"
    )
    max_count: IntProperty(
        name="Maximum Count",
        default=0,
        min=0,
        description="Load only the most important splats, by opacity and size; 0 loads all",
    )
    use_dog: BoolProperty(name="DoG", default=True, description="Subtract the pseudo-Gaussians of DoG models")
    color_mode: EnumProperty(name="Colors", default="LINEAR", items=(
        ("LINEAR", "Scene", "Linear light: right under Standard, Filmic and AgX, together with other objects"),
        ("DISPLAY", "Exact", "sRGB values blended as trained: the exact picture, for the view transform Raw"),
    ))  # fmt: skip
    show_as: EnumProperty(name="Show As", default=SHOWN_AS[0][0], items=ways_to_show())
    antialiased: BoolProperty(
        name="Antialiased",
        default=False,
        description="For models that were trained with antialiasing. If it is not set here, the file decides",
    )

    prepare_viewports: BoolProperty(
        name="Prepare Viewports",
        default=True,
        description="Switch solid shading to material preview, and hide the outlines of selected objects, because "
        "both hide splats",
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """A file dialog, or a dialog of the options alone for files that were dropped."""
        return self.invoke_popup(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Read every file first, then build: an error leaves nothing behind."""
        names = [file.name for file in self.files if file.name]
        folder = Path(bpy.path.abspath(self.directory))
        paths = [folder / name for name in names] or [Path(bpy.path.abspath(self.filepath))]
        try:
            read = [(path, *read_model(path, partial(converted, command_of(context)))) for path in paths]
            models = [(path, self._reduced(path, model), said) for path, model, said in read]
            native, command = self.show_as == "NATIVE", command_of(context)
            plain = [baked(command, model) if native and self.use_dog else model for _, model, _ in models]
        except ValueError as error:  # FileError too
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.object.select_all(action="DESELECT")
        for (path, model, said), gaussians in zip(models, plain, strict=True):
            obj = self._placed(context, path, model, said)
            if native:
                own = obj
                obj = native_object(own, own.data, model, gaussians)
                replace_object(own, obj)
            obj.select_set(True)
            context.view_layer.objects.active = obj
        if self.prepare_viewports:
            _prepare_viewports(context)
        total = sum(model.n_splats for _, model, _ in models)
        dog = sum(int(model.is_dog.sum()) for _, model, _ in models)
        having = [sum(int(getattr(model, group.has).sum()) for _, model, _ in models) for group in GROUPS]
        slopes, curvatures, cuts, second, shifts = having
        counts = [told("{total:,} splats imported, {dog:,} of them DoG", total=total, dog=dog)]
        counts += [told("{n:,} with slopes", n=slopes)] if slopes else []
        counts += [told("{n:,} with curvatures", n=curvatures)] if curvatures else []
        counts += [told("{n:,} with a cut", n=cuts)] if cuts else []
        counts += [told("{n:,} with a second cut", n=second)] if second else []
        counts += [told("{n:,} with shifts", n=shifts)] if shifts else []
        self.report({"INFO"}, ", ".join(counts))
        return {"FINISHED"}

    def _placed(self, context: bpy.types.Context, path: Path, model: Model, said: Said) -> bpy.types.Object:
        """The object of a model, drawn by our modifier as the options and its file say."""
        place = said if self.place else replace(said, up=None, scale=None)
        units = place.scale and place.scale / metres_of_unit(context.scene)
        up_axis, scale = self._choice("up_axis", place.up), self._choice("scale", units)
        obj = build_object(context, path, model, said, conversion(up_axis, scale))
        modifier = obj.modifiers[-1]
        if self.show_as != "NATIVE":
            set_input(modifier, "Show As", self.show_as.capitalize())
        set_input(modifier, "SH Degree", self.sh_degree)
        set_input(modifier, "DoG", self.use_dog)
        set_input(modifier, "Linear Colors", self.color_mode == "LINEAR" and not said.linear)
        set_input(modifier, "Antialiased", self._choice("antialiased", said.antialiased))
        near = NEAR_CLIP if said.near_clip is None else said.near_clip
        set_input(modifier, "Near Clip", near * scale)
        return obj

    def _choice(self, name: str, said: Any) -> Any:
        """An option as it is set here, else as the file says, else its default."""
        if said is None or self.properties.is_property_set(name, ghost=False):
            return getattr(self, name)
        return said

    def _reduced(self, path: Path, model: Model) -> Model:
        """Without what the options leave out, the order kept."""
        model = model.with_degree(min(self.sh_degree, model.sh_degree))
        if self.min_opacity > 0:
            model = model.select(sigmoid(model.logit_opacities) >= self.min_opacity)
        if 0 < self.max_count < model.n_splats:
            best = np.argsort(-importance(model), kind="stable")[: self.max_count]
            model = model.select(np.sort(best))
        if model.n_splats == 0:
            raise FileError(path, "no splat is left", "lower the minimum opacity, or check that the model has any")
        return model


def _prepare_viewports(context: bpy.types.Context) -> None:
    """In every viewport with solid shading that a window shows."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            space = area.spaces.active
            if area.type == "VIEW_3D" and space.shading.type == "SOLID":
                space.shading.type = "MATERIAL"
                space.overlay.show_outline_selected = False


def _editable(context: bpy.types.Context) -> bpy.types.Collection:
    """The active collection, or that of the scene where the active one is of another file."""
    chosen = context.collection
    return chosen if chosen.library is None and chosen.override_library is None else context.scene.collection


def build_object(context: bpy.types.Context, path: Path, model: Model, said: Said, matrix: Matrix) -> bpy.types.Object:
    """An object of a model in the active collection, with modifier and materials; after an error, nothing."""
    name = readable(path.stem if path.stem != "point_cloud" else path.resolve().parent.name)  # of a run folder
    mesh = bpy.data.meshes.new(name)
    obj = bpy.data.objects.new(name, mesh)
    with ExitStack() as undo:
        undo.callback(bpy.data.meshes.remove, mesh)
        undo.callback(bpy.data.objects.remove, obj)  # first
        write_attributes(mesh, model)
        obj.matrix_world = matrix
        remember(obj, str(path), CONVENTION, matrix)
        remember_said(obj, said)
        remember_space(obj)
        obj[DOG_COUNT] = int(model.is_dog.sum())
        _editable(context).objects.link(obj)
        add_modifier(obj)
        undo.pop_all()
    return obj


class DOGSPLAT_FH_model(bpy.types.FileHandler):
    """Drag and drop of models into the viewport."""

    bl_idname = "DOGSPLAT_FH_model"
    bl_label = "DoG Splat"
    bl_import_operator = "import_scene.dogsplat"
    bl_file_extensions = ";".join(EXTENSIONS)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Where objects can be dropped: the viewport and the outliner."""
        return poll_file_object_drop(context)
