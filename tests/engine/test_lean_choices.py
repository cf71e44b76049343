"""What a render does not ask for is in none of its kernels: depth, masks, AOVs, adjoints of transmittance."""

from collections import Counter
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest
from launches import kernels
from lean_calls import CAMERA, HEIGHT, WIDTH, N, backward, model, stages
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.geometry import Blocks, Grid
from mi_dogsplat.engine.walks.aovs import WALKED
from mi_dogsplat.scene.splats import Splats
from splat_scenes import (
    dog_dict,
    scene_of,
)

pytestmark = pytest.mark.usefixtures("fresh_recordings")


@pytest.mark.parametrize(
    ("choice", "grows"),
    [
        ({}, ""),
        ({"negative_transmittance": False}, ""),
        ({"aovs": "alpha"}, "image"),
        ({"aovs": "depth"}, "primitives compositor image"),
        ({"aovs": "normal"}, "primitives compositor image"),
        ({"antialiased": True}, "primitives"),
        ({"srgb_primitives": True}, "image"),
        ({"film": {"pixel_format": "rgba"}}, "image"),
        ({"extra": {"sky": {"type": "constant"}}}, "image"),
        ({"extra": {"nobody": dog_dict(Splats.empty(0))}}, ""),
    ],
    ids=str,
)
def test_what_a_scene_does_not_ask_for_is_in_no_kernel(choice, grows):
    def cost(**options):
        scene = scene_of(model(), CAMERA, **{"srgb_primitives": False, **options})
        return kernels(lambda: mi.render(scene)), stages(lambda: mi.render(scene))

    (bare, least), (kernels_with_it, with_it) = cost(), cost(**choice)
    assert len(bare) == len(kernels_with_it)
    assert {stage for stage in least if with_it[stage] > least[stage]} == set(grows.split())
    assert all(with_it[stage] >= least[stage] for stage in least)
    assert grows or bare == kernels_with_it


@pytest.mark.parametrize("names", ["median_depth", "index", "count", "dog_share", "median_depth,index,count,dog_share"])
def test_aovs_that_need_a_walk_take_one_kernel_more_and_leave_the_others_as_they_are(names):
    """And one that stores depths, for the median depth: on a CPU nothing else reads them from memory."""
    splats = model(dog_share=0.5)
    plain, scene = scene_of(splats, CAMERA), scene_of(splats, CAMERA, aovs=names)
    bare, with_it = (Counter(kernels(lambda s=s: mi.render(s))) for s in (plain, scene))
    more, lost = with_it - bare, bare - with_it
    lanes = Grid(WIDTH, HEIGHT, Blocks.of_backend()).n_tiles * Blocks.of_backend().lanes_per_tile
    stored = [N] if "median_depth" in names and array_types().is_llvm else []
    expected = Counter([lanes, *stored, *(size for size, _ in lost.elements())])
    assert Counter(size for size, _ in more.elements()) == expected
    assert {size for size, _ in lost} <= {WIDTH * HEIGHT}  # where channels are put into the film


def test_an_image_without_aovs_runs_no_code_of_theirs(monkeypatch):
    splats = model(dog_share=0.5)
    scene = scene_of(splats, CAMERA)
    bare = kernels(lambda: mi.render(scene))
    monkeypatch.setattr("mi_dogsplat.engine.aovs.channels", lambda *_: [])
    assert kernels(lambda: mi.render(scene)) == bare


def test_each_aov_of_the_walk_is_paid_alone():
    splats = model(dog_share=0.5)

    def cost(*names: str) -> int:
        scene = scene_of(splats, CAMERA, aovs=",".join(names))
        return stages(lambda: mi.render(scene))["compositor"]

    alone = {name: cost(name) for name in WALKED}
    assert all(cost(*WALKED) > alone[name] > cost() for name in WALKED)


def test_a_plain_model_makes_no_walk_for_the_share_of_dog():
    bare, asked = (scene_of(model(), CAMERA, aovs=names) for names in ("", "dog_share"))
    assert len(kernels(lambda: mi.render(asked))) == len(kernels(lambda: mi.render(bare)))


def test_derivatives_make_no_walk_for_aovs_that_have_none():
    def cost(*names: str) -> int:
        scene: Any = scene_of(model(dog_share=0.5), CAMERA, aovs=",".join(names))
        params: Any = mi.traverse(scene)
        shape = HEIGHT, WIDTH, 3 + len(names)
        adjoint = mi.TensorXf(dr.opaque(mi.Float, 1, HEIGHT * WIDTH * shape[2]), shape)

        def run():
            dr.enable_grad(params["splats.means"])
            params.update()
            scene.integrator().render_backward(scene, params, adjoint, sensor=0)

        return stages(run)["compositor"]

    assert cost("alpha", *WALKED) == cost("alpha") > 0


def test_the_adjoint_of_transmittance_is_paid_only_where_something_lies_behind():
    least = stages(backward(model()))
    behind = stages(backward(model(), δT=dr.opaque(mi.Float, 1, WIDTH * HEIGHT)))
    assert {stage for stage in least if behind[stage] > least[stage]} == {"compositor"}
