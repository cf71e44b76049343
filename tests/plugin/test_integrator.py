"""The integrator plugin through ``mi.render``: pictures, films, backgrounds and errors."""

from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, device_array
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.splats import Splats
from splat_scenes import (
    axis_rotation,
    dog_dict,
    kernels,
    make_splats,
    random_splats,
    rounded,
    scalar_transform,
    scene_of,
    select,
    sensor_dict,
    square_camera,
    to_linear,
    to_srgb,
)

MODEL = rounded(random_splats(60, seed=1))
CAMERA = square_camera()
SCENES = Path(__file__).parents[2] / "scenes"


def render(scene: mi.Scene, **choices) -> np.ndarray:
    return np.array(mi.render(scene, **choices))


def expected_image(splats: Splats, camera: Camera = CAMERA, background=(0, 0, 0), **choices) -> np.ndarray:
    return to_linear(reference.render(splats, camera, to_srgb(np.array(background, float)), **choices)[0])


def assert_close(got: np.ndarray, expected: np.ndarray):
    assert got.shape == expected.shape
    assert np.abs(got - expected).mean() < 2e-5


# Pictures

@pytest.mark.parametrize("choices", [{}, {"antialiased": True}, {"near_clip": 2.5},
                                     {"negative_transmittance": False}], ids=str)
def test_the_render_is_the_twin_in_linear_radiance(choices):
    assert_close(render(scene_of(MODEL, CAMERA, **choices)), expected_image(MODEL, **choices))


def test_without_srgb_primitives_the_film_receives_the_blended_values():
    got = render(scene_of(MODEL, CAMERA, srgb_primitives=False))
    assert_close(got, reference.render(MODEL, CAMERA)[0])


def test_values_below_zero_and_above_one_reach_the_film():
    splats = rounded(make_splats([[-0.3, 0, 2], [0.4, 0, 3]], 0.2, 0.9, [[3, 2, 5], [1, 1, 1]], dog=[1], f_a=0.8, F=2))
    blended = reference.render(splats, CAMERA)[0]
    assert blended.max() > 2 and blended.min() < -0.1
    assert_close(render(scene_of(splats, CAMERA)), to_linear(blended))


@pytest.mark.parametrize("cx, cy", [(3.0, 25.0), (47.0, -4.0)])
def test_a_principal_point_anywhere_is_that_of_the_twin(cx, cy):
    camera = square_camera(cx=cx, cy=cy)
    assert_close(render(scene_of(MODEL, camera)), expected_image(MODEL, camera))


@pytest.mark.parametrize("crop", [(0, 0, 40, 30), (7, 5, 20, 11), (39, 29, 1, 1), (0, 12, 40, 3)])
def test_a_crop_window_is_cut_out_of_the_whole_image(crop):
    x, y, width, height = crop
    film = {"crop_offset_x": x, "crop_offset_y": y, "crop_width": width, "crop_height": height}
    whole, part = render(scene_of(MODEL, CAMERA)), render(scene_of(MODEL, CAMERA, film=film))
    assert_close(part, whole[y:y + height, x:x + width])


def test_to_world_equals_a_camera_that_moves_the_other_way():
    rotation = axis_rotation([0.5, 1, -2], 1.3)[0]
    matrix = affine(rotation, (0.7, -0.2, 3))
    moved = Camera(CAMERA.w2c @ np.linalg.inv(matrix), CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 40, 30)
    got = render(scene_of(MODEL, moved, {"to_world": scalar_transform(matrix)}))
    assert_close(got, expected_image(MODEL))


def test_several_shapes_are_one_model_whatever_their_sh_degrees_and_dog_parts():
    parts = [rounded(random_splats(n, seed=n, degree=degree, dog_share=share))
             for n, degree, share in ((20, 1, 0), (15, 3, 0.6), (1, 0, 0), (25, 2, 0))]

    def padded(s: Splats) -> np.ndarray:
        return np.pad(s.sh_coeffs, ((0, 0), (0, 16 - s.sh_coeffs.shape[1]), (0, 0)))

    whole = Splats(**{name: np.concatenate([getattr(s, name) for s in parts]) for name in RAW if name != "sh_coeffs"},
                   sh_coeffs=np.concatenate([padded(s) for s in parts]), dog_index=parts[1].dog_index + 20,
                   dog_logit_opacities=parts[1].dog_logit_opacities, dog_log_scales=parts[1].dog_log_scales)
    extra = {f"part{i}": dog_dict(s) for i, s in enumerate(parts[1:])}
    scene = scene_of(parts[0], CAMERA, extra=extra)
    assert_close(render(scene), expected_image(whole))
    assert_close(render(scene_of(Splats.empty(1), CAMERA, extra={"other": dog_dict(MODEL)})), expected_image(MODEL))


