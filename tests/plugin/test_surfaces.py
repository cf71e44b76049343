"""Other shapes in the scene: rendered by a nested integrator, splats in front of them and hidden behind them."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.aovs import AOVS, channel_names
from mi_dogsplat.plugin.instances import warn_of_instances
from mi_dogsplat.reference import aovs as reference_aovs
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.scene.splats import Splats
from splat_scenes import (
    dog_dict,
    opaque_only,
    random_splats,
    rounded,
    scene_of,
    sensor_dict,
)


def model(n=40, seed=2, **choices) -> Splats:
    return rounded(random_splats(n, seed=seed, degree=1, **choices))


# Scenes

def wall(z: float, radiance=(0.2, 0.5, 0.9), size=10.0, turn=0.0) -> dict[str, Any]:
    """A square that shines by itself, so that nothing is random; it faces a camera at the origin that looks along z."""
    to_world = mi.ScalarTransform4f().translate([0, 0, z]).rotate([0, 1, 0], 180 + turn).scale(size)
    return {"type": "rectangle", "to_world": to_world,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(radiance)}}}


FRONT = Camera(np.eye(4), 18.0, 18.0, 10.0, 8.0, 20, 16)


def render(splats: Splats, surfaces: dict, spp=1, film: dict | None = None, sensor: dict | None = None,
           **integrator) -> np.ndarray:
    nested = {"nested": {"type": "path"}, "srgb_primitives": False, **integrator}
    scene = scene_of(splats, FRONT, film=film, extra={**surfaces, **({"other": sensor} if sensor else {})}, **nested)
    return np.array(mi.render(scene, sensor=len(scene.sensors()) - 1, spp=spp))


def test_a_wall_hides_what_is_behind_it_and_shows_behind_what_is_in_front():
    splats = model(dog_share=0.5)
    radiance = np.array([0.2, 0.5, 0.9])
    near = splats.select(np.flatnonzero(splats.means[:, 2] <= 2.5))
    assert 0 < near.n_splats < splats.n_splats
    expected = reference.render(near, FRONT, radiance)[0]
    assert np.abs(render(splats, {"wall": wall(2.5)}) - expected).mean() < 2e-5
    display = reference.render(near, FRONT, np.array(mi.math.linear_to_srgb(mi.Float(radiance))))[0]
    expected = np.where(display <= 0.04045, display / 12.92, ((np.maximum(display, 0.04045) + 0.055) / 1.055) ** 2.4)
    assert np.abs(render(splats, {"wall": wall(2.5)}, srgb_primitives=True) - expected).mean() < 2e-5


@pytest.mark.parametrize(("own", "of_nested"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize("nested", ["path", "direct"])
def test_a_hidden_lamp_neither_ends_splats_nor_covers_what_is_behind(nested, own, of_nested):
    """A wall that shines is left out of the picture as if it were not there, and lights a ball all the same."""
    splats, film = model(), {"pixel_format": "rgba"}
    hidden = {"hide_emitters": own, "nested": {"type": nested, "hide_emitters": of_nested}, "film": film}
    alone = render(splats, {}, film=film)
    np.testing.assert_allclose(render(splats, {"wall": wall(2.5)}, **hidden), alone, atol=1e-6)
    ball = {"type": "sphere", "center": [0.0, 0.0, 8.0], "radius": 1.0}
    lit = render(splats.select(np.zeros(0, int)), {"wall": wall(2.5, turn=180), "ball": ball}, spp=4, **hidden)
    assert lit[8, 10, 3] == 1 and lit[8, 10, 2] > 0.01 and lit[0, 0].max() == 0


def test_a_slanted_wall_cuts_each_pixel_at_its_own_depth():
    """The oracle asks, pixel by pixel, where its ray meets the plane x sin + (z - 3) cos = 0."""
    splats, turn = model(60, dog_share=0.3), np.radians(50)
    y, x = np.mgrid[0:16, 0:20] + 0.5
    u = (x - FRONT.cx) / FRONT.fx
    z = 3 * np.cos(turn) / (np.cos(turn) + u * np.sin(turn))
    got = render(splats, {"wall": wall(3, turn=float(np.degrees(turn)))}, aovs="alpha,depth")
    got_turned = render(splats, {"wall": wall(3, turn=float(-np.degrees(turn)))}, aovs="alpha,depth")
    empty = render(Splats.empty(1), {"wall": wall(3, turn=float(np.degrees(turn)))}, aovs="alpha,depth")
    if np.abs(empty[8, :, 4] - z[8]).max() > 1e-3:  # the other way round
        got, z = got_turned, z
    for row in range(0, 16, 5):
        for column in range(20):
            near = splats.select(np.flatnonzero(splats.means[:, 2] <= z[row, column]))
            image, T, depth = (v[row, column] for v in reference.render(near, FRONT, (0.2, 0.5, 0.9)))
            np.testing.assert_allclose(got[row, column, :3], image, atol=2e-4)
            np.testing.assert_allclose(got[row, column, 3:], (1, depth + T * z[row, column]), rtol=1e-3)


def slanted_wall(z: float, size: float, turn=40.0) -> tuple[dict, np.ndarray, np.ndarray]:
    """(A wall; its depth at each pixel [H, W], infinite beside it; its normal towards the camera [H, W, 3]).

    Each pixel's ray meets the plane n (p - c) = 0; the wall reaches ``size`` units from its middle along its two axes.
    """
    sine, cosine = np.sin(np.radians(turn)), np.cos(np.radians(turn))
    normal = np.array([-sine, 0, -cosine])
    y, x = np.mgrid[0:16, 0:20] + 0.5
    ray = np.stack([(x - FRONT.cx) / FRONT.fx, (y - FRONT.cy) / FRONT.fy, np.ones_like(x)], -1)  # to depth 1
    depth = z * normal[2] / (ray @ normal)
    place = ray * depth[..., None] - (0, 0, z)
    on_it = (depth > 0) & (np.abs(place @ (cosine, 0, -sine)) < size) & (np.abs(place[..., 1]) < size)
    facing = np.where((ray @ normal)[..., None] > 0, -normal, normal)
    return wall(z, size=size, turn=turn), np.where(on_it, depth, np.inf), np.where(on_it[..., None], facing, 0)


def aovs_with_a_surface(splats: Splats, surface: np.ndarray, normal: np.ndarray) -> tuple[dict, np.ndarray]:
    """AOVs of the twin, and which pixels are clear: each sees the primitives nearer than its surface, then that."""
    z = FRONT.project(splats.means)[1]
    clear = np.abs(z / surface[..., None] - 1).min(-1) > 1e-4
    nearer = (z <= surface[..., None]).sum(-1)
    result: dict[str, np.ndarray] = {}
    for count in np.unique(nearer):
        here = nearer == count
        part = opaque_only(splats, np.argsort(np.argsort(z)) < count)
        planes, clearness = reference_aovs.aovs(part, FRONT)
        clear[here] &= clearness[here] > 1e-3
        projection = reference.project(part, FRONT)
        lists = reference.tiles(projection, 20, 16)
        features = reference_aovs.normals(part, FRONT)
        sums, T, depth = reference.composite(projection, lists, 20, 16, features=features)
        hit = np.isfinite(surface)
        planes["alpha"] = np.where(hit, 1, planes["alpha"])
        planes["depth"] = np.where(hit, depth + T * np.where(hit, surface, 0), planes["depth"])
        blended = sums + T[..., None] * normal
        blended /= np.maximum(np.linalg.norm(blended, axis=-1, keepdims=True), 1e-9)
        planes["normal"] = np.where(hit[..., None], blended, planes["normal"])
        planes["median_depth"] = np.where(hit & (planes["median_depth"] == 0), surface, planes["median_depth"])
        for name, plane in planes.items():
            result.setdefault(name, np.zeros(plane.shape))[here] = plane[here]
    return result, clear


@pytest.mark.parametrize("dog_share", [0, 0.4])
@pytest.mark.parametrize("z, size", [(0.7, 10.0), (0.7, 0.15), (2.8, 10.0), (2.8, 0.8), (12.0, 50.0)], ids=str)
def test_every_aov_is_that_of_the_primitives_in_front_and_then_of_the_surface(z, size, dog_share):
    """A slanted wall in front of all primitives, among them, and behind them, filling the view or part of it."""
    splats = model(60, seed=5, dog_share=dog_share)
    shape, surface, normal = slanted_wall(z, size)
    got = render(splats, {"wall": shape}, aovs=",".join(AOVS))[..., 3:]
    expected, clear = aovs_with_a_surface(splats, surface, normal)
    assert clear.mean() > 0.8 and clear[np.isfinite(surface)].any()
    solid = clear & (expected["alpha"] > 0.02)
    channel = 0
    for name in AOVS:
        size_of = len(channel_names([name]))
        plane = got[..., channel:channel + size_of].reshape(expected[name].shape)
        channel += size_of
        where = solid if name in ("depth", "normal") else clear
        atol = 5e-3 if name == "normal" else 1e-4
        np.testing.assert_allclose(plane[where], expected[name][where], rtol=1e-3, atol=atol, err_msg=name)
    alone = reference_aovs.aovs(splats, FRONT)[0]
    between = np.isfinite(surface) & clear
    seen = {"alpha"} | ({"count", "depth", "median_depth", "normal"} if z < 12 else set())
    for name in seen:  # the surface matters
        assert np.abs(expected[name] - alone[name])[between].max() > 0.05, name
    if z == 0.7:  # nothing is in front of the wall
        assert (expected["index"][between] == -1).all() and not expected["count"][between].any()


def test_alpha_is_that_of_splats_and_surfaces_together():
    splats = model(dog_share=0)
    film = {"pixel_format": "rgba"}
    part = render(splats, {"wall": wall(2.5, size=0.5)}, film=film)
    whole = render(splats, {"wall": wall(2.5)}, film=film)
    none = np.array(mi.render(scene_of(splats, FRONT, film=film)))
    assert (whole[..., 3] == 1).all()
    covered = part[..., 3] == 1
    assert 0.05 < covered.mean() < 0.6
    np.testing.assert_allclose(part[~covered, 3], none[~covered, 3], atol=1e-6)


def test_the_edge_of_a_surface_is_antialiased_over_the_samples():
    """Coverage of a half-plane whose edge runs through pixels, known in closed form for a box filter."""
    edge = 0.137  # at depth 2, in world units
    plate = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([edge - 5, 0, 2]).rotate(
        [0, 1, 0], 180).scale(5), "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [1, 1, 1]}}}
    got = render(Splats.empty(0), {"plate": plate}, spp=64, film={"pixel_format": "rgba"})
    position = FRONT.cx + FRONT.fx * edge / 2
    expected = np.clip(position - np.arange(20), 0, 1)
    assert 0.1 < expected[int(position)] < 0.9
    np.testing.assert_allclose(got[..., 0], np.broadcast_to(expected, (16, 20)), atol=0.03)
    np.testing.assert_allclose(got[..., 3], got[..., 0], atol=1e-6)


@pytest.mark.parametrize("kind", ["orthographic", "thinlens"])
def test_depths_of_surfaces_and_splats_agree_for_every_sensor(kind):
    """A wall just behind the only splat shows it, one just in front hides it."""
    splats: Any = model(1, dog_share=0)
    splats.means[:], splats.log_scales[:], splats.logit_opacities[:] = (0.3, 0.2, 3), np.log(0.2), 4
    own = sensor_dict(FRONT)
    scale = [0.6, 0.6, 0.7] if kind == "orthographic" else 1
    sensor = {"type": kind, "film": own["film"], "to_world": mi.ScalarTransform4f().rotate([0, 1, 0], 0).scale(scale)}
    if kind == "thinlens":
        sensor |= {"fov": 50.0, "aperture_radius": 0.2, "focus_distance": 2.0}
    images = [render(splats, {"wall": wall(z)}, spp=4, sensor=sensor) for z in (2.999, 3.001)]
    blank = render(Splats.empty(1), {"wall": wall(3)}, spp=4, sensor=sensor)
    np.testing.assert_allclose(images[0], blank, atol=1e-5)
    assert np.abs(images[1] - blank).max() > 0.2


def test_rays_do_not_meet_a_dog_shape_and_its_surroundings_are_lit_as_if_it_were_not_there():
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, 3]).rotate([0, 1, 0], 180)}
    lit = {"floor": floor, "sky": {"type": "constant"}}
    splats = model(50)
    scene = scene_of(splats, FRONT, extra=lit)
    without: Any = mi.load_dict({"type": "scene", "sensor": sensor_dict(FRONT), **lit})
    path: Any = mi.load_dict({"type": "path"})
    a, b = (np.array(mi.render(s, integrator=path, spp=16)) for s in (scene, without))
    np.testing.assert_allclose(a, b, atol=1e-6)
    y, x = np.mgrid[-1:1:40j, -1:1:40j]
    origin = mi.Point3f(0, 0, -1)
    direction = dr.normalize(mi.Vector3f(mi.Float(x.ravel()), mi.Float(y.ravel()), mi.Float(1)))
    alone: Any = mi.load_dict({"type": "scene", "splats": dog_dict(splats)})
    assert not dr.any(alone.ray_intersect(mi.Ray3f(origin, direction)).is_valid())


def test_a_lit_mesh_converges_to_what_the_path_tracer_makes_of_it():
    ball = {"type": "sphere", "center": [0.2, 0, 3], "radius": 0.7, "bsdf": {"type": "diffuse"}}
    lit = {"ball": ball, "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.5, 0.7, 1.0]}}}
    got = render(Splats.empty(0), lit, spp=256)
    scene: Any = mi.load_dict({"type": "scene", "sensor": sensor_dict(FRONT), **lit})
    expected = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path"}), spp=1024))  # type: ignore[arg-type]
    assert np.abs(got - expected).mean() < 0.01 and np.abs(got - expected).max() < 0.08


def test_fog_around_the_sensor_is_that_of_surfaces():
    """It takes all of the light that it meets: what is left is exp(-distance / 4)."""
    fog = {"type": "homogeneous", "albedo": 0.0, "sigma_t": 0.25}
    image = render(Splats.empty(0), {"wall": wall(2.5)}, nested={"type": "volpath"}, spp=64,
                   sensor=sensor_dict(FRONT) | {"medium": fog})
    y, x = np.mgrid[0:16, 0:20] + 0.5
    distance = 2.5 * np.sqrt(1 + ((x - FRONT.cx) / FRONT.fx) ** 2 + ((y - FRONT.cy) / FRONT.fy) ** 2)
    left = np.exp(-0.25 * distance).mean()
    np.testing.assert_allclose(image.mean((0, 1)), left * np.array([0.2, 0.5, 0.9]), rtol=0.03)


@pytest.mark.parametrize("nested", ["path", "prb", "direct", "emission"])
def test_integrators_in_c_and_in_python_may_be_nested(nested):
    """The last is somebody's own, with the signature that Mitsuba calls it by."""

    class Emission(mi.SamplingIntegrator):
        def sample(self, scene, sampler, ray, medium, active):
            si = scene.ray_intersect(ray, active)
            return si.emitter(scene, active).eval(si, active), si.is_valid(), []

    mi.register_integrator("emission", lambda props: Emission(props))
    image = render(Splats.empty(0), {"wall": wall(2.5)}, nested={"type": nested})
    np.testing.assert_allclose(image, np.broadcast_to([0.2, 0.5, 0.9], image.shape), atol=1e-5)


