"""Render Animation, which gives keys to evaluated data alone: each frame is drawn by the values of that frame."""

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from model_files import load
from references import place_camera
from surroundings import GREY, background, body, material, plane

from blender_addon import render_engine
from blender_addon.files.ply import read_ply
from blender_addon.nodes.modifier import input_property, splat_modifier


def frames(scene, monkeypatch, folder) -> list[SimpleNamespace]:
    """The orders of two frames, and what their pictures show where nothing is before the world."""
    found, values = [], render_engine.passes.values

    def show(order, picture, world_scene):
        made = values(order, picture, world_scene)
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
