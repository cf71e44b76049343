"""Requests for pictures, as another program sends them."""

import io
import itertools
import json
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from command_line import assert_one_line, run
from mi_dogsplat import Drawing, Model, write_model
from mi_dogsplat.cli.main import main
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render import denoise
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.requests.answer import Answerer
from mi_dogsplat.requests.fields import KINDS
from mi_dogsplat.requests.gradual import in_steps, means
from mi_dogsplat.requests.request import Request, read_request
from mi_dogsplat.requests.scene_description import load_scene
from mi_dogsplat.requests.serve import Lines, serve
from mi_dogsplat.requests.view_request import ViewRequest
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.scene.radiance import brightened
from scene_requests import answered, camera_json, matrix
from splat_scenes import random_splats, rounded, square_camera

WIDTH, HEIGHT = 24, 16
SPLATS = rounded(random_splats(40, seed=1))
CAMERA = square_camera(WIDTH, HEIGHT, 22.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A model, and a scene in which a lamp hides a small part of a wall behind the model."""
    folder = tmp_path_factory.mktemp("requests")
    write_ply(folder / "model.ply", SPLATS)
    c2w = np.linalg.inv(CAMERA.w2c)
    wall, lamp = c2w @ np.diag([-1.0, -1, 1, 1]), c2w @ np.diag([-0.1, -0.1, 1, 1])
    wall[:3, 3] += 30 * c2w[:3, 2]
    lamp[:3, 3] += 0.5 * c2w[:3, 2]
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    fov = np.degrees(2 * np.arctan(WIDTH / 2 / 22))
    sensor = {"type": "perspective", "fov": fov, "to_world": matrix(c2w @ np.diag([-1.0, -1, 1, 1])), "film": film}
    facing = np.diag([100.0, 100, -1, 1])
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0, 0, 0]}}
    shapes = {
        "object_2_wall": {"type": "rectangle", "to_world": matrix(wall @ facing), "bsdf": black},
        "light_0": {"type": "rectangle", "to_world": matrix(lamp @ np.diag([1.0, 1, -1, 1])), "bsdf": {"type": "null"},
                    "emitter": {"type": "area", "radiance": 5.0}},
        "sky": {"type": "constant", "radiance": 0.25},
    }  # fmt: skip
    (folder / "scene.json").write_text(json.dumps({"sensor": sensor, **shapes}))
    return folder


def told(lines) -> list[dict]:
    said = []
    serve(io.StringIO("".join(f"{json.dumps(line)}\n" for line in lines)), said.append)
    return said


def test_splats_alone_are_the_picture_of_the_command(folder):
    request = {"model": str(folder / "model.ply"), "camera": camera_json(CAMERA), "counts": [10, 30]}
    picture = answered({**request, "passes": ["depth", "normal", "object", "matte"]})
    options = RasterOptions(sh_degree=SPLATS.sh_degree, depth=True)
    expected = render_picture(upload(SPLATS), CAMERA, options)
    np.testing.assert_allclose(picture["color"], expected.color, atol=1e-5)
    np.testing.assert_allclose(picture["alpha"], expected.alpha, atol=1e-5)
    seen = expected.alpha > 0.1
    assert expected.depth is not None
    np.testing.assert_allclose(picture["depth"][seen], expected.depth[seen], rtol=1e-4)
    assert set(np.unique(picture["object"])) == {-1, 0, 1}
    np.testing.assert_allclose(np.linalg.norm(picture["normal"][seen], axis=-1), 1, atol=1e-4)
    covered = picture["alpha"] > 0
    np.testing.assert_array_equal(picture["matte"][covered][:, 0, 0], picture["object"][covered])
    np.testing.assert_allclose(picture["matte"][covered][:, 0, 1], picture["alpha"][covered], atol=1e-6)


def test_a_mirrored_camera_sees_the_mirror_image(folder):
    """As where somebody has mirrored one in Blender; of files of cameras it would be a mistake."""
    mirrored = replace(CAMERA, w2c=np.diag([-1.0, 1, 1, 1]) @ CAMERA.w2c)
    seen, expected = (
        answered({"model": str(folder / "model.ply"), "camera": camera_json(camera)}) for camera in (mirrored, CAMERA)
    )
    np.testing.assert_allclose(seen["color"], expected["color"][:, ::-1], atol=1e-5)


def test_splats_of_a_part_look_as_in_the_whole_picture(folder, monkeypatch):
    """Whose sides hold the shapes of splats beside them, and not those of the part; in bands, too."""
    model, (left, top, right, bottom) = str(folder / "model.ply"), (9, 5, 14, 9)
    part = replace(CAMERA, cx=CAMERA.cx - left, cy=CAMERA.cy - top, width=right - left, height=bottom - top)
    whole = answered({"model": model, "camera": camera_json(CAMERA)})["color"][top:bottom, left:right]
    alone = answered({"model": model, "camera": camera_json(part)})["color"]
    assert np.abs(alone - whole).max() > 0.005
    request = {"model": model, "camera": camera_json(part), "film": [-left, -top, WIDTH - left, HEIGHT - top]}
    np.testing.assert_allclose(answered(request)["color"], whole, atol=1e-5)
    monkeypatch.setattr("mi_dogsplat.requests.answer.BAND_PIXELS", 3 * part.width)  # bands of 3 rows and of one
    np.testing.assert_allclose(answered(request)["color"], whole, atol=1e-5)


def test_splats_alone_along_parallel_rays_have_a_hole_where_a_holdout_is(folder, monkeypatch):
    """Bands and the share of holdouts see what the picture sees."""
    camera = Camera(CAMERA.w2c, 6.0, 6.0, 11.0, 9.5, WIDTH, HEIGHT)
    request = {"model": str(folder / "model.ply"), "camera": camera_json(camera), "orthographic": True}
    request |= {"near_clip": 0.0, "counts": [20, 20]}
    options = RasterOptions(sh_degree=SPLATS.sh_degree)
    expected = render_picture(upload(SPLATS), camera, options, drawn=DrawnAs(near_clip=0.0), perspective=False)
    assert expected.color.std() > 0.05
    np.testing.assert_allclose(answered(request)["color"], expected.color, atol=1e-5)
    held = answered({**request, "holdout": [0]})
    np.testing.assert_allclose(held["alpha"] + held["hole"], expected.alpha, atol=1e-5)
    assert held["hole"].max() > 0.2
    monkeypatch.setattr("mi_dogsplat.requests.answer.BAND_PIXELS", 5 * WIDTH)  # bands of 5 rows, the last of one
    for name, plane in answered({**request, "holdout": [0]}).items():
        np.testing.assert_allclose(plane, held[name], atol=1e-5)


def test_a_holdout_without_primitives_has_a_hole_of_nothing(folder):
    request = {"model": str(folder / "model.ply"), "camera": camera_json(CAMERA), "counts": [40, 0]}
    held, alone = answered({**request, "holdout": [1]}), answered(request)
    assert not held.pop("hole").any() and held.keys() == alone.keys()
    for name, plane in held.items():
        np.testing.assert_array_equal(plane, alone[name])


def test_a_linear_model_is_radiance_alone_and_in_a_scene(folder):
    write_model(folder / "linear.ply", Model(brightened(SPLATS, 4.0), Drawing(linear=True, white=2.0)))
    found = answered({"model": str(folder / "linear.ply"), "camera": camera_json(CAMERA)})["color"]
    options, linear = RasterOptions(SPLATS.sh_degree), DrawnAs(linear=True)
    expected = render_picture(upload(brightened(SPLATS, 4.0)), CAMERA, options, drawn=linear)
    assert found.max() > 1 and expected.radiance is not None
    np.testing.assert_allclose(found, np.maximum(expected.radiance, 0), atol=1e-5)
    for name, linear in (("linear", True), ("model", False)):
        model = mi.load_dict({"type": "dog", "filename": str(folder / f"{name}.ply")})
        scene: Any = load_scene(read_request({"scene": str(folder / "scene.json")}), model)
        assert scene.integrator().drawn_as(scene).linear == linear


def test_a_model_is_not_kept_over_a_change_of_variant(folder):
    """The shape of before is none of the plugins of now."""
    answerer, request = Answerer(), {"scene": str(folder / "scene.json"), "model": str(folder / "model.ply")}
    asked = read_request({**request, "samples": 1})
    (*_, (_, before)) = answerer.answer(asked)
    variant = str(mi.variant())
    mi.set_variant("scalar_rgb")
    mi.set_variant(variant)
    (*_, (_, after)) = answerer.answer(asked)
    assert before and after
    np.testing.assert_array_equal(after["color"], before["color"])


def test_passes_of_a_scene_look_past_lamps(folder):
    request = {"scene": str(folder / "scene.json"), "samples": 4, "passes": ["depth", "normal", "object", "matte"]}
    picture = answered(request)
    np.testing.assert_allclose(picture["depth"], 30, rtol=1e-4)
    assert (picture["object"] == 2).all() and (picture["matte"][..., 0, 0] == 2).all()
    np.testing.assert_allclose(picture["matte"][..., 0, 1], 1, atol=1e-5)
    toward = -np.linalg.inv(CAMERA.w2c)[:3, 2]
    np.testing.assert_allclose(picture["normal"], np.broadcast_to(toward, (HEIGHT, WIDTH, 3)), atol=1e-4)


def test_the_camera_does_not_see_lamps_that_are_hidden(folder):
    request = {"scene": str(folder / "scene.json"), "samples": 4}
    middle = np.s_[HEIGHT // 2, WIDTH // 2]
    assert answered(request)["color"][middle].max() == pytest.approx(5.0, rel=1e-3)
    assert answered({**request, "hide_lamps": True})["color"][middle].max() < 1e-3


def test_a_scene_is_denoised_where_that_is_asked_for(folder):
    """When all samples are there; holdouts and alpha stay."""
    described = json.loads((folder / "scene.json").read_text())
    described["object_2_wall"]["bsdf"] = {"type": "diffuse"}
    (folder / "bright.json").write_text(json.dumps(described))
    request = {"scene": str(folder / "bright.json"), "samples": 16, "transparent": True, "seed": 1}
    for model in ({}, {"model": str(folder / "model.ply"), "counts": [10, 30], "holdout": [1]}):
        truth = answered(request | model | {"samples": 196})
        *_, before, (_, clean) = Answerer().answer(read_request(request | model | {"denoise": True}))
        plain = answered(request | model)
        assert clean is not None and before[1] is not None and clean["color"].shape == plain["color"].shape
        np.testing.assert_array_equal(clean["alpha"], plain["alpha"])
        errors = [float(np.abs(image["color"] - truth["color"]).mean()) for image in (plain, clean)]
        assert errors[1] < 0.6 * errors[0], errors


def test_a_denoiser_that_is_not_there_is_one_line_before_anything_is_drawn(folder, monkeypatch):
    monkeypatch.setattr(denoise, "find_spec", lambda name: None)
    (said,) = told([{"out": "a.npz", "scene": str(folder / "scene.json"), "samples": 10**6, "denoise": True}])
    assert said["error"].startswith('"denoise": needs the package mitsuba-oidn; pip install')


def test_splats_in_a_scene_are_in_front_of_its_surfaces(folder):
    request = {"scene": str(folder / "scene.json"), "model": str(folder / "model.ply"), "samples": 1}
    picture = answered({**request, "counts": [10, 30], "passes": ["depth", "object"], "near_clip": 0.2})
    alone = answered({"model": str(folder / "model.ply"), "camera": camera_json(CAMERA), "passes": ["depth"]})
    assert {-1, 2} & set(np.unique(picture["object"])) == {2} and {0, 1} & set(np.unique(picture["object"]))
    covered = alone["alpha"] > 0  # not where negative lobes prevail
    alpha, depth = alone["alpha"][covered], alone["depth"][covered]
    np.testing.assert_allclose(picture["depth"][covered], alpha * depth + (1 - alpha) * 30, rtol=1e-3)


def test_surfaces_of_a_scene_cast_shadows_onto_splats_where_that_is_asked_for(folder):
    """A wall behind the camera hides what the splats in front of it have of the sky."""
    described = json.loads((folder / "scene.json").read_text())
    c2w = np.linalg.inv(CAMERA.w2c)
    c2w[:3, 3] -= 0.1 * c2w[:3, 2]
    del described["light_0"]
    described["object_3_wall"] = described["object_2_wall"] | {"to_world": matrix(c2w @ np.diag([100.0, 100, 1, 1]))}
    (folder / "dark.json").write_text(json.dumps(described))
    request = {"scene": str(folder / "dark.json"), "model": str(folder / "model.ply"), "samples": 1}
    dark, light = (answered(request | how)["color"].mean() for how in ({"mesh_shadows": True}, {}))
    assert dark < 0.6 * light


def test_a_wrong_request_is_one_line_and_the_next_one_is_answered(folder):
    out, model = str(folder / "out.npz"), str(folder / "model.ply")
    good = {"out": out, "model": model, "camera": camera_json(CAMERA)}
    wrong = [
        {"model": model}, {**good, "camera": None}, {**good, "pases": []}, {**good, "passes": ["detph"]}, [1],
        {**good, "model": "none.ply"}, {"out": out, "scene": "none.json"},
        {"out": out, "scene": str(folder / "scene.json"), "orthographic": True}, {**good, "scene": "scene.json"},
        {**good, "out": "a\0.npz"}, {**good, "out": "a\0.rgba"}, {**good, "out": "\ud800.npz"},
        {**good, "camera": {**camera_json(CAMERA), "width": 200_000}},
    ]  # fmt: skip
    said = told([*wrong, good])
    assert [next(iter(line)) for line in said] == ["error"] * len(wrong) + ["done"]
    assert all("\n" not in line["error"] and "; " in line["error"] for line in said[:-1])
    assert np.load(out)["color"].shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize("counts", [[39], [10, 31]])
def test_objects_that_are_not_all_of_the_model_are_refused_whatever_is_asked_for(folder, counts):
    """Splats beyond them would be of an object that nobody knows."""
    alone = {"camera": camera_json(CAMERA), "passes": ["object"]}
    for asked in (alone, {"scene": str(folder / "scene.json"), "samples": 1}):
        (said,) = told([{"out": "a.npz", "model": str(folder / "model.ply"), "counts": counts, **asked}])
        assert said["error"].startswith(f'request: "counts" adds up to {sum(counts)}, the model has 40 primitives;')


def test_lines_that_are_no_text_or_too_deep_are_answered(tmp_path, capfd):
    (tmp_path / "requests").write_bytes(b"\xff\xfe\n" + b"[" * 100_000 + b"\n")
    status = main(["serve", str(tmp_path / "requests"), "--variant", mi.variant() or "auto"])
    first, second = map(json.loads, capfd.readouterr().out.splitlines())
    assert status == 0 and "not valid JSON" in first["error"] and "too deep" in second["error"]


def test_a_mark_of_the_byte_order_before_the_first_line_is_no_part_of_it(folder, tmp_path, capfd):
    request = {"out": str(tmp_path / "a.npz"), "model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    (tmp_path / "requests").write_text(json.dumps(request), encoding="utf-8-sig")
    status = main(["serve", str(tmp_path / "requests"), "--variant", mi.variant() or "auto"])
    assert status == 0 and json.loads(capfd.readouterr().out.splitlines()[-1]) == {"done": request["out"]}


def test_a_picture_beyond_the_memory_is_one_line_and_the_next_one_is_answered(folder, tmp_path):
    scene = {"scene": str(folder / "scene.json"), "samples": 10**13}
    view = {**scene, "out": str(tmp_path / "view.rgba"), "camera": camera_json(CAMERA)}
    good = {"out": str(tmp_path / "b.npz"), "model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    first, second, third = told([{**scene, "out": str(tmp_path / "a.npz")}, view, good])
    assert third == {"done": good["out"]}
    for said in (first, second):
        assert said["error"].startswith("request: not enough memory (") and "; ask for fewer" in said["error"]


def test_a_stream_that_fails_is_a_stream_that_ends():
    def failing():
        yield "first"
        raise OSError("gone")

    assert list(Lines(failing())) == ["first"]


def test_a_picture_that_does_not_fit_leaves_nothing(folder, tmp_path, monkeypatch):
    """A viewport's, on a disk that is full."""
    def full(self, target):
        raise OSError("5 requested and 3 written")  # as NumPy says it, without the system's words

    monkeypatch.setattr(Path, "replace", full)
    model = str(folder / "model.ply")
    (said,) = told([{"out": str(tmp_path / "view.rgba"), "model": model, "camera": camera_json(CAMERA)}])
    assert "view_0.rgba: cannot be written (5 requested and 3 written)" in said["error"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": -1}, {"seed": 1.5}, {"seed": "a"}, {"seed": 2**33}, {"near_clip": [1]}, {"near_clip": -1},
        {"samples": float("nan")}, {"samples": 1.5}, {"samples": True}, {"samples": "3"}, {"samples": 0},
        {"max_depth": 2.5}, {"max_depth": 2**31}, {"antialiased": "x"}, {"counts": [-1]}, {"counts": 3},
        {"passes": "depth"}, {"model": 3},
    ],
    ids=json.dumps,
)  # fmt: skip
def test_a_field_of_the_wrong_kind_is_named(folder, wrong):
    good = {"out": str(folder / "out.npz"), "model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    (said,) = told([good | wrong])
    assert f'"{next(iter(wrong))}" is' in said["error"] and "give " in said["error"]


@pytest.mark.parametrize("scene", [{"sky": {"type": "constant", "radiance": None}}, {"sky": None}, {"sky": [None]}])
def test_null_in_a_scene_is_one_line(folder, scene):
    """``mi.load_dict`` would end the process."""
    (folder / "null.json").write_text(json.dumps(scene))
    (said,) = told([{"out": str(folder / "out.npz"), "scene": str(folder / "null.json")}])
    assert "null.json" in said["error"] and "null" in said["error"]


@pytest.mark.parametrize("model", [True, False], ids=["with splats", "without"])
@pytest.mark.parametrize("hide_lamps", [True, False])
def test_alpha_of_the_sky_is_one_unless_the_scene_is_transparent(folder, model, hide_lamps):
    far = {"model": str(folder / "behind.ply")} if model else {}
    write_ply(folder / "behind.ply", replace(SPLATS, means=SPLATS.means - 50 * CAMERA.w2c[2, :3]))
    scene = json.loads((folder / "scene.json").read_text())
    (folder / "sky.json").write_text(json.dumps({name: scene[name] for name in ("sensor", "sky")}))
    request = {"scene": str(folder / "sky.json"), **far, "samples": 2, "hide_lamps": hide_lamps}
    np.testing.assert_array_equal(answered(request)["alpha"], 1)
    np.testing.assert_allclose(answered(request)["color"], 0.25, rtol=1e-3)
    np.testing.assert_array_equal(answered({**request, "transparent": True})["alpha"], 0)


@pytest.mark.parametrize(
    "asked, parts",
    [((1, 8), [1]), ((8, 8), [8]), ((9, 8), [9]), ((20, 8), [10, 10]), ((6, 2, 1), [1, 2, 3]), ((1, 2, 1), [1])],
)
def test_steps_of_a_scene_are_of_one_size_and_independent(monkeypatch, asked, parts):
    """No pass has the random numbers of another one, nor those of another seed or part."""
    assert (steps := in_steps(*asked)) == parts
    seeds = []

    def render(scene, sensor, spp, seed):
        seeds.extend((seed * spp + k) % 2**32 for k in range(spp))  # as passes are numbered
        return np.zeros((HEIGHT, WIDTH, 4))

    monkeypatch.setattr(mi, "render", render)
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT}
    scene: Any = mi.load_dict({"type": "scene", "sensor": {"type": "perspective", "film": film}})
    for seed, part in itertools.product(range(20), (0, 64)):
        found = means(scene, scene.sensors()[0], Request(seed=seed), steps, part)
        assert [mean.done for mean in found] == list(np.cumsum(parts))
    assert len(seeds) == len(set(seeds)) == 40 * sum(parts)


