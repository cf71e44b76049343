"""The projection as one operation that is replayed: what ``project`` is, in both modes, on any backend."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from frozen_functions import forget, n_recordings
from mi_dogsplat.engine import projected as module
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.device_camera import DeviceCamera, Nudge
from mi_dogsplat.engine.frozen import KINDS_KEPT
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.projected import projected, replayed
from mi_dogsplat.scene.splats import Splats
from read_together import read, read_gradients
from same_numbers import assert_same_numbers
from splat_scenes import random_splats, rounded, scene_of, square_camera, tilted_camera

CAMERAS = [tilted_camera(16, 12, f=14.0, cx=7.0, cy=6.5), tilted_camera(32, 20, f=20.0, cx=15.0, cy=9.0)]
EVERYTHING: dict[str, Any] = {"slope_share": 0.6, "cut_share": 0.5, "second_cut_share": 0.4, "curvature_share": 0.7}


def model(n: int = 20, dog_share: float = 0.5, **shares: float) -> Splats:
    return rounded(random_splats(n, seed=3, degree=2, dog_share=dog_share, **shares))


def inputs(splats: Splats, view: int = 0, names: tuple | None = None) -> tuple[dict, DeviceCamera]:
    """(Parameters, of which those of these names are attached, or all; a camera that is nudged)"""
    params = upload(splats)
    dr.enable_grad([v for name, v in params.items() if dr.is_float_v(v) and (names is None or name in names)])
    nudge = Nudge.of(splats.n_splats) if names is None else None
    return params, replace(DeviceCamera.upload(CAMERAS[view]), nudge=nudge)


def columns_of(p) -> list:
    kernels = [p.kernels, *([p.pseudo] if p.pseudo else [])]
    return [p.x, p.y, p.depth, *(v for k in kernels for v in (k.ux, k.uy, k.vy, k.lo)), *p.colors, *p.varying]


def both(*given, **how) -> list:
    """What ``replayed`` and ``project`` give; ``inputs`` for each."""
    found = []
    for function in (replayed, project):
        params, camera = inputs(*given)
        arrays = {name: v for name, v in params.items() if dr.grad_enabled(v)}
        arrays |= {f"nudge {k}": v for k, v in enumerate(camera.nudge.values)} if camera.nudge else {}
        found.append((arrays, function(params, camera, sh_degree=how.get("sh_degree", 2), **how.get("more", {}))))
    return found


SETTINGS = [(model(),), (model(), 1), (model(**EVERYTHING),), (model(dog_share=0),), (model(), 0, ("means", "quats"))]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "more"), [*((given, {}) for given in SETTINGS), (SETTINGS[0], {"antialiased": True})], ids=range(6)
)
def test_values_and_gradients_are_those_of_project(given, more):
    """Three times each: a frozen function records first, and replays."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        (ours, p), (theirs, q) = both(*given, more=more)
        adjoints = [rng.normal(size=dr.width(value)) for value in columns_of(p)]
        for projection in (p, q):
            columns = columns_of(projection)
            for column, δ in zip(columns, adjoints, strict=True):
                dr.set_grad(column, mi.Float(δ))
            dr.enqueue(dr.ADMode.Backward, columns)
            dr.traverse(dr.ADMode.Backward)
        assert np.array_equal(p.visible.numpy(), q.visible.numpy())
        spreads = [[k.variance_x, k.variance_y] for k in (p.kernels, q.kernels)]
        values = read([*columns_of(p), *spreads[0]]), read([*columns_of(q), *spreads[1]])
        for a, b in zip(*values, strict=True):
            assert_same_numbers(a, b)
        assert set(ours) == set(theirs)
        got, expected = read_gradients(ours, ours), read_gradients(theirs, theirs)
        for name, value in got.items():
            assert_same_numbers(value, expected[name])
        moved = [name for name in ours if np.abs(got[name]).max() > 0]
        assert len(moved) == len(ours) if len(given) < 3 else set(moved) == set(given[2])


