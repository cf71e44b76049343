"""Surface Mesh: starts the package, looks after it while Blender goes on, and brings in what it has made."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, FloatProperty, IntProperty

from ..evaluated.edited import later_notes
from ..files.errors import told
from ..native.convert import remove_object
from ..objects.attributes import can_edit, can_edit_native
from ..objects.columns import get_column
from ..objects.working_space import converted_notes
from ..preferences import command_of
from ..windows import is_edited, redraw, tell
from .mesh_object import build_surface
from .run import SurfaceRun

INTERVAL = 0.5  # seconds between looks at the process


@dataclass
class Work:
    """The one surface that is being made now."""

    run: SurfaceRun
    obj: int  # the session_uid of the splats, which a new name and undo leave
    positions: bytes  # of the splats, in whose space the surface will be
    is_body: bool


class State:
    """At most one, and how the latest ended."""

    work: Work | None = None
    trouble = ""  # one line


class DOGSPLAT_OT_surface_mesh(bpy.types.Operator):
    """Make a mesh of the surface that the active splats show: a proxy for collisions, rigid bodies and shadows"""

    bl_idname = "dogsplat.surface_mesh"
    bl_label = "Surface Mesh"

    voxel: FloatProperty(
        name="Voxel Size",
        default=0.0,
        min=0.0,
        soft_max=1.0,
        step=1,
        precision=4,
        description="How fine the mesh is, in units of the object, as for Blender's Remesh; 0 is automatic",
    )
    triangles: IntProperty(
        name="Most Triangles", default=0, min=0,
        description="Simplify the mesh to at most this many triangles; 0 keeps all of them",
    )
    texture: IntProperty(
        name="Texture Size",
        default=0,
        min=0,
        max=16384,
        description="Store colors in a square picture with this many pixels along its side; 0: one color for each "
        "vertex",
    )
    largest: BoolProperty(
        name="Largest Part Only",
        description="Leave out everything that is not connected to the largest part",
    )
    room: BoolProperty(name="For a Room", description="Look at the splats only from inside, not from around them")
    body: BoolProperty(name="Rigid Body", description="Make the mesh a passive rigid body, with which others collide")

    in_dialog = False  # whether a window waits, which is not to stand still

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """The active object holds splats, and no other surface is being made."""
        obj = context.object
        return context.mode == "OBJECT" and State.work is None and (can_edit(obj) or can_edit_native(obj))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """A dialog: each try takes its time."""
        if bpy.app.background:
            return self.execute(context)
        self.in_dialog = True
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """From the dialog Blender goes on meanwhile; for scripts it waits."""
        State.trouble = ""
        obj, depsgraph = context.object, context.evaluated_depsgraph_get()
        try:
            work = begun(command_of(context), obj, depsgraph, self.flags(), self.body)
        except (ValueError, RuntimeError) as error:
            return self._refused(error)
        for note in converted_notes([obj]) + later_notes(obj, depsgraph):
            self.report({"WARNING"}, note)
        if self.in_dialog:
            State.work = work
            bpy.app.timers.register(look_after, first_interval=INTERVAL)
            return {"FINISHED"}
        try:
            surface = brought_in(context, work)
        except (ValueError, RuntimeError) as error:
            return self._refused(error)
        self.report({"INFO"}, told("{count:,} triangles", count=len(surface.data.polygons)))
        return {"FINISHED"}

    def flags(self) -> list[str]:
        """What ``dogsplat mesh`` is called with. Raises ``ValueError``."""
        flags = ["--voxel", f"{self.voxel:.9g}"] if self.voxel else []
        flags += ["--faces", str(self.triangles)] if self.triangles else []
        if self.texture and not self.triangles:
            raise ValueError(told("a texture is for few triangles; set Most Triangles as well, to 20000 for instance"))
        flags += ["--texture", str(self.texture)] if self.texture else []
        flags += ["--connected", "1"] if self.largest else []
        return flags + (["--inside", "1"] if self.room else [])

    def _refused(self, error: Exception) -> set[str]:
        self.report({"ERROR"}, " ".join(str(error).split()))
        return {"CANCELLED"}


class DOGSPLAT_OT_stop_surface_mesh(bpy.types.Operator):
    """Cancel the surface mesh that is being made"""

    bl_idname = "dogsplat.stop_surface_mesh"
    bl_label = "Stop"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """One is being made."""
        return State.work is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Nothing of it stays."""
        stop()
        redraw(context)
        return {"FINISHED"}