def test_the_sampler_says_how_many_samples_surfaces_get():
    lit = {"ball": {"type": "sphere", "center": [0, 0, 3]}, "sky": {"type": "constant"}}
    scene = scene_of(model(5), FRONT, extra=lit, nested={"type": "path"})
    default, four, one = (np.array(mi.render(scene, spp=spp)) for spp in (0, 4, 1))
    np.testing.assert_array_equal(default, four)  # of an independent sampler
    assert np.abs(four - one).max() > 1e-3


def test_derivatives_of_splats_take_surfaces_as_constant():
    splats = model(10, seed=4)
    adjoint = np.random.default_rng(0).normal(size=(16, 20, 3)).astype(np.float32)
    front = splats.select(np.flatnonzero(splats.means[:, 2] <= 2.5))
    assert 2 <= front.n_splats <= 8

    def gradient(s: Splats, extra: dict, **integrator) -> np.ndarray:
        scene = scene_of(s, FRONT, extra=extra, **integrator)
        params: Any = mi.traverse(scene)
        dr.enable_grad(params["splats.means"])
        params.update()
        dr.backward(dr.sum(mi.render(scene, params, spp=1) * mi.TensorXf(adjoint), axis=None))
        return dr.grad(params["splats.means"]).numpy()

    got = gradient(splats, {"wall": wall(2.5)}, nested={"type": "path"})
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.2, 0.5, 0.9]}}
    expected = gradient(front, {"sky": sky})
    np.testing.assert_allclose(got[splats.means[:, 2] <= 2.5], expected, atol=1e-4 * np.abs(expected).max())
    assert not got[splats.means[:, 2] > 2.5].any()


