"""Render Animation, which gives keys to evaluated data alone: each frame is drawn by the values of that frame."""

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from blender_pictures import picture
from model_files import load
from references import place_camera
from surroundings import GREY, background, body, material, plane

from blender_addon import render_engine
from blender_addon.files.ply import read_ply
from blender_addon.nodes.modifier import input_property, splat_modifier


def frames(scene, monkeypatch, folder) -> list[SimpleNamespace]:
    """The orders of two frames, and what their pictures show where nothing is before the world."""
    found, values = [], render_engine.passes.values

    def show(order, *given):
        made = values(order, *given)
        found.append(SimpleNamespace(order=order, corner=made["Combined"][0, 0].tolist()))
        return made

    def render(request, cancelled, progress, preview):
        return {"color": np.zeros((64, 96, 3), np.float32), "alpha": np.zeros((64, 96), np.float32)}

    renderer = SimpleNamespace(name="none", folder=folder, render=render)
    monkeypatch.setattr(render_engine, "choose_renderer", lambda command: renderer)
    monkeypatch.setattr(render_engine, "tidy", lambda *_: None)
    monkeypatch.setattr(render_engine.passes, "values", show)
    scene.render.engine, scene.dogsplat_colors = render_engine.ENGINE, "DISPLAY"
    scene.frame_start, scene.frame_end, scene.render.filepath = 1, 2, str(folder / "frame_")
    scene.frame_set(1)
    bpy.ops.render.render(animation=True)
    assert len(found) == 2
    return found


def key(owner, path: str, *values) -> None:
    """Keys in the frames 1, 2 and so on, for a property or an input of nodes."""
    for frame, value in enumerate(values, start=1):
        if path.startswith("["):
            owner[path[2:-2]] = value
        else:
            setattr(owner, path, value)
        owner.keyframe_insert(path, frame=frame)


@pytest.mark.parametrize("name, values, said", [
    ("Near Clip", (0.2, 1.0), lambda request: request["near_clip"]),
    ("SH Degree", (3, 0), lambda request: read_ply(Path(request["model"])).sh_degree),
    ("DoG", (True, False), lambda request: bool(read_ply(Path(request["model"])).is_dog.any())),
])  # fmt: skip
def test_inputs_of_the_modifier(scene, monkeypatch, tmp_path, model, name, values, said):
    place_camera(scene, "dog")
    key(*input_property(splat_modifier(load(model)), name), *values)
    found = [said(frame.order.request) for frame in frames(scene, monkeypatch, tmp_path)]
    assert found == pytest.approx(values)


def test_pass_indices_of_splats_and_meshes(scene, monkeypatch, tmp_path, model):
    """Of two models of one name, too, one of which is of another file."""
    place_camera(scene, "dog")
    splats, wall = load(model), body(plane(5), material("ShaderNodeBsdfDiffuse"))
    splats.pass_index = 7
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {splats})
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, loaded):
        loaded.objects = [splats.name]
    scene.collection.objects.link(loaded.objects[0])
    key(splats, "pass_index", 3, 4)
    key(wall, "pass_index", 5, 6)
    name, mesh = splats.name, wall.name
    for frame, indices in zip(frames(scene, monkeypatch, tmp_path), ((3, 5), (4, 6)), strict=True):
        assert sorted(frame.order.objects) == sorted([(name, indices[0]), (name, 7), (mesh, indices[1])])


@pytest.mark.parametrize("name, values, mask", [
    ("is_holdout", (False, True), "holdout"), ("visible_camera", (True, False), "indirect_only"),
])  # fmt: skip
def test_masks_of_splats_and_meshes(scene, monkeypatch, tmp_path, model, name, values, mask):
    place_camera(scene, "dog")
    for obj in (load(model), body(plane(5), material("ShaderNodeBsdfDiffuse"))):
        key(obj, name, *values)
    first, second = frames(scene, monkeypatch, tmp_path)
    assert mask not in first.order.request and second.order.request[mask] == [0, 1]


def test_the_world_behind_splats_alone(scene, monkeypatch, tmp_path, model):
    place_camera(scene, "dog")
    load(model)
    node, colors = background(scene), ((1, 0, 0, 1), (0, 1, 0, 1))
    key(node.inputs["Color"], "default_value", *colors)
    for frame, color in zip(frames(scene, monkeypatch, tmp_path), colors, strict=True):
        assert frame.corner == pytest.approx(color)


def test_the_world_of_a_whole_scene(scene, monkeypatch, tmp_path):
    place_camera(scene, "dog")
    plane(5)
    key(background(scene, GREY).inputs["Strength"], "default_value", 1.0, 2.0)
    first, second = (
        json.loads(Path(frame.order.request["scene"]).read_text())["world"]["radiance"]["value"]
        for frame in frames(scene, monkeypatch, tmp_path)
    )
    assert second == pytest.approx([2 * value for value in first])


@pytest.mark.parametrize("flat", [(0, 0, 0), (1, 1, 0)])
def test_a_model_that_grows_from_nothing(scene, monkeypatch, tmp_path, model, flat):
    """Its first frame has none of its splats, and says so; another model is there in both."""
    place_camera(scene, "dog")
    growing, other = load(model), load(model)
    key(growing, "scale", flat, (1, 1, 1))
    first, second = (frame.order for frame in frames(scene, monkeypatch, tmp_path))
    names = [of.name for of in first.objects]
    number = names.index(growing.name)
    assert first.request["counts"][number] == 0 and first.request["counts"][1 - number] == 150
    assert second.request["counts"] == [150, 150] and first.objects == second.objects
    assert first.notes == [f'"{growing.name}": its splats are left out, as it is scaled to nothing along an axis']
    assert second.notes == [] and other.name in names


@pytest.mark.parametrize("bodies", [False, True])
def test_a_scene_whose_only_splats_are_scaled_to_nothing_is_drawn(scene, by_command, tmp_path, model, bodies):
    """By the package: black, or the bodies alone."""
    place_camera(scene, "dog")
    obj = load(model)
    if bodies:
        body(plane(5), material("ShaderNodeEmission", Color=GREY))
    obj.scale = 0, 0, 0
    scene.dogsplat.samples = 4
    found = picture(scene, render_engine.ENGINE, tmp_path)
    assert found.max() == (pytest.approx(0.5, abs=0.01) if bodies else 0)


def test_where_all_splats_are_hidden_for_a_while_the_animation_goes_on(scene, monkeypatch, tmp_path, model):
    """With the world alone, and a line that says so."""
    place_camera(scene, "dog")
    key(load(model), "hide_render", True, False)
    background(scene, (1, 0, 0, 1))
    first, second = frames(scene, monkeypatch, tmp_path)
    assert first.order.request["counts"] == [0] and first.order.notes == ["all splats are hidden from this picture"]
    assert second.order.request["counts"] == [150] and second.order.notes == []
    assert first.corner == second.corner == pytest.approx((1, 0, 0, 1))