def begun(command: str, obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, flags: list[str], is_body: bool) -> Work:
    """The process of a surface. Raises ``ValueError`` and ``RendererError``."""
    run = SurfaceRun(command, obj, depsgraph, flags)
    return Work(run, obj.session_uid, _positions(obj), is_body)


def brought_in(context: bpy.types.Context, work: Work) -> bpy.types.Object:
    """The surface as an object, once the package is done; after an error, nothing. Raises ``ValueError``."""
    try:
        work.run.require_result()
        obj = _object(work)
        if obj is None or _positions(obj) != work.positions:
            problem = '"{name}": its splats were moved or deleted before their surface was there; make it again'
            raise ValueError(told(problem, name=work.run.name))
        surface = build_surface(obj, work.run.out)
    finally:
        work.run.close()
    try:
        if work.is_body:
            make_body(context, surface)
    except (ValueError, RuntimeError):
        remove_object(surface)
        raise
    _choose(context, obj, surface)
    return surface


def make_body(context: bpy.types.Context, surface: bpy.types.Object) -> None:
    """A passive rigid body of the shape of its mesh, which follows its splats where these are animated."""
    with context.temp_override(object=surface, active_object=surface, selected_objects=[surface]):
        bpy.ops.rigidbody.object_add(type="PASSIVE")
    body = surface.rigid_body
    body.collision_shape, body.mesh_source, body.kinematic = "MESH", "BASE", True
    body.collision_margin = 0.0  # else others stop before they touch it


def _choose(context: bpy.types.Context, obj: bpy.types.Object, surface: bpy.types.Object) -> None:
    """Select the surface, and make it active, where its splats still are."""
    layer = context.view_layer
    if layer.objects.active != obj or surface.name not in layer.objects:
        return
    for other in list(layer.objects.selected):
        other.select_set(False)
    surface.select_set(True)
    layer.objects.active = surface


def _object(work: Work) -> bpy.types.Object | None:
    return next((obj for obj in bpy.data.objects if obj.session_uid == work.obj), None)


def _positions(obj: bpy.types.Object) -> bytes:
    return get_column(obj.data, "position", 3).tobytes()


def look_after() -> float | None:
    """Called by a timer: bring in a surface that is done, as one step of undo, and say what went wrong with one."""
    work, context = State.work, bpy.context
    if work is None:
        return None
    redraw(context)
    obj = _object(work)
    windows = [each for each in context.window_manager.windows if obj is None or obj.name in each.scene.objects]
    if work.run.task.works or not windows or is_edited(windows[0]):
        return INTERVAL
    State.work = None
    try:
        with context.temp_override(window=windows[0]):
            brought_in(context, work)
            bpy.ops.ed.undo_push(message=DOGSPLAT_OT_surface_mesh.bl_label)
    except (ValueError, RuntimeError) as error:
        State.trouble = " ".join(str(error).split())
        tell(context, State.trouble)
    return None


def draw_surface(layout: bpy.types.UILayout) -> None:
    """The button, or how far it is."""
    if State.work is None:
        layout.operator("dogsplat.surface_mesh", icon="MESH_DATA")
        if State.trouble:
            layout.label(text=State.trouble, translate=False, icon="ERROR")
        return
    layout.progress(factor=State.work.run.task.share, text="Surface Mesh")
    layout.operator("dogsplat.stop_surface_mesh", icon="CANCEL")


@persistent
def stop(*_: object) -> None:
    """End what is at work: nobody waits for it any more, or another file comes, of which it is not."""
    if State.work is not None:
        State.work.run.close()
    State.work, State.trouble = None, ""


def register() -> None:
    """The handler."""
    bpy.app.handlers.load_pre.append(stop)


def unregister() -> None:
    """No process stays behind, and no timer."""
    bpy.app.handlers.load_pre.remove(stop)
    stop()
    if bpy.app.timers.is_registered(look_after):
        bpy.app.timers.unregister(look_after)
