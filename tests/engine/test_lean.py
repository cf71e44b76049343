"""Nothing is paid for what a scene does not need: shown in the kernels, by their number and their instructions.

What is left out is compared with a renderer that never had it (``plain_renderer.py`` of the benchmarks), or with the
same call without it. Kernels are told apart by their size: a lane per primitive, per block of pixels, per pixel.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from launches import branches, instructions, kernels, launches, llvm_only, loop
from lean_calls import CAMERA, HEIGHT, WIDTH, N, adjoints, backward, forward, model
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.bands import PreparedView
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.engine.view import prepare
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.engine.walks.walk import Walk
from mi_dogsplat.scene.splats import Splats
from same_numbers import assert_same_numbers
from splat_scenes import (
    attached,
    make_splats,
    rounded,
    scene_of,
)
from tile_lists import lanes_of_isects

from benchmarks.engine import plain_renderer

pytestmark = pytest.mark.usefixtures("fresh_recordings")


def stripped_forward(splats: Splats) -> Callable[[], Any]:
    params, camera = upload(splats), DeviceCamera.upload(CAMERA)

    def run():
        colors, T = plain_renderer.render(params, camera)
        dr.eval(colors, T)
        return [*colors, T]

    return run


def stripped_backward(splats: Splats) -> Callable[[], Any]:
    camera, δ = DeviceCamera.upload(CAMERA), [dr.detach(δ, preserve_type=False) for δ in adjoints()]

    def run():
        params = attached(splats)
        plain_renderer.backward(params, camera, δ)
        gradients = [dr.grad(value) for value in params.values()]
        dr.eval(gradients)
        return gradients

    return run


# --- a model without DoG ---


@pytest.mark.parametrize(("engine", "stripped"), [(forward, stripped_forward), (backward, stripped_backward)])
def test_a_plain_model_costs_what_it_costs_in_a_renderer_without_any_option(engine, stripped):
    """The same launches, kernels of the same instructions, the same bits; where atomics add, in any order.

    But for what has a lane for each primitive on CUDA: there the engine's projection is kernels of its own.
    """
    ours, lean = engine(model()), stripped(model())
    launched, expected = launches(ours), launches(lean)
    if not array_types().is_llvm:
        launched, expected = ([k for k in found if k.size != N] for found in (launched, expected))
    assert [(k.kind, k.size, k.operations) for k in launched] == [(k.kind, k.size, k.operations) for k in expected]
    for a, b in zip(launched, expected, strict=True):
        assert a.instructions == b.instructions
    # half as many pixels in a lane of CUDA, and one primitive per iteration
    assert sum(k.operations for k in launched) > (3000 if array_types().is_llvm else 1500)
    for a, b in zip(ours(), lean(), strict=True):
        assert_same_numbers(a.numpy(), b.numpy())


def test_a_plain_model_never_looks_at_the_modes_of_dog():
    plain = kernels(backward(model(), negative_transmittance=True))
    assert kernels(backward(model(), negative_transmittance=False)) == plain
    dog = [kernels(backward(model(dog_share=0.5), negative_transmittance=mode)) for mode in (True, False)]
    assert dog[0] != dog[1]


def test_dog_arrays_without_a_row_cost_nothing():
    splats = model(dog_share=0.5)
    without = Splats(**{**vars(splats.plain()), "dog_index": np.zeros(0, np.uint32)})
    assert kernels(forward(without)) == kernels(forward(splats.plain()))
    scene, plain = scene_of(splats, CAMERA), scene_of(splats.plain(), CAMERA)
    params = mi.traverse(scene)
    params["splats.dog_index"] = dr.zeros(mi.UInt32, 0)
    params["splats.dog_logit_opacities"] = mi.TensorXf(np.zeros(0, np.float32))
    params["splats.dog_log_scales"] = mi.TensorXf(np.zeros((0, 3), np.float32))
    params.update()
    assert kernels(lambda: mi.render(scene)) == kernels(lambda: mi.render(plain))


# --- a mixture ---


@llvm_only
@pytest.mark.parametrize("run", [forward, backward])
def test_the_second_kernel_of_a_mixture_is_in_branches_that_packets_jump_over(run, monkeypatch):
    blocks = replace(Blocks.of_backend(), adapts=False)  # else narrow packets take fewer at once of a mixture
    monkeypatch.setattr(Blocks, "of_backend", lambda: blocks)
    plain, mixed = loop(launches(run(model()))), loop(launches(run(model(dog_share=0.5))))
    inside = branches(mixed.code)
    assert not branches(plain.code) and len(inside) % blocks.unroll == 0 and inside
    shift = "shl"  # an exponential ends in one; the others make addresses
    skipped = sum((instructions(code) for code in inside), Counter())
    exponentials = 3 * blocks.unroll
    assert plain.instructions[shift] >= exponentials
    assert mixed.instructions[shift] - skipped[shift] == plain.instructions[shift]
    assert skipped[shift] >= exponentials


def lanes_with_a_second_kernel(splats: Splats) -> tuple[int, int]:
    """Pseudo-Gaussians that lanes evaluate, counted as they do, and DoG primitives that are on the lists of lanes."""
    view = prepare(upload(splats), DeviceCamera.upload(CAMERA), RasterOptions(splats.sh_degree))
    assert isinstance(view, PreparedView)
    evaluated = dr.zeros(array_types().UInt, 1)
    pseudo_row = Walk.pseudo_row

    def counted(self, row):
        dr.scatter_add(evaluated, type(row)(1), type(row)(0))
        return pseudo_row(self, row)

    with pytest.MonkeyPatch.context() as patch, dr.scoped_set_flag(dr.JitFlag.KernelFreezing, False):
        patch.setattr(Walk, "pseudo_row", counted)
        dr.eval(composite(view))
    is_dog = np.isin(view.lists.splat_from_isect.numpy(), splats.dog_index)
    return int(evaluated.numpy()[0]), int(lanes_of_isects(view.lists, view.grid)[is_dog].sum())


def test_only_lanes_that_meet_a_dog_primitive_evaluate_a_second_kernel():
    splats = model(dog_share=0.2)
    splats.logit_opacities[:] = -4  # so that no walk ends early
    evaluated, met = lanes_with_a_second_kernel(splats)
    assert evaluated == met > 0
    splats.means[splats.dog_index, 2] = -1  # behind the camera
    assert lanes_with_a_second_kernel(splats) == (0, 0)


def test_dog_primitives_in_a_corner_leave_every_other_tile_as_it_was():
    splats = model()
    pixel, depth = np.array([7, 7]), 2.0
    seen_there = np.append((pixel - (CAMERA.cx, CAMERA.cy)) / (CAMERA.fx, CAMERA.fy) * depth, [depth, 1])
    one = rounded(make_splats((CAMERA.c2w @ seen_there)[:3], 0.03, 0.9, dog=[0]))
    mixed = Splats(**{name: np.concatenate([getattr(one, name), getattr(splats, name)]) for name in vars(splats)})
    images = [np.stack([p.numpy().reshape(HEIGHT, WIDTH) for p in forward(s)()]) for s in (mixed, mixed.plain())]
    changed = (images[0] != images[1]).any(0)
    assert changed[:16, :16].any() and not changed[16:].any() and not changed[:, 16:].any()


def test_a_mixture_takes_three_kernels_more_than_a_plain_model():
    """One of its own for what the pseudo-Gaussians share with their primaries, one for them, one for their table."""
    plain, mixed = kernels(forward(model())), kernels(forward(model(dog_share=0.5)))
    assert len(plain) < len(mixed) <= len(plain) + 3