@pytest.mark.parametrize("n", [0, 1])
def test_no_and_one_primitive_render(n):
    splats = select(MODEL, n)
    assert_close(render(scene_of(splats, CAMERA)), expected_image(splats))


def test_another_number_of_primitives_renders_right_after_update():
    scene = scene_of(MODEL, CAMERA)
    render(scene)
    params: Any = mi.traverse(scene)
    for n, degree in ((25, 2), (90, 3)):
        other = rounded(random_splats(n, seed=n, degree=degree))
        for name in RAW + RAW_DOG:
            params[f"splats.{name}"] = mi.TensorXf(getattr(other, name))
        params["splats.dog_index"] = mi.UInt32(other.dog_index)
        params.update()
        assert_close(render(scene), expected_image(other))
    none_is_dog = {"dog_logit_opacities": np.zeros(0), "dog_log_scales": np.zeros((0, 3))}
    for name, values in none_is_dog.items():
        params[f"splats.{name}"] = mi.TensorXf(values.astype(np.float32))
    params["splats.dog_index"] = mi.UInt32()
    params.update()
    plain = Splats(**{name: getattr(other, name) for name in RAW})
    assert_close(render(scene), expected_image(plain))


def test_rendering_and_deriving_another_number_of_primitives_needs_no_new_kernel():
    """As long as memory that comes from NumPy is aligned: Dr.Jit compiles another kernel where it is not.

    Dr.Jit orders the adjoints of the leaves by the indices of its variables, which it reuses: the same step comes in
    two orders, which are two kernels, whatever N is. The warm-up meets both.
    """
    model = random_splats(600, seed=1)
    scene = scene_of(select(model, 100), CAMERA)
    params: Any = mi.traverse(scene)

    def step(n: int) -> None:
        splats = select(model, n)
        for name in RAW_PARAMETERS:
            values = getattr(splats, name)
            params[f"splats.{name}"] = mi.TensorXf(device_array(values), values.shape)
            dr.enable_grad(params[f"splats.{name}"])
        params["splats.dog_index"] = device_array(splats.dog_index, mi.UInt32)
        params.update()
        dr.backward(dr.sum(dr.square(mi.render(scene, params)), axis=None))

    known = kernels(lambda: [step(n) for n in (100, 101, 100, 200, 200, 4, 100, 300, 300, 100)])
    for n in (137, 500, 3, 600, 100):
        new = kernels(lambda n=n: step(n)) - known
        assert not new, f"N = {n}: {len(new)} new kernels"


def test_one_sample_is_at_the_pixel_centres_whatever_filter_and_seed():
    scene = scene_of(MODEL, CAMERA, film={"rfilter": {"type": "gaussian"}})
    image = render(scene)
    np.testing.assert_array_equal(render(scene, spp=1, seed=5), image)
    assert_close(image, expected_image(MODEL))


# Films and channels

def test_films_of_every_pixel_format_hold_the_image():
    rgb, alpha = expected_image(MODEL), 1 - reference.render(MODEL, CAMERA)[1]
    assert_close(render(scene_of(MODEL, CAMERA, film={"pixel_format": "rgb"})), rgb)
    rgba = render(scene_of(MODEL, CAMERA, film={"pixel_format": "rgba"}))
    assert_close(rgba, np.dstack([rgb, alpha]))
    luminance = render(scene_of(MODEL, CAMERA, film={"pixel_format": "luminance"}))
    assert_close(luminance.reshape(30, 40), rgb @ [0.212671, 0.715160, 0.072169])


def test_alpha_and_depth_are_channels_of_their_own():
    _, T, depth = reference.render(MODEL, CAMERA)
    expected = {"alpha": 1 - T, "depth": np.where(1 - T > 0, depth / np.where(T == 1, 1, 1 - T), 0)}
    for aovs in ("alpha, depth", "depth", "alpha"):
        got = render(scene_of(MODEL, CAMERA, aovs=aovs))
        names = [name.strip() for name in aovs.split(",")]
        assert got.shape == (30, 40, 3 + len(names))
        for name, plane in zip(names, np.moveaxis(got[..., 3:], -1, 0), strict=True):
            solid = 1 - T > 0.05
            assert np.abs(plane - expected[name])[solid].mean() < 1e-4, name
    both = render(scene_of(MODEL, CAMERA, film={"pixel_format": "rgba"}, aovs="alpha"))
    np.testing.assert_allclose(both[..., 3], both[..., 4], atol=1e-6)