@pytest.mark.parametrize("given", SETTINGS, ids=range(len(SETTINGS)))
def test_tangents_are_those_of_project(given):
    rng = np.random.default_rng(0)
    (ours, p), (theirs, q) = both(*given)
    for name, value in ours.items():
        tangent = rng.normal(size=dr.width(value))
        for array in (value, theirs[name]):
            dr.set_grad(array, mi.Float(tangent))
    for projection in (p, q):
        dr.forward_to(columns_of(projection), flags=dr.ADFlag.ClearEdges)  # the depth is on the way to the others
    tangents = [read(map(dr.grad, columns_of(projection))) for projection in (p, q)]
    for a, b in zip(*tangents, strict=True):
        assert np.abs(b).max() > 0 or len(given) == 3  # where few parameters move
        assert_same_numbers(a, b)


@pytest.fixture
def on_a_gpu(monkeypatch) -> None:
    """What only a GPU replays is replayed here too."""
    monkeypatch.setattr(module, "array_types", lambda: replace(array_types(), is_llvm=False))


def derivatives_of_a_render(names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """By these parameters, backward, and forward along each."""
    scene = scene_of(model(**EVERYTHING), square_camera(16, 12, f=14.0))
    params: Any = mi.traverse(scene)
    for name in names:
        dr.enable_grad(params[name])
    weights = mi.TensorXf(np.random.default_rng(0).normal(size=(12, 16, 3)).astype(np.float32))
    dr.backward(dr.sum(mi.render(scene, params) * weights, axis=None))
    found = {name: np.ravel(values) for name, values in read_gradients(params, names).items()}
    for name in names:
        dr.set_grad(params[name], 0)
        dr.set_grad(params[name], 1)
        found[f"along {name}"] = np.ravel(dr.forward_to(mi.render(scene, params)).numpy())
        dr.set_grad(params[name], 0)
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "names", [("splats.means", "splats.dog_log_scales"), ("sensor.x_fov",), ("splats.means", "sensor.x_fov")], ids=str
)
def test_derivatives_through_mi_render_are_the_same_replayed(request, names):
    """Those by a sensor too, whose camera has derivatives that are no nudge's."""
    expected = derivatives_of_a_render(names)
    request.getfixturevalue("on_a_gpu")
    found = derivatives_of_a_render(names)
    assert set(found) == set(expected)
    for name, values in found.items():
        assert np.abs(expected[name]).max() > 1e-3, name
        assert_same_numbers(values, expected[name])


def test_numbers_of_primitives_may_come_and_go():
    """More of them than recordings are kept of."""
    for n in [*range(3, 5 + KINDS_KEPT), 4, 3]:
        params, camera = inputs(model(n))
        values = replayed(params, camera, sh_degree=2)
        expected = project(params, camera, sh_degree=2)
        assert_same_numbers(values.x.numpy(), expected.x.numpy())
        dr.backward(values.x + values.kernels.lo)
        gradient = dr.grad(params["means"]).numpy()
        dr.set_grad(params["means"], 0)
        dr.backward(expected.x + expected.kernels.lo)
        assert_same_numbers(gradient, dr.grad(params["means"]).numpy())


def test_another_camera_is_no_other_recording():
    forget()
    for view in (0, 1, 0):
        replayed(upload(model()), DeviceCamera.upload(CAMERAS[view]), sh_degree=2)
        assert n_recordings() == 1


def test_what_a_gpu_replays_follows_from_the_camera(on_a_gpu):
    params, camera = upload(model()), DeviceCamera.upload(CAMERAS[0])
    forget()
    projected(params, camera, sh_degree=1)
    assert n_recordings() == 1
    forget()
    dr.enable_grad(camera.fx)
    dr.backward(projected(params, camera, sh_degree=1).x)
    assert n_recordings() == 0 and dr.grad(camera.fx)[0] != 0


@pytest.mark.parametrize("one_of_many", [False, True])
def test_only_a_gpu_replays_but_for_one_pass_of_many(one_of_many):
    forget()
    projected(upload(model()), DeviceCamera.upload(CAMERAS[0]), sh_degree=2, one_of_many=one_of_many)
    assert n_recordings() == (0 if array_types().is_llvm and not one_of_many else 1)


def test_what_is_not_looked_at_has_no_tangent():
    params = upload(model().with_sh_degrees(np.arange(20) % 3))
    dr.enable_grad(params["sh2_coeffs"])
    found = replayed(params, DeviceCamera.upload(CAMERAS[0]), sh_degree=0).colors
    dr.set_grad(params["sh2_coeffs"], 1)
    dr.forward_to(found)
    assert not np.any(read(map(dr.grad, found)))