@pytest.mark.parametrize("kind", [Request, ViewRequest])
def test_each_field_has_its_kind(kind):
    assert {field.name for field in fields(kind)} - {"camera"} <= set(KINDS)


def test_a_scene_that_mitsuba_refuses_is_one_line(folder):
    (folder / "broken.json").write_text(json.dumps({"thing": {"type": "nonsense"}}))
    (said,) = told([{"out": str(folder / "out.npz"), "scene": str(folder / "broken.json")}])
    assert "broken.json" in said["error"] and "nonsense" in said["error"]


@pytest.mark.parametrize("name", ["object_3000000000", "object_16777217", "object_-1", "object_wall", "object_"])
def test_an_id_without_a_number_of_an_object_is_named_and_the_next_request_is_answered(folder, name):
    shapes = json.loads((folder / "scene.json").read_text())
    (folder / "numbered.json").write_text(json.dumps({**shapes, name: {"type": "sphere"}}))
    request = {"out": str(folder / "out.npz"), "scene": str(folder / "numbered.json"), "samples": 1}
    good = {"out": str(folder / "out.npz"), "model": str(folder / "model.ply"), "camera": camera_json(CAMERA)}
    said = told([{**request, "passes": ["object"]}, good])
    problem = f'cannot be drawn (the id "{name}" has no number of an object from 0 to 16777216)'
    assert said == [{"error": f"{folder / 'numbered.json'}: {problem}; correct it"}, {"done": good["out"]}]