def test_two_nested_integrators_are_refused():
    with pytest.raises(RuntimeError, match="2 nested integrators"):
        mi.load_dict({"type": "dogsplat", "a": {"type": "path"}, "b": {"type": "direct"}})


def test_channels_of_a_nested_integrator_are_refused_as_they_would_be_lost():
    nested = {"type": "aov", "aovs": "far:depth,n:sh_normal", "image": {"type": "path"}}
    with pytest.raises(RuntimeError, match=r'not kept \(image.R.*n.Z\); use its own "aovs"'):
        mi.load_dict({"type": "dogsplat", "nested": nested})


def test_a_nested_integrator_that_traces_from_the_lights_is_refused():
    with pytest.raises(RuntimeError, match="dogsplat: a nested ParticleTracer.* such as path"):
        mi.load_dict({"type": "dogsplat", "nested": {"type": "ptracer"}})


@pytest.mark.parametrize(("kind", "warned"), [("both", 1), ("no instance", 0), ("no splats", 0)])
def test_instances_of_splats_are_not_drawn_and_that_is_said_once(capfd, kind, warned):
    splats = model()
    grouped = {"ball": {"type": "sphere", "radius": 0.01}} | ({} if kind == "no splats" else {"dog": dog_dict(splats)})
    moved = mi.ScalarTransform4f().translate([0, 0, -9])  # out of view
    instance = {"type": "instance", "to_world": moved, "shapes": {"type": "ref", "id": "group"}}
    extra = {"group": {"type": "shapegroup", **grouped}} | ({} if kind == "no instance" else {"instance": instance})
    scene = scene_of(splats, FRONT, extra=extra)
    for _ in range(2):
        mi.render(scene, spp=1)
    told = "".join(capfd.readouterr())
    assert told.count("instances do not show 1 dog shape in a shapegroup; load its file once for each") == warned


def test_instances_of_a_model_that_is_shown_by_itself_too_are_missed_as_well(capfd, tmp_path):
    """Mitsuba makes one shape of two equal ones: of the model, and of that in the group."""
    write_ply(tmp_path / "model.ply", model())
    dog = {"type": "dog", "filename": str(tmp_path / "model.ply")}
    instance = {"type": "instance", "shapes": {"type": "ref", "id": "group"}}
    scene = mi.load_dict({"type": "scene", "dog": dog, "group": {"type": "shapegroup", "dog": dog}, "shown": instance})
    warn_of_instances("dogsplat", scene)
    assert "instances do not show 1 dog shape in a shapegroup" in "".join(capfd.readouterr())