def test_an_expected_depth_lies_between_the_primitives():
    splats = rounded(make_splats([[0, 0, 2], [0, 0, 4]], 1e4, 0.5))
    camera = Camera(np.eye(4), 30, 30, 20, 15, 40, 30)
    got = render(scene_of(splats, camera, aovs="depth"))
    np.testing.assert_allclose(got[..., 3], (2 * 0.5 + 4 * 0.25) / 0.75, rtol=1e-4)


# Backgrounds

def envmap() -> dict[str, Any]:
    """A smooth environment without symmetry, turned; the twin of the background is what ``path`` sees of it."""
    y, x = np.mgrid[0:32, 0:64]
    image = np.stack([1 + np.sin(x / 10), 1 + np.cos(y / 8), x / 64 + y / 32], -1).astype(np.float32)
    turned = mi.ScalarTransform4f().rotate([2 / 3, 1 / 3, 2 / 3], 40)  # an axis that is no unit vector would shear
    return {"type": "envmap", "bitmap": mi.Bitmap(image), "to_world": turned}


@pytest.mark.parametrize("camera", [CAMERA, square_camera(cx=10, cy=22)], ids=["centred", "off-centre"])
def test_an_environment_map_is_seen_the_right_way_round(camera):
    behind = {"sky": envmap()}
    empty = mi.load_dict({"type": "scene", "integrator": {"type": "path"}, "sensor": sensor_dict(camera), **behind})
    expected = render(empty, spp=256)
    got = render(scene_of(Splats.empty(0), camera, extra=behind))
    assert np.abs(got - expected).max() < 0.03  # `path` averages over a pixel
    image, T, _ = reference.render(MODEL, camera)
    over = to_linear(image + T[..., None] * to_srgb(got.astype(float)))
    assert_close(render(scene_of(MODEL, camera, extra=behind)), over)


def test_an_environment_map_stays_in_place_behind_a_crop_window():
    behind = {"sky": envmap()}
    film = {"crop_offset_x": 7, "crop_offset_y": 5, "crop_width": 20, "crop_height": 11}
    whole = render(scene_of(Splats.empty(0), CAMERA, extra=behind))
    part = render(scene_of(Splats.empty(0), CAMERA, film=film, extra=behind))
    np.testing.assert_allclose(part, whole[5:16, 7:27], atol=1e-5)


@pytest.mark.parametrize("srgb_primitives", [True, False])
def test_a_constant_emitter_shows_behind_the_splats(srgb_primitives):
    radiance = np.array([0.2, 0.5, 1.5])
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": radiance.tolist()}}
    got = render(scene_of(MODEL, CAMERA, extra={"sky": sky}, srgb_primitives=srgb_primitives))
    expected = (expected_image(MODEL, background=radiance) if srgb_primitives
                else reference.render(MODEL, CAMERA, radiance)[0])
    assert_close(got, expected)


# Errors

def test_wrong_use_is_refused_with_a_line_that_says_why():
    cases: list[tuple[dict[str, Any], str]] = [
        ({"aovs": "alpha, albedo"}, 'unknown AOV "albedo"; available are alpha, depth'),
        ({"near_clip": -1.0}, "near_clip"),
        ({"near_clip": float("nan")}, "near_clip"),
        ({"near_clip": float("inf")}, "near_clip"),
        ({"ball": {"type": "sphere"}}, "dogsplat: it nests an integrator and no Sphere"),
        ({"max_depth": 5}, 'dogsplat: "max_depth" is of integrators that trace paths; give it to the nested one'),
        ({"rr_depth": 5}, 'dogsplat: "rr_depth" is of integrators that trace paths; give it to the nested one'),
        ({"antialiased": "false"}, 'dogsplat: "antialiased" is \'false\', it must be true or false'),
        ({"aovs": True}, '"aovs" is True, it must be a string'),
        ({"samples": 3}, "samples"),
    ]
    for given, problem in cases:
        with pytest.raises(RuntimeError, match=problem):
            mi.load_dict({"type": "dogsplat", **given})


def problem_of(scene: mi.Scene, **choices) -> str:
    """What a render fails with: Mitsuba wraps it, Python shows it above."""
    with pytest.raises(RuntimeError) as failed:
        mi.render(scene, **choices)
    return str(failed.value.__cause__)