@pytest.mark.parametrize("model", [{"model": "model.ply"}, {}], ids=["with splats", "without"])
@pytest.mark.parametrize("pixel_format", ["rgb", "luminance_alpha", "xyza"])
def test_a_film_without_colour_and_alpha_is_one_line(folder, monkeypatch, pixel_format, model):
    """A sensor which says nothing about it has one of rgb."""
    monkeypatch.chdir(folder)
    content = json.loads((folder / "scene.json").read_text())
    content["sensor"]["film"]["pixel_format"] = pixel_format
    (folder / "film.json").write_text(json.dumps(content))
    (said,) = told([{"out": "out.npz", "scene": "film.json", "samples": 1, **model}])
    assert said["error"] == f'film.json: has a film of {pixel_format}; give it the "pixel_format" rgba'


def test_a_process_ends_when_nobody_asks():
    def slow():
        yield "first"
        import time

        time.sleep(30)

    assert list(Lines(slow(), 0.05)) == ["first"]
    assert list(Lines(["a"], float("inf"))) == list(Lines(["a"], 1e10)) == ["a"]
    assert list(Lines(["a", "b"], 60)) == list(Lines(["a", "b"])) == ["a", "b"]


@pytest.mark.parametrize("seconds", ["0", "-3", "nan"])
def test_waiting_takes_some_time(seconds, capsys):
    assert_one_line(run(capsys, "serve", "--idle", seconds), "--idle")


def test_what_mitsuba_prints_is_no_answer(folder):
    """The command, which has standard output for answers alone."""
    out, model = str(folder / "command.npz"), str(folder / "model.ply")
    line = json.dumps({"out": out, "model": model, "camera": camera_json(CAMERA)})
    words = [sys.executable, "-m", "mi_dogsplat", "serve", "--variant", mi.variant() or "auto"]
    done = subprocess.run(words, input=f"{line}\n{{}}\n", capture_output=True, text=True, check=True)
    first, second = map(json.loads, done.stdout.splitlines())
    assert first == {"done": out} and "out" in second["error"]
