"""File > Import > DoG Splat Cameras, and "Look Through"."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper
from mathutils import Matrix

from ..files.errors import FileError, readable, told
from ..objects.conventions import UP_AXES, conversion
from ..objects.place import place_of
from ..translations import OWN
from .objects import build_camera, look_through
from .read import read_cameras


class DOGSPLAT_OT_import_cameras(bpy.types.Operator, ImportHelper):
    """Import the cameras of a data set (COLMAP, transforms.json) or of a run folder"""

    bl_idname = "import_scene.dogsplat_cameras"
    bl_label = "Import DoG Splat Cameras"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filter_glob: StringProperty(default="*.json;*.bin;*.txt", options={"HIDDEN"})
    follow_model: BoolProperty(
        name="Follow the Model",
        default=True,
        description="Place the cameras like the active model, and ignore the up axis and scale below",
    )
    up_axis: EnumProperty(name="Up Axis", items=UP_AXES, default="Z", description="Which axis of the file points up")
    scale: FloatProperty(name="Scale", default=1.0, min=1e-6, soft_max=100.0, translation_context=OWN)
    downscale: IntProperty(
        name="Downscale",
        default=0,
        min=0,
        max=64,
        description="Divide the size of the photographs by this. 0: as in the training of the run, else 1",
    )
    background_images: BoolProperty(
        name="Background Images", default=True, description="Show each photograph behind its camera"
    )
    use_first: BoolProperty(
        name="Look Through the First",
        default=True,
        description="Make the first camera active, and render in the resolution of its photograph",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """All cameras in a collection of their own; after an error, none."""
        path = Path(bpy.path.abspath(self.filepath))
        collection = None
        try:
            cameras, trained_at = read_cameras(path, _image_size)
            collection = bpy.data.collections.new(f"Cameras {_title(path)}")
            context.scene.collection.children.link(collection)
            matrix = self._matrix(context)
            downscale = self.downscale or trained_at
            objects = [
                build_camera(collection, camera.downscaled(downscale), matrix, str(path), self.background_images)
                for camera in cameras
            ]
        except (FileError, RuntimeError) as error:
            if collection:
                _remove(collection)
            self.report({"ERROR"}, " ".join(str(error).split()))
            return {"CANCELLED"}
        if self.use_first:
            look_through(context.scene, objects[0])
        if bent := sum(camera.bent for camera in cameras):
            words = "{count} cameras imported, {bent} without lens distortion: their photographs fit only in the middle"
            self.report({"WARNING"}, told(words, count=len(objects), bent=bent))
        else:
            self.report({"INFO"}, told("{count} cameras imported", count=len(objects)))
        return {"FINISHED"}

    def _matrix(self, context: bpy.types.Context) -> Matrix:
        place = place_of(context.view_layer.objects.active)
        if self.follow_model and place is not None:
            return place.now(context)
        return conversion(self.up_axis, self.scale)


class DOGSPLAT_OT_look_through(bpy.types.Operator):
    """Make the selected camera active, with the resolution and pixel aspect of its photograph"""

    bl_idname = "dogsplat.look_through"
    bl_label = "Look Through Camera"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """A camera is selected."""
        return context.object is not None and context.object.type == "CAMERA"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Also turn the viewport to it, where there is one."""
        look_through(context.scene, context.object)
        space = context.space_data
        if space is not None and space.type == "VIEW_3D":
            space.region_3d.view_perspective = "CAMERA"
        return {"FINISHED"}


def _title(path: Path) -> str:
    folder = path if path.is_dir() else path.parent
    return readable(folder.resolve().name)


def _image_size(path: Path) -> tuple[int, int]:
    known = {image.filepath for image in bpy.data.images}
    try:
        image = bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError as error:
        raise FileError(path, "cannot be read as an image", 'add "w" and "h" to the frames') from error
    width, height = image.size
    if image.filepath not in known:
        bpy.data.images.remove(image)
    return width, height


def _remove(collection: bpy.types.Collection) -> None:
    """A collection with its cameras."""
    for obj in list(collection.objects):
        bpy.data.cameras.remove(obj.data)
    bpy.data.collections.remove(collection)
