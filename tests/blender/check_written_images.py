"""A texture is read and written again where it may have changed, and only there."""

import bpy
import numpy as np
import pytest
from live_views import staged, through_the_camera
from surroundings import body, camera, image, link, material, plane

from blender_addon.scene import images
from blender_addon.scene.export import Export
from blender_addon.scene.images import bitmap, environment
from blender_addon.scene.written_images import WRITTEN


@pytest.fixture
def reads(monkeypatch) -> list[str]:
    """Names of the images whose pixels were read, in turn."""
    found, read = [], images.pixels_of
    monkeypatch.setattr(images, "pixels_of", lambda picture: found.append(picture.name) or read(picture))
    return found


def saved(name: str, folder) -> bpy.types.Image:
    """An image of a file, which a material shows."""
    picture = image(name, lambda x, y: (x, y, x))
    picture.filepath_raw, picture.file_format = str(folder / f"{name}.png"), "PNG"
    picture.save()
    shown = material("ShaderNodeBsdfDiffuse")
    link(shown.node_tree, "ShaderNodeTexImage", "Color", shown.node_tree.nodes[1].inputs["Color"]).image = picture
    body(plane(2), shown)
    bpy.context.view_layer.update()
    return picture


def fill(picture, value):
    picture.pixels.foreach_set(np.full(len(picture.pixels), value, np.float32))


def overwrite(picture):
    """As another program does; Blender goes on to show what it has."""
    other = image("other", lambda x, y: (y, y, y))
    other.filepath_raw, other.file_format = picture.filepath_raw, "PNG"
    other.save()
    bpy.data.images.remove(other)


def test_a_stage_reads_no_texture_that_is_as_it_was(scene, tmp_path, reads):
    """Whatever moves, and whichever other material changes."""
    camera(scene, (0, 0, 8))
    first, second = saved("first", tmp_path), saved("second", tmp_path)
    seen = through_the_camera(scene).camera
    stages = [staged(tmp_path, seen)]
    assert sorted(reads) == ["first", "second"]
    bpy.context.object.location.x += 1
    bpy.context.view_layer.update()
    stages.append(staged(tmp_path, seen))
    textures = [{name for name in stage.files if name.endswith(".ppm")} for stage in stages]
    assert len(reads) == 2 and textures[0] == textures[1] != set()
    second.colorspace_settings.name = "Non-Color"
    bpy.context.view_layer.update()
    staged(tmp_path, seen)
    assert reads[2:] == ["second"] and first.source == "FILE"


def test_each_use_and_each_folder_has_a_file(tmp_path, reads):
    picture, other = saved("one", tmp_path), tmp_path / "other"
    other.mkdir()
    for _ in range(2):
        for folder in (tmp_path, other):
            export = Export(folder)
            names = {bitmap(export, picture, *use)["filename"] for use in ((), ("Alpha",), ("Color", 2.0))}
            names.add(environment(export, picture))
            assert export.files == names and len(names) == 4 and all((folder / name).exists() for name in names)
    assert len(reads) == 8


def pixels(picture):
    fill(picture, 0.25)


def pixels_and_save(picture):
    fill(picture, 0.25)
    picture.save()


def pixels_and_pack(picture):
    fill(picture, 0.25)
    picture.pack()


@pytest.mark.parametrize("change", [pixels, pixels_and_save, pixels_and_pack])
def test_changed_pixels_are_written(tmp_path, reads, change):
    """Also by scripts, of which Blender tells nobody."""
    picture, export = saved("one", tmp_path), Export(tmp_path)
    before = bitmap(export, picture)["filename"]
    for _ in range(2):
        change(picture)
        after = bitmap(export, picture)["filename"]
        WRITTEN.forget()
        assert after == bitmap(export, picture)["filename"] != before


def test_a_file_that_is_read_again_is_written(tmp_path, reads):
    """Though a stage has met its new date before."""
    picture, export = saved("one", tmp_path), Export(tmp_path)
    before = bitmap(export, picture)["filename"]
    overwrite(picture)
    assert bitmap(export, picture)["filename"] == before
    picture.reload()
    bpy.context.view_layer.update()
    after = bitmap(export, picture)["filename"]
    WRITTEN.forget()
    assert after == bitmap(export, picture)["filename"] != before


def test_a_generated_image_is_read_once_for_each_color(tmp_path, reads):
    picture, export = bpy.data.images.new("generated", 32, 32), Export(tmp_path)
    names = []
    for color in ((0, 0, 0, 1), (0, 0, 0, 1), (1, 0, 0, 1)):
        picture.generated_color = color
        names.append(bitmap(export, picture)["filename"])
    assert names[0] == names[1] != names[2] and len(reads) == 2