def test_the_number_of_samples_is_none_below_zero_and_whole_and_a_seed_may_be_of_numpy():
    scene = scene_of(MODEL, CAMERA)
    with pytest.raises(RuntimeError, match="dogsplat: seed is -1, it must not be negative"):
        scene.integrator().render(scene, seed=cast("Any", -1), spp=2)  # ``mi.render`` takes no such one
    assert problem_of(scene, spp=-1) == "dogsplat: spp is -1, it must not be negative; 0 asks for that of the sampler"
    most = "it must be at most 262144; average several renders"
    assert problem_of(scene, spp=99999999999) == f"dogsplat: spp is 99999999999, {most}"
    assert problem_of(scene, spp=2.5) == "dogsplat: spp is 2.5, it must be a whole number"  # as in C++
    assert problem_of(scene, spp=2.0) == "dogsplat: spp is 2.0, it must be a whole number"
    of_numpy, plain = (mi.render(scene, spp=3, seed=seed) for seed in cast("list[Any]", [np.uint32(5), 5]))
    np.testing.assert_array_equal(of_numpy, plain)


@pytest.mark.parametrize("name", ["to_world", "x_fov"])
def test_a_sensor_of_several_lanes_is_an_error_that_names_what_has_them(name):
    scene: Any = scene_of(MODEL, CAMERA)
    params = mi.traverse(scene)
    two = mi.Float([30, 40])
    params[f"sensor.{name}"] = mi.Transform4f().translate(mi.Point3f(two, 0, 0)) if name == "to_world" else two
    params.update()
    assert problem_of(scene) == f'a sensor has one "{name}", this one is 2 lanes wide'


def test_a_scene_without_a_dog_shape_is_an_error():
    scene: Any = mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat"}, "ball": {"type": "sphere"},
                               "sensor": sensor_dict(CAMERA)})
    assert 'no shape of type "dog"' in problem_of(scene)


def test_a_sampler_without_samples_is_an_error_where_samples_are_averaged():
    ball, sampler = {"ball": {"type": "sphere"}}, {"type": "independent", "sample_count": 0}
    scene: Any = mi.load_dict({"type": "scene", "integrator": {"type": "dogpath"}, "splats": dog_dict(MODEL), **ball,
                               "sensor": {**sensor_dict(CAMERA), "sampler": sampler}})
    assert 'the "sample_count" of the sampler is 0; give it, or spp, 1 or more' in problem_of(scene)


def test_a_sensor_that_cannot_be_splatted_is_an_error_that_names_it_and_those_that_can():
    sensor = {"type": "radiancemeter", "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}}
    scene: Any = mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat"}, "splats": dog_dict(MODEL),
                               "sensor": sensor})
    assert "RadianceMeter cannot be splatted; use perspective, thinlens, orthographic" in problem_of(scene)


# Variants and scenes that ship

def test_renders_agree_before_and_after_the_variant_changes_there_and_back():
    wall = {"wall": {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, 4]).scale(9)}}
    before, kept = str(mi.variant()), scene_of(MODEL, CAMERA, nested={"type": "prb"}, extra=wall)
    image, of_kept = render(scene_of(MODEL, CAMERA)), render(kept)
    if "llvm_ad_mono" not in mi.variants():
        pytest.skip("llvm_ad_mono is not built into this Mitsuba")
    mi.set_variant("llvm_ad_mono")
    mi.set_variant(before)
    np.testing.assert_allclose(render(scene_of(MODEL, CAMERA)), image, atol=1e-6)
    np.testing.assert_array_equal(render(kept), of_kept)  # loaded before, as Mitsuba's own scenes go on, too


@pytest.mark.parametrize("path", sorted(p for p in SCENES.glob("*.xml") if "dogsplat" in p.read_text()), ids=str)
def test_a_scene_that_ships_renders_finite_radiance(path):
    """On a small film; test_example_scenes.py looks at the whole picture, which is display-referred."""
    tree = ElementTree.parse(path)
    for node in tree.iter("string"):
        if node.get("name") == "filename":
            node.set("value", str(SCENES / str(node.get("value"))))
    for node in tree.findall("sensor/film/integer"):
        node.set("value", {"width": "80", "height": "60"}[str(node.get("name"))])
    image = render(mi.load_string(ElementTree.tostring(tree.getroot(), encoding="unicode")), spp=1)
    assert image.shape[:2] == (60, 80) and np.isfinite(image).all() and image[..., :3].std() > 0.01
