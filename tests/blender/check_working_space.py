"""Working spaces of Blender 5: that colours of splats are right in one of them alone is said wherever it matters."""

import bpy
import pytest
from drawn_panels import drawn
from model_files import export, load
from references import place_camera

from blender_addon.engine.order import make_order
from blender_addon.objects.working_space import working_space_notes

LABEL = "Splats need the working space Linear Rec.709"
NOTE = "the working space Linear Rec.2020 makes colors of splats wrong; choose Linear Rec.709, then import"


@pytest.fixture(params=[False, True])
def chosen(request):
    """Whether the file has another one."""
    if request.param and not hasattr(bpy.data, "colorspace"):
        pytest.skip("files have a working space of their own from Blender 5.0 on")
    if request.param:
        bpy.ops.wm.set_working_color_space(working_space="Linear Rec.2020", convert_colors=True)
    return request.param


def test_another_working_space_is_said_by_imports_exports_renders_and_the_panel(scene, model, chosen, tmp_path, capfd):
    place_camera(scene, "dog")
    load(model)
    export(tmp_path / "out.ply")
    assert capfd.readouterr().out.count(f"Warning: {NOTE}") == 2 * chosen
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert order.notes == working_space_notes() and len(order.notes) == chosen
    assert (LABEL in drawn()) == chosen
